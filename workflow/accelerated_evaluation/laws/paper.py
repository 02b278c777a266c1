"""From the encounter table to lane-change models: piecewise (sections III, VI.A) and single (section II)."""

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.distributions import BoundedExponential, Distribution, Pareto, PiecewiseMixture
from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.fitting.pieces import PieceFamily
from accelerated_evaluation.fitting.piecewise import (
    fit_piecewise,
    knots_at_quantiles,
    knots_by_profile_likelihood,
)
from accelerated_evaluation.laws.independent import IndependentLaw, recorded_lead_speeds


def choose_knots(
    x: Array, lower: float, families: list[PieceFamily], settings: Mapping[str, Any]
) -> list[float]:
    """Choose knots as the configuration says: at quantiles, at given values, or by profile likelihood."""
    if settings["method"] == "quantiles":
        return knots_at_quantiles(x, settings["quantiles"])
    if settings["method"] == "values":
        return list(settings["values"])
    grid = np.linspace(settings["profile"]["low"], settings["profile"]["high"], settings["profile"]["points"])
    return knots_by_profile_likelihood(x, lower, families, grid)


def fit_paper_laws(
    encounters: pd.DataFrame,
    models: Mapping[str, Any],
    range_max: float,
    description: str,
    closing_speed_max: float,
) -> dict[str, IndependentLaw]:
    """Fit the laws ``two_pieces`` and ``three_pieces``, named by the pieces of R^-1, and ``single``.

    Parameters
    ----------
    encounters
        Encounter table.
    models
        Section ``models`` of the configuration.
    range_max
        Largest range [m]; R^-1 begins at its inverse.
    description
        What the encounters are.
    closing_speed_max
        Cap on closing speeds [m/s].
    """
    lower = 1 / range_max
    inverse_range = encounters["inverse_range"].to_numpy()
    piece_of_range = PieceFamily(models["inverse_range"]["pieces"])
    pieces_of_ttc = [PieceFamily(**models["inverse_ttc"]["body"]), PieceFamily(models["inverse_ttc"]["tail"])]

    def piecewise_range(pieces: int, settings: Mapping[str, Any]) -> Distribution:
        families = [piece_of_range] * pieces
        return fit_piecewise(
            inverse_range, lower, choose_knots(inverse_range, lower, families, settings), families
        )

    def piecewise_ttc(x: Array) -> Distribution:
        knots = choose_knots(x, 0.0, pieces_of_ttc, models["inverse_ttc"]["knots"])
        return fit_piecewise(x, 0.0, knots, pieces_of_ttc)

    ttc = _by_segment(encounters, piecewise_ttc)
    ranges = {
        "two_pieces": (piecewise_range(2, models["inverse_range"]["two_pieces"]), ttc),
        "three_pieces": (piecewise_range(3, models["inverse_range"]["three_pieces"]), ttc),
        "single": (Pareto.fit(inverse_range, lower), _by_segment(encounters, fit_exponential_from_zero)),
    }
    events = {segment: len(rows) for segment, rows in _segments(encounters)}
    recorded = recorded_lead_speeds(encounters, events), closing_speed_max
    return {name: IndependentLaw(description, events, *laws, *recorded) for name, laws in ranges.items()}


def fit_exponential_from_zero(x: Array) -> BoundedExponential:
    """Fit an exponential distribution to the whole of x."""
    return BoundedExponential.fit(x, 0.0, math.inf)


def _segments(encounters: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    groups = encounters.groupby("segment", sort=False)
    return sorted(groups, key=lambda group: group[1]["lead_speed"].min())


def _by_segment(encounters: pd.DataFrame, fit: Callable[[Array], Distribution]) -> dict[str, Distribution]:
    return {segment: fit(rows["inverse_ttc"].to_numpy()) for segment, rows in _segments(encounters)}


def refit(law: PiecewiseMixture, x: Array) -> PiecewiseMixture:
    """Fit the pieces of a piecewise mixture to another sample, at the same knots."""
    return fit_piecewise(x, law.lower, law.knots, [PieceFamily.of(piece) for piece in law.components])
