"""The state of a sampler, from which it can be resumed, and its file.

A state file is JSON with the name of the format, its version, a checksum and the state itself. It is rejected
with one error message if it is damaged, or belongs to another version, problem or batch size.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from fewruns.arrays import Array
from fewruns.constants import ENOUGH_REPEATS
from fewruns.errors import InputError
from fewruns.gaussian_process import Predecessor
from fewruns.json_files import read_json, write_json
from fewruns.law_draws import LawDraws
from fewruns.progress import Batch, Progress
from fewruns.repeats import RepeatBatch
from fewruns.state_json import MISFIT, decode, encode
from fewruns.subspace import space_along
from fewruns.two_phase import TwoPhaseBatch

FORMAT, VERSION = "accelerated-evaluation sampler state", 12


@dataclass(frozen=True)
class State:
    """Everything that is needed to resume a sampler.

    Attributes
    ----------
    fingerprint
        Text that identifies the problem.
    dimension, batch_size
        Number of normal scores, and number of simulations in a batch.
    progress
        The runs so far, and the quantities derived from them.
    axes, theta, sites
        Axes, logarithms of lengths and amplitude, and factors that approximate the likelihood of the flags;
        arrays of the surrogate `EventSurrogate`.
    graded_theta
        Logarithms of the lengths, the amplitude and the noise of the regression of the scores.
    generator
        State of the bit generator.
    predecessor
        Runs of a similar vehicle.
    deterministic, enough_repeats, enough_draws
        Whether the outcomes are stated to be deterministic, and the numbers of repetitions and of draws of
        the law that are required for convergence otherwise.
    """

    fingerprint: str
    dimension: int
    batch_size: int
    progress: Progress
    axes: Array
    theta: Array
    sites: Array
    graded_theta: Array
    generator: dict[str, Any]
    predecessor: Predecessor | None = None
    deterministic: bool | None = True
    enough_repeats: int = ENOUGH_REPEATS
    enough_draws: int = 0

    def to_json(self) -> dict[str, Any]:
        """Return the contents of a state file: lists and numbers, with a version and a checksum."""
        state = encode(self)
        return {"format": FORMAT, "version": VERSION, "checksum": _checksum(state), "state": state}

    @classmethod
    def from_json(cls, content: Mapping[str, Any], where: str) -> "State":
        """Return the state from the contents of a state file.

        Parameters
        ----------
        content
            The contents, as `to_json` returned them.
        where
            Path of the file, for error messages.

        Raises
        ------
        InputError
            If the content is not the state of a sampler, is of another version, or is damaged.
        """
        restart = "Name a path where there is no file yet; the sampler then starts from the beginning."
        if not isinstance(content, Mapping) or content.get("format") != FORMAT:
            raise InputError(
                where, seen="no state of a sampler", expected=f"format {FORMAT!r}", change=restart
            )
        if (version := content.get("version")) != VERSION:
            raise InputError(where, seen=f"version {version}", expected=f"version {VERSION}", change=restart)
        damage = "a checksum that does not belong to the content, so the file is damaged"
        if content.get("checksum") == _checksum(content.get("state")):
            try:
                return _whole(decode(cls, content["state"]))
            except MISFIT as error:
                damage = f"a state that does not fit together ({error})"  # but the checksum is its own
        raise InputError(
            where,
            seen=damage,
            expected="a file as the sampler wrote it",
            change=f"Restore the file from a copy. {restart}",
        )

    def check(self, *, fingerprint: str, dimension: int, batch_size: int, where: str) -> None:
        """Check that the state belongs to a given problem and batch size.

        Parameters
        ----------
        fingerprint, dimension, batch_size
            The values of the present problem.
        where
            Path of the file, for error messages.

        Raises
        ------
        InputError
            If a value of the state differs.
        """
        own = {"dimension": dimension, "fingerprint": fingerprint, "batch_size": batch_size}
        for name, expected in own.items():
            if (seen := getattr(self, name)) != expected:
                what = "batch size" if name == "batch_size" else f"problem's {name}"
                raise InputError(
                    where,
                    seen=f"the {what} {seen!r}",
                    expected=f"{expected!r}",
                    change="Name the state file of this run, or a path where there is no file yet.",
                )


def read_state(path: str | os.PathLike) -> State:
    """Return the state of a sampler from a state file.

    Raises
    ------
    InputError
        If the file is not the state of a sampler, is of another version, or is damaged.
    """
    try:
        content = read_json(path)
    except ValueError:  # The file is not JSON, or not even text; `from_json` then raises the error.
        content = {}
    return State.from_json(content, str(path))


def write_state(path: str | os.PathLike, state: State) -> None:
    """Write the state of a sampler to a file, atomically: an interruption leaves no incomplete file."""
    write_json(path, state.to_json())


def _checksum(state: Any) -> str:  # noqa: ANN401
    """Return a digest that does not depend on the layout of the file."""
    text = json.dumps(state, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _whole(state: State) -> State:
    """Return a state that was read from a file; raise ValueError if its arrays do not agree."""
    progress, d = state.progress, state.dimension
    runs, others = len(progress.happened), 0
    if state.predecessor is not None:
        state.predecessor.check(d)
        others = len(state.predecessor.happened)
    for name, columns in {"z": d, "wide_draws": 3, "foreseen": 2}.items():
        if getattr(progress, name).size == 0:  # an empty list has lost its second dimension
            setattr(progress, name, np.empty((0, columns)))
    if progress.directions is not None:
        _require_shape("directions", progress.directions, d, max(progress.directions.shape[-1], 1))
    coordinates = space_along(progress.directions, d).dimension
    _require_shape("axes", state.axes, coordinates, coordinates)
    _require_shape("theta", state.theta, coordinates + 1 + (others > 0))
    _require_shape("graded_theta", state.graded_theta, coordinates + 2)
    _require_shape("sites", state.sites, 2, min(state.sites.size // 2, runs + others))
    _require_shape("z", progress.z, runs, d)
    if not len(progress.law_draws):
        progress.law_draws = LawDraws.none(d)
    _require_shape("law_draws", progress.law_draws.z, len(progress.law_draws), d)
    _require_shape("score", progress.score, runs)
    _require_zones(progress.wide_draws)
    _require_shape("foreseen", progress.foreseen, min(len(progress.foreseen), runs), 2)
    for name, value in vars(progress.repeats).items():
        _require_shape(name, value, len(progress.repeats))
    asked = progress.pending.repeated if isinstance(progress.pending, RepeatBatch) else np.empty(0)
    if not np.isin(np.append(progress.repeats.repeated, asked), np.arange(runs)).all():
        raise ValueError("a repeat of a run that was not made")
    if progress.centres is not None:
        _require_shape("centres", progress.centres, max(len(progress.centres), 1), d)
    for batch in (*progress.batches, *filter(None, [progress.pending])):
        _require_whole_batch(batch, d)
    if sum(len(batch.z) for batch in progress.batches) > runs or len(progress.batches) > len(
        progress.estimates
    ):
        raise ValueError("more runs in the batches than in the progress")
    if not np.allclose(state.axes.T @ state.axes, np.eye(coordinates), atol=1e-6):
        raise ValueError("axes that are not at right angles")
    if (state.sites[0] <= 0).any():
        raise ValueError("a site with a precision that is not above 0")
    generator_in(state.generator)
    return state


def _require_whole_batch(batch: Batch, d: int) -> None:
    """Raise ValueError if the arrays of a batch of points in d dimensions do not agree."""
    columns = {"z": [d], "foreseen": [2], "kept": [d]}
    if isinstance(batch, TwoPhaseBatch) and batch.kept.size == 0:  # an empty list has lost its dimensions
        columns["kept"] = list(batch.kept.shape[1:])
    for name, value in vars(batch).items():
        if isinstance(value, np.ndarray):
            rows = max(len(batch.z), 1)
            if name == "wide_draws":
                _require_zones(value)
                continue
            if name.startswith("kept"):
                rows = len(batch.kept)
            _require_shape(name, value, rows, *columns.get(name, []))


def _require_zones(wide_draws: Array) -> None:
    """Raise ValueError if an interval of rarity of the wide draws does not have a positive width."""
    _require_shape("wide_draws", wide_draws, len(wide_draws), 3)
    if not (wide_draws[:, 1] < wide_draws[:, 2]).all():
        raise ValueError("a zone of rarity that does not end above its beginning")


def _require_shape(name: str, array: Array, *shape: int) -> None:
    if array.shape != shape:
        raise ValueError(f"{name} has the shape {array.shape}, and {shape} was expected")


def generator_in(state: Mapping[str, Any]) -> np.random.Generator:
    """Return a generator whose bit generator is in the given state."""
    bits = getattr(np.random, state["bit_generator"])()
    bits.state = state
    return np.random.Generator(bits)
