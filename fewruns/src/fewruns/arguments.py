"""Checks of what users pass: the arguments of a sampler, and the outcomes of runs."""

import math
from collections.abc import Callable, Mapping
from typing import TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from fewruns.arrays import Array, Flags
from fewruns.certificate import Certificate
from fewruns.constants import LARGEST, POOL
from fewruns.cover import Cover
from fewruns.errors import InputError, require
from fewruns.problems import Predecessor

LARGEST_BATCH = POOL // 4


def is_whole(value: object, least: float, most: float = math.inf) -> TypeGuard[int]:
    """Return whether a value is a whole number in a range; True and False are none."""
    return (
        isinstance(value, int | np.integer) and not isinstance(value, bool) and bool(least <= value <= most)
    )


def check_settings(settings: Mapping[str, object]) -> None:
    """Raise InputError if an argument of `Sampler` has another type or is out of range."""
    for name, value in settings.items():
        fits, expected = _RULES[name]
        require(name, value, expected, fits=fits(value))


def outcomes(
    happened: ArrayLike, score: ArrayLike | None, failed: ArrayLike | None, n: int
) -> tuple[Flags, Array, Flags]:
    """Return flags, scores and which of n runs have failed, shape (n,); without scores they are 0.

    Flags and scores of failed runs are replaced by False and 0.
    """
    failed = np.zeros(n, bool) if failed is None else np.asarray(failed)
    is_mask = failed.shape == (n,) and failed.dtype == bool
    require("failed", failed, f"{n} booleans that state which runs have no outcome", fits=is_mask)
    try:
        happened, score = np.asarray(happened), np.zeros(n) if score is None else np.asarray(score)
    except ValueError:  # lists of different lengths
        happened = score = np.empty(0, object)
    if happened.dtype != bool or score.dtype.kind not in "biuf":
        seen = f"flags of the type {happened.dtype} and scores of the type {score.dtype}"
        expected = "booleans that state whether the event happens, and real numbers"
        change = "Return, for example, `margin <= 0, margin`."
        raise InputError("the outcomes", seen=seen, expected=expected, change=change)
    if happened.shape != (n,) or score.shape != (n,) or np.isnan(score[~failed]).any():
        seen = f"{happened.shape} flags and {score.shape} scores, {np.isnan(score).sum()} of them NaN"
        expected = f"{n} flags and {n} scores, each as an array of the shape ({n},), and numbers"
        change = "Return one outcome for each of the points, in their order."
        raise InputError("the outcomes", seen=seen, expected=expected, change=change)
    score = np.clip(np.where(failed, 0.0, score), -LARGEST, LARGEST)
    return happened & ~failed, score, failed


_SWITCH = (lambda value: isinstance(value, bool), "True or False")
_NUMBER_OF_CHECKS = (lambda value: is_whole(value, 0), "a whole number, at least 0")

# Whether a value of each argument of a sampler can be used, and what is expected.
_RULES: dict[str, tuple[Callable[[object], bool], str]] = {
    "dimension": (lambda value: is_whole(value, 1), "a whole number, at least 1"),
    "generator": (lambda value: isinstance(value, np.random.Generator), "a numpy.random.Generator"),
    "batch_size": (lambda value: is_whole(value, 1, LARGEST_BATCH), f"a whole number, 1 to {LARGEST_BATCH}"),
    "fingerprint": (lambda value: isinstance(value, str), "a text"),
    "certificate": (
        lambda value: isinstance(value, Certificate | Cover | None),
        "a Cover, a Certificate or None",
    ),
    "upper_set": _SWITCH,
    "predecessor": (lambda value: isinstance(value, Predecessor | None), "a Predecessor or None"),
    "deterministic": (lambda value: isinstance(value, bool | None), "True, False or None"),
    "enough_repeats": _NUMBER_OF_CHECKS,
    "enough_draws": _NUMBER_OF_CHECKS,
    "frequent": _SWITCH,
}
