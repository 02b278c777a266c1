"""Fit the paper's laws to an encounter table: piecewise (sections III, VI.A) and single (section II)."""

import math
import warnings
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import ConvergenceError, located
from accelerated_evaluation.laws.distributions import (
    BoundedExponential,
    Distribution,
    Pareto,
    PiecewiseMixture,
)
from accelerated_evaluation.laws.paper.independent import IndependentLaw, recorded_lead_speeds
from accelerated_evaluation.laws.paper.piecewise import (
    EXPONENTIAL,
    PieceFamily,
    fit_piecewise,
    knots_at_quantiles,
    knots_by_profile_likelihood,
    usable_knots,
)

PIECEWISE = {"two_pieces": 2, "three_pieces": 3}  # piecewise laws: name, and number of pieces of R^-1
PAPER_LAWS = (*PIECEWISE, "single")


def choose_knots(
    x: Array, lower: float, families: list[PieceFamily], settings: Mapping[str, Any]
) -> list[float]:
    """Choose knots by the configured method: at quantiles, given, or by profile likelihood.

    Knots are moved if a piece would contain fewer than two different values. If the profile likelihood cannot
    be computed for any knots of its grid, the best knots for exponential pieces are used. A warning is issued
    in both cases. ``settings`` contains the key ``method`` and the settings of the method.
    """
    if settings["method"] == "profile":
        grid = np.linspace(*(settings["profile"][name] for name in ("low", "high", "points")))
        try:
            return knots_by_profile_likelihood(x, lower, families, grid)
        except ConvergenceError as error:
            warnings.warn(f"{error} The knots are chosen for exponential pieces.", stacklevel=2)
        with suppress(ConvergenceError):
            return knots_by_profile_likelihood(x, lower, [EXPONENTIAL] * len(families), grid)
    chosen = settings["values"] if settings["method"] == "values" else None
    if chosen is None:
        chosen = knots_at_quantiles(x, settings["quantiles"])
    knots = usable_knots(x, chosen)
    if knots != list(chosen):
        warnings.warn(f"knots {chosen} moved to {knots}, to leave two values in each piece", stacklevel=2)
    return knots


def fit_paper_laws(
    encounters: pd.DataFrame,
    models: Mapping[str, Any],
    range_max: float,
    description: str,
    closing_speed_max: float,
) -> dict[str, IndependentLaw]:
    """Fit the three laws of the paper, `PAPER_LAWS`, to an encounter table.

    The laws ``two_pieces`` and ``three_pieces`` are piecewise mixtures, and are named by the number of pieces
    of R^-1. In the law ``single``, R^-1 has a Pareto distribution and TTC^-1 has an exponential distribution.
    The support of R^-1 begins at 1 / range_max [1/m], and ``closing_speed_max`` is a cap [m/s].
    """
    lower = 1 / range_max
    inverse_range = encounters["inverse_range"].to_numpy()

    def piecewise_range(pieces: int, settings: Mapping[str, Any]) -> Distribution:
        families = families_of_range(models, pieces)
        with located("R^-1"):
            knots = choose_knots(inverse_range, lower, families, settings)
            return fit_piecewise(inverse_range, lower, knots, families)

    def piecewise_ttc(x: Array) -> Distribution:
        families = families_of_ttc(models)
        knots = choose_knots(x, 0.0, families, models["inverse_ttc"]["knots"])
        return fit_piecewise(x, 0.0, knots, families)

    ttc = _by_segment(encounters, piecewise_ttc)
    ranges = {
        **{
            name: (piecewise_range(pieces, models["inverse_range"][name]), ttc)
            for name, pieces in PIECEWISE.items()
        },
        "single": (Pareto.fit(inverse_range, lower), _by_segment(encounters, fit_exponential_from_zero)),
    }
    counts = {segment: len(rows) for segment, rows in _segments(encounters)}
    recorded = recorded_lead_speeds(encounters, counts), closing_speed_max
    fitted = {name: IndependentLaw(description, counts, *laws, *recorded) for name, laws in ranges.items()}
    for piece in simpler_pieces(fitted[next(iter(PIECEWISE))], models):
        warnings.warn(piece, stacklevel=2)
    return fitted


def families_of_range(models: Mapping[str, Any], pieces: int) -> list[PieceFamily]:
    """Return the family of each piece of R^-1, given the section ``models`` and the number of pieces."""
    return [PieceFamily(models["inverse_range"]["pieces"])] * pieces


def families_of_ttc(models: Mapping[str, Any]) -> list[PieceFamily]:
    """Return the families of the body and the tail of TTC^-1, given the section ``models``."""
    return [PieceFamily(**models["inverse_ttc"]["body"]), PieceFamily(models["inverse_ttc"]["tail"])]


def simpler_pieces(law: IndependentLaw, models: Mapping[str, Any]) -> list[str]:
    """Return one sentence for each piece that was fitted with a simpler family than ``models`` configures."""
    laws = {"R^-1": (law.inverse_range, families_of_range(models, len(law.inverse_range.components)))}
    for segment, of_segment in law.inverse_ttc.items():
        laws[f"TTC^-1 in segment {segment} m/s"] = of_segment, families_of_ttc(models)
    return [
        f"{variable}, [{piece.lower:.4g}, {piece.upper:.4g}): {fitted}, as a {family} cannot be fitted there"
        for variable, (pieces, families) in laws.items()
        for piece, family in zip(pieces.components, families, strict=True)
        if (fitted := PieceFamily.of(piece)) != family
    ]


def fit_exponential_from_zero(x: Array) -> BoundedExponential:
    """Return the exponential distribution on [0, inf) fitted to a sample x, shape (n,), by its mean."""
    return BoundedExponential.fit(x, 0.0, math.inf)


def _segments(encounters: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    groups = encounters.groupby("segment", sort=False)
    return sorted(groups, key=lambda group: group[1]["lead_speed"].min())


def _by_segment(encounters: pd.DataFrame, fit: Callable[[Array], Distribution]) -> dict[str, Distribution]:
    laws = {}
    for segment, rows in _segments(encounters):
        with located(f"TTC^-1 in segment {segment} m/s"):
            laws[segment] = fit(rows["inverse_ttc"].to_numpy())
    return laws


def refit(law: PiecewiseMixture, x: Array) -> PiecewiseMixture:
    """Return ``law`` fitted again to another sample x, shape (n,), with the same knots and families.

    If a piece would contain fewer than two different values, the knots are moved as little as necessary.
    """
    families = [PieceFamily.of(piece) for piece in law.components]
    return fit_piecewise(x, law.lower, usable_knots(x, law.knots), families)
