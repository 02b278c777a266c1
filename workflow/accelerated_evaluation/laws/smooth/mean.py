"""The mean law: the mixture, with equal weights, of draws of a law from its posterior.

A vehicle that is slow to simulate is simulated once, under this law, and the outcomes are reweighted for each
draw k by f_k / f_mean. The law that is sampled contains every draw with the share 1 / K, so no such weight
exceeds K.

With x = log(R_max / R), g_k the density of x given the lead speed v_L, and f_k that of the closing speed c
given both, the density of a cut-in is the mean of g_k(x) f_k(c) over the draws. So the range has the density
mean g_k(x), and the closing speed given the range is a mixture with weights in proportion to g_k(x). Both are
mapped to unit-exponential scores (Rosenblatt 1952), as the laws of the family are, and the inverse of the
map is found by Newton's method.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.special import logsumexp

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.distributions import Empirical
from accelerated_evaluation.laws import LAWS
from accelerated_evaluation.laws.paper.independent import recorded_lead_speeds
from accelerated_evaluation.laws.protocol import CutIns, Factors, Law, Stratum
from accelerated_evaluation.laws.smooth.conditional import Places, SpeedLaw, Threshold, range_grid, speed_grid
from accelerated_evaluation.laws.smooth.dependent import COORDINATES, CUT
from accelerated_evaluation.laws.smooth.draws import Hazards, LawDraws, SpeedsAt
from accelerated_evaluation.laws.smooth.excess import Excess
from accelerated_evaluation.laws.smooth.shapes import SHAPES
from accelerated_evaluation.laws.smooth.smooth_hazard import SmoothHazard
from accelerated_evaluation.laws.smooth.support import Support

PLACES_AT_ONCE = 400  # bounds the memory: some 100 MB with 500 draws
STEPS = 100  # most steps of Newton's method, or of bisection where a step leaves its bracket
TOLERANCE = 1e-12  # relative, of the closing speed and of log(R_max / R)


@dataclass(frozen=True)
class Cell:
    """The mixture at n places, part by part of the Rosenblatt map.

    Attributes
    ----------
    ranges
        Hazards of log(R_max / R) of the shared ranges.
    share
        Share of the draws that have each of the ranges, shape (a, 1).
    """

    ranges: Hazards
    share: Array

    def range_score(self, value: Array) -> tuple[Array, Array]:
        """Return -log P(X > x) of the mixture at x = log(R_max / R), shape (n,), and its derivative by x."""
        cumulative, rate = self.ranges.at(value)
        return _mixed(cumulative, np.log(rate) - cumulative, np.log(self.share))

    def log_density(self, value: Array) -> Array:
        """Return the log density of x = log(R_max / R) of each of the shared ranges, shape (a, n)."""
        cumulative, rate = self.ranges.at(value)
        return np.log(rate) - cumulative


def _mixed(cumulative: Array, log_density: Array, log_weight: Array) -> tuple[Array, Array]:
    """Return -log of the mean survival function, and the hazard of the mixture; the rows are mixed."""
    survival = log_weight - cumulative
    largest = survival.max(axis=0)
    left = np.exp(survival - largest).sum(axis=0)
    hazard = np.exp(log_weight + log_density - largest).sum(axis=0) / left
    lost = -(np.exp(log_weight) * np.expm1(-cumulative)).sum(axis=0)
    # Near 0 the score keeps its digits if it is found from what is lost, and otherwise from what is left.
    is_near = lost < 0.5
    score = np.where(is_near, -np.log1p(-np.where(is_near, lost, 0.0)), -largest - np.log(left))
    return score, hazard


def solve(
    score: Callable[[Array], tuple[Array, Array]], level: Array, start: Array, largest: float = math.inf
) -> Array:
    """Return where an increasing function of n values, 0 at 0, reaches a level.

    Newton's method, with bisection where a step leaves the bracket that is known so far.

    Parameters
    ----------
    score
        Returns the function and its derivative at values of shape (n,).
    level
        Not negative, shape (n,).
    start
        Where to begin, above 0, shape (n,).
    largest
        Value at which the function is known to have reached every level.
    """
    low, high, value = np.zeros(level.size), np.full(level.size, largest), start
    has_settled = np.zeros(level.size, dtype=bool)
    for _ in range(STEPS):
        reached, slope = score(value)
        short = reached < level
        low, high = np.where(short, value, low), np.where(short, high, value)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            step = value + (level - reached) / slope
        middle = np.where(np.isfinite(high), (low + high) / 2, 2 * value)
        new = np.where((step > low) & (step < high), step, middle)
        # A value stays once it has settled, so that it does not depend on the others.
        close = TOLERANCE * new
        has_settled_now = (np.abs(new - value) <= close) | (high - low <= close)
        value, has_settled = np.where(has_settled, value, new), has_settled | has_settled_now
        if has_settled.all():
            break
    return value


@dataclass(frozen=True)
class MeanStratum(Stratum):
    """One segment of the lead speed; its coordinates are the scores of `DependentStratum`."""

    lead_speed: Empirical
    draws: LawDraws
    factors: Factors = COORDINATES

    @property
    def pieces(self) -> Factors:
        """The unit exponentials of the scores, each cut at its 95 % quantile."""
        return Factors(CUT, CUT)

    @property
    def inverse_range_min(self) -> float:
        """The smallest R^-1 [1/m]: that of the largest range that is recorded."""
        return 1 / self.draws.support.range_max

    def cut_ins(self, lead_speed: Array, first: Array, second: Array) -> CutIns:
        """Return the cut-ins of given scores."""
        range_, speed = np.empty(first.size), np.empty(first.size)
        farthest = self.draws.support.range_max
        for part in _parts(first.size):
            lead = lead_speed[part]
            places = self._places(lead, np.full(lead.size, farthest))
            cell = self._cell(places)
            value = solve(cell.range_score, first[part], np.ones(lead.size))
            range_[part] = farthest * np.exp(-value)
            speeds, log_weight = self._speeds(lead, range_[part], cell, value)
            start = self.draws.laws[0].given(self._places(lead, range_[part])).inverse(second[part])
            speed[part] = solve(
                lambda c, at=speeds, weight=log_weight: _mixed(*at.at(c), weight),
                second[part],
                np.maximum(start, TOLERANCE),
            )
        return CutIns(lead_speed, 1 / range_, speed / range_)

    def first(self, lead_speed: ArrayLike, inverse_range: ArrayLike) -> Array:
        """Return the score of the range; infinite where R^-1 is."""
        speed, inverse_range = np.broadcast_arrays(*_floats(lead_speed, inverse_range))
        score = np.full(speed.shape, math.inf)
        near = np.isfinite(inverse_range)
        score[near] = self._range_scores(speed[near], inverse_range[near])[0]
        return score

    def log_first_slope(self, lead_speed: ArrayLike, inverse_range: ArrayLike) -> Array:
        """Return the log derivative of the first score by R^-1."""
        speed, inverse_range = np.broadcast_arrays(*_floats(lead_speed, inverse_range))
        return np.log(self._range_scores(speed, inverse_range)[1]) - np.log(inverse_range)

    def second(self, lead_speed: ArrayLike, inverse_range: ArrayLike, closing_speed: ArrayLike) -> Array:
        """Return the score of the closing speed; infinite where that is."""
        arrays = np.broadcast_arrays(*_floats(lead_speed, inverse_range, closing_speed))
        lead, inverse_range, closing = (array.ravel() for array in arrays)
        return self.second_at(lead, inverse_range, closing[:, None]).reshape(arrays[0].shape)

    def second_at(self, lead_speed: Array, inverse_range: Array, closing_speeds: Array) -> Array:
        """Return the scores of several closing speeds at each of n places, shape (n, m)."""
        score = np.full(closing_speeds.shape, math.inf)
        for part in _parts(lead_speed.size):
            lead, range_, closing = lead_speed[part], 1 / inverse_range[part], closing_speeds[part]
            value, cell = self._logarithm(inverse_range[part]), self._cell(self._places(lead, range_))
            speeds, log_weight = self._speeds(lead, range_, cell, value)
            for column, speed in enumerate(closing.T):
                finite = np.isfinite(speed)
                found = _mixed(*speeds.at(np.where(finite, speed, 0.0)), log_weight)[0]
                score[part, column] = np.where(finite, found, math.inf)
        return score

    def log_densities(self, lead_speed: Array, range_: Array, closing_speed: Array) -> Array:
        """Return the log density of log(R_max / R) and closing speed under each draw, shape (K, n)."""
        density = np.empty((self.draws.size, lead_speed.size))
        for part in _parts(lead_speed.size):
            places = self._places(lead_speed[part], range_[part])
            value = self._logarithm(1 / range_[part])
            of_range = self._cell(places).log_density(value)[self.draws.shared]
            density[:, part] = of_range + self.draws.speeds_at(places).at(closing_speed[part])[1]
        return density

    def _cell(self, places: Places) -> Cell:
        counts = np.bincount(self.draws.shared, minlength=len(self.draws.ranges))
        return Cell(self.draws.ranges_at(places), counts[:, None] / self.draws.size)

    def _speeds(self, lead: Array, range_: Array, cell: Cell, value: Array) -> tuple[SpeedsAt, Array]:
        """Return the laws of the closing speed at places, and the log weights of the draws there, (K, n)."""
        log_weight = cell.log_density(value)[self.draws.shared]
        return (
            self.draws.speeds_at(self._places(lead, range_)),
            log_weight - logsumexp(log_weight, axis=0),
        )

    def _range_scores(self, lead_speed: Array, inverse_range: Array) -> tuple[Array, Array]:
        scores = np.empty((2, lead_speed.size))
        for part in _parts(lead_speed.size):
            places = self._places(lead_speed[part], 1 / inverse_range[part])
            scores[:, part] = self._cell(places).range_score(self._logarithm(inverse_range[part]))
        return scores[0], scores[1]

    def _logarithm(self, inverse_range: Array) -> Array:
        return np.maximum(np.log(self.draws.support.range_max * inverse_range), 0.0)

    def _places(self, lead_speed: Array, range_: Array) -> Places:
        return Places.of(lead_speed, range_, self.draws.support)


@LAWS.add("mean")
@dataclass(frozen=True, repr=False)
class MeanLaw(Law):
    """v_L as recorded, and the mean of draws of range and closing speed given v_L.

    Attributes
    ----------
    description
        The data that it was fitted to, in words.
    counts
        Number of lane changes by segment of v_L, by rising speed; the law is the same in all.
    draws
        The draws that it is the mean of.
    lead_speeds
        The recorded v_L [m/s] by segment; they are the encounter table's, not the law file's.
    closing_speed_max
        Closing speed [m/s] from which nothing changes for any vehicle, and at which faster cut-ins are
        simulated: a few draws have so heavy a tail where there are no records that the mean law has no sharp
        end.
    """

    kind: ClassVar[str] = "mean"

    description: str
    counts: Mapping[str, int]
    draws: LawDraws = field(compare=False)
    lead_speeds: Mapping[str, Empirical] = field(compare=False)
    closing_speed_max: float = math.inf

    @classmethod
    def fitted(
        cls, draws: LawDraws, encounters: pd.DataFrame, description: str, closing_speed_max: float = math.inf
    ) -> Self:
        """Return the mean of draws, with segments and lead speeds of the encounter table of their fit."""
        segments = encounters.groupby("segment")["lead_speed"].agg(["min", "size"]).sort_values("min")
        counts = {segment: int(size) for segment, size in segments["size"].items()}
        return cls(description, counts, draws, recorded_lead_speeds(encounters, counts), closing_speed_max)

    def __repr__(self) -> str:
        """Return a text that identifies the law: description, counts, and a digest of its draws."""
        parts = self.description, dict(self.counts), self.draws.digest, self.closing_speed_max
        return f"{type(self).__name__}{parts}"

    @property
    def shares(self) -> dict[str, float]:
        """Share of the lane changes that fall into each segment."""
        total = sum(self.counts.values())
        return {segment: count / total for segment, count in self.counts.items()}

    @property
    def strata(self) -> dict[str, MeanStratum]:
        """The law in each segment."""
        return {segment: MeanStratum(self.lead_speeds[segment], self.draws) for segment in self.counts}

    def only(self, stratum: str) -> Self:
        """Return the law of one segment alone, whose share is then one."""
        counts, lead_speeds = {stratum: self.counts[stratum]}, {stratum: self.lead_speeds[stratum]}
        return replace(self, counts=counts, lead_speeds=lead_speeds)

    def thinned(self, size: int) -> Self:
        """Return the mean of fewer draws."""
        return replace(self, draws=self.draws.thinned(size))

    def only_draws(self, chosen: NDArray[np.intp]) -> Self:
        """Return the mean of some of the draws, given by their numbers."""
        return replace(self, draws=self.draws.only(chosen))

    def log_ratios(self, cut_ins: CutIns) -> Array:
        """Return log(f_k / f_mean) of n cut-ins for each draw k, shape (K, n); none exceeds log K."""
        stratum = next(iter(self.strata.values()))  # the law is the same in all
        densities = stratum.log_densities(cut_ins.lead_speed, cut_ins.range_, cut_ins.closing_speed)
        return densities - (logsumexp(densities, axis=0) - math.log(self.draws.size))

    def content(self) -> dict[str, Any]:
        """Return what a law file holds of it: the parameters of all draws."""
        draws, levels = self.draws, {}
        for law in draws.laws:
            if law.threshold is not None:
                levels[law.threshold.level] = law.threshold.table.tolist()
        return {
            "counts": dict(self.counts),
            "support": draws.support.content(),
            "range": [{"log_hazard": ranges.coefficients.tolist()} for ranges in draws.ranges],
            "closing_speed": [{"log_hazard": body.coefficients.tolist()} for body in draws.bodies],
            "thresholds": [
                {"level": level, "unit": "m/s", "table": table} for level, table in levels.items()
            ],
            "draws": [
                {"name": name, "shared": int(shared)} | _tail_content(law)
                for name, shared, law in zip(draws.names, draws.shared, draws.laws, strict=True)
            ],
        }

    @classmethod
    def from_content(
        cls, content: Mapping[str, Any], encounters: pd.DataFrame, description: str, closing_speed_max: float
    ) -> Self:
        """Build the law that `content` described, with the lead speeds of an encounter table."""
        support = Support.of(content["support"])
        grids = range_grid(support), speed_grid(support)
        ranges, bodies = (
            tuple(SmoothHazard(grid, np.array(part["log_hazard"])) for part in content[name])
            for grid, name in zip(grids, ("range", "closing_speed"), strict=True)
        )
        surfaces = {
            part["level"]: Threshold(part["level"], *grids[1].edges[:2], np.array(part["table"]))
            for part in content["thresholds"]
        }
        laws = tuple(_speed_law(part, bodies, surfaces) for part in content["draws"])
        shared = np.array([part["shared"] for part in content["draws"]])
        names = tuple(part["name"] for part in content["draws"])
        draws = LawDraws(ranges, bodies, laws, shared, names, support)
        counts = content["counts"]
        return cls(description, counts, draws, recorded_lead_speeds(encounters, counts), closing_speed_max)


def _tail_content(law: SpeedLaw) -> dict[str, Any]:
    if law.tail is None:
        return {}
    return {
        "level": law.threshold.level,
        "shape": law.tail.shape.name,
        "parameters": law.tail.parameters.tolist(),
        "log_scale": law.tail.coefficients.tolist(),
    }


def _speed_law(
    part: Mapping[str, Any], bodies: tuple[SmoothHazard, ...], surfaces: Mapping[float, Threshold]
) -> SpeedLaw:
    body = bodies[part["shared"]]
    if "shape" not in part:
        return SpeedLaw(body)
    excess = Excess(SHAPES[part["shape"]], np.array(part["log_scale"]), np.array(part["parameters"]))
    return SpeedLaw(body, surfaces[part["level"]], excess)


def _floats(*arrays: ArrayLike) -> list[Array]:
    return [np.atleast_1d(np.asarray(array, dtype=float)) for array in arrays]


def _parts(size: int) -> list[slice]:
    return [slice(start, start + PLACES_AT_ONCE) for start in range(0, size, PLACES_AT_ONCE)]
