"""The paper's law of cut-ins and its fits: piecewise (sections III, VI.A) and single (section II)."""

import math
import warnings
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import ConvergenceError, located
from accelerated_evaluation.laws import LAWS
from accelerated_evaluation.laws.distributions import (
    BoundedExponential,
    Described,
    Distribution,
    Empirical,
    Pareto,
    PiecewiseMixture,
    from_dict,
)
from accelerated_evaluation.laws.paper.piecewise import (
    EXPONENTIAL,
    PieceFamily,
    fit_piecewise,
    knots_at_quantiles,
    knots_by_profile_likelihood,
    usable_knots,
)
from accelerated_evaluation.laws.protocol import Box
from accelerated_evaluation.laws.strata import Factors, StratifiedLaw, Stratum

UNITS = {"inverse_range": "1/m", "inverse_ttc": "1/s"}
PIECEWISE = {"two_pieces": 2, "three_pieces": 3}  # piecewise laws: name, and number of pieces of R^-1
PAPER_LAWS = (*PIECEWISE, "single")


@dataclass(frozen=True)
class IndependentStratum(Stratum):
    """A segment of the paper's law, whose two coordinates are R^-1 [1/m] and TTC^-1 [1/s]."""

    lead_speed: Empirical
    factors: Factors

    def points(self, lead_speed: Array, first: Array, second: Array) -> Array:
        """Return the cut-ins, shape (n, 3), with given v_L [m/s], R^-1 [1/m] and TTC^-1 [1/s]."""
        return np.column_stack([lead_speed, 1 / first, second / first])

    def first(self, lead_speed: ArrayLike, inverse_range: ArrayLike) -> Array:
        """Return the first coordinate, which is R^-1 [1/m] itself; it does not depend on v_L."""
        return np.asarray(inverse_range)

    def second(self, lead_speed: ArrayLike, inverse_range: ArrayLike, closing_speed: ArrayLike) -> Array:
        """Return the second coordinate TTC^-1 [1/s], which is the closing speed times R^-1."""
        return np.asarray(closing_speed) * inverse_range

    @property
    def range_max(self) -> float:
        """The inverse of the smallest R^-1 in the support of its distribution [m]."""
        lowest = self.factors.first.lower
        return 1 / lowest if lowest > 0 else math.inf


@LAWS.add("independent")
@dataclass(frozen=True)
class IndependentLaw(StratifiedLaw):
    """The paper's law, in which v_L, R^-1 and TTC^-1 are independent within each segment of v_L.

    R^-1 has the same distribution in all segments, and TTC^-1 has one distribution for each segment (paper,
    section VI.A). ValueError is raised if counts, distributions and lead speeds have different segments, or a
    count is not positive.
    """

    description: str
    counts: Mapping[str, int]
    inverse_range: Described  # of R^-1 [1/m]
    inverse_ttc: Mapping[str, Described]  # of TTC^-1 [1/s], by segment
    # The recorded v_L [m/s] by segment, which are read from the encounter table and not stored in the law
    # file.
    lead_speeds: Mapping[str, Empirical] = field(compare=False)
    closing_speed_max: float = math.inf  # cap on closing speeds [m/s]

    def __post_init__(self) -> None:
        segments = {name: [*part] for name, part in vars(self).items() if isinstance(part, Mapping)}
        if not self.counts or any(set(names) != set(self.counts) for names in segments.values()):
            raise ValueError(f"all parts of a law must have the same segments, got {segments}")
        if not all(isinstance(count, int) and count > 0 for count in self.counts.values()):
            raise ValueError(f"counts must be positive whole numbers, got {dict(self.counts)}")

    @property
    def segments(self) -> tuple[str, ...]:
        """Names of the segments, in order of speed."""
        return tuple(self.counts)

    @property
    def strata(self) -> dict[str, IndependentStratum]:
        """The distribution in each segment, by name of the segment."""
        return {
            segment: IndependentStratum(
                self.lead_speeds[segment], Factors(self.inverse_range, self.inverse_ttc[segment])
            )
            for segment in self.segments
        }

    @property
    def n_parameters(self) -> int:
        """Number of fitted parameters without the knots.

        In table II of the paper it is 18 for the piecewise law and 4 for the single law.
        """
        return self.inverse_range.n_parameters + sum(law.n_parameters for law in self.inverse_ttc.values())

    def only(self, stratum: str) -> Self:
        """Return the law restricted to one segment, given by its name, whose share is then one."""
        parts = {name: {stratum: getattr(self, name)[stratum]} for name in ("counts", "inverse_ttc")}
        return type(self)(
            self.description,
            **parts,
            inverse_range=self.inverse_range,
            lead_speeds={stratum: self.lead_speeds[stratum]},
            closing_speed_max=self.closing_speed_max,
        )

    def content(self) -> dict[str, Any]:
        """Return the content of the law file for JSON: counts, and distributions with their units."""
        laws = {segment: law.to_dict() for segment, law in self.inverse_ttc.items()}
        return {
            "counts": dict(self.counts),
            "inverse_range": {"unit": UNITS["inverse_range"], "distribution": self.inverse_range.to_dict()},
            "inverse_ttc": {"unit": UNITS["inverse_ttc"], "distributions": laws},
        }

    @classmethod
    def from_content(cls, content: Mapping[str, Any], box: Box, records: pd.DataFrame) -> Self:
        """Build a law from the content of its file, its limits, and the records, which supply v_L."""
        counts, laws = content["counts"], content["inverse_ttc"]["distributions"]
        return cls(
            description=content["description"],
            counts=counts,
            inverse_range=from_dict(content["inverse_range"]["distribution"]),
            inverse_ttc={segment: from_dict(law) for segment, law in laws.items()},
            lead_speeds=recorded_lead_speeds(records, counts),
            closing_speed_max=box.upper[2],
        )


def recorded_lead_speeds(encounters: pd.DataFrame, segments: Mapping[str, Any]) -> dict[str, Empirical]:
    """Return the recorded v_L [m/s] of each segment by name; ValueError if a segment has no encounter."""
    speeds = encounters.groupby("segment", observed=True)["lead_speed"]
    missing = [segment for segment in segments if segment not in speeds.groups]
    if missing:
        raise ValueError(f"the encounter table has no rows in segment {', '.join(missing)}")
    return {segment: Empirical(speeds.get_group(segment)) for segment in segments}


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
