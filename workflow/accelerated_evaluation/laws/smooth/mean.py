"""The mean law: the mixture, with equal weights, of K draws of a law from its posterior.

A vehicle that is slow to simulate is simulated once, under this law. The outcomes are then reweighted for
each draw k by the ratio of the densities f_k / f_mean. The mean law contains every draw with the share 1 / K,
so these weights never exceed K.

Let x = log(R_max / R), let g_k be the density of x given the lead speed v_L, and let f_k be the density of
the closing speed c given v_L and x. The density of a cut-in is the mean of g_k(x) f_k(c) over the draws. The
range therefore has the density mean g_k(x), and the closing speed given the range is a mixture with weights
proportional to g_k(x). Both are mapped to coordinates with unit exponential distributions (Rosenblatt 1952).
The inverse of the map is computed by Newton's method. A law of the family alone is the mean law of one draw.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.special import logsumexp

from accelerated_evaluation.base.arrays import Array, numbers_in
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.randomness import DRAWING
from accelerated_evaluation.laws import LAWS
from accelerated_evaluation.laws.distributions import Empirical
from accelerated_evaluation.laws.draws import Draws
from accelerated_evaluation.laws.paper.models import recorded_lead_speeds
from accelerated_evaluation.laws.protocol import Box, Law
from accelerated_evaluation.laws.smooth.conditional import Places, SpeedLaw, Threshold, range_grid, speed_grid
from accelerated_evaluation.laws.smooth.draws import Hazards, SmoothDraws, SpeedsAt
from accelerated_evaluation.laws.smooth.excess import Excess
from accelerated_evaluation.laws.smooth.far_tail import FarTail
from accelerated_evaluation.laws.smooth.mixtures import TOLERANCE, mixed, solve
from accelerated_evaluation.laws.smooth.segments import COORDINATES, CUT, floats, recorded_segments
from accelerated_evaluation.laws.smooth.smooth_hazard import SmoothHazard
from accelerated_evaluation.laws.smooth.support import Support
from accelerated_evaluation.laws.strata import Factors, StratifiedLaw, Stratum

FAR_TAIL = (
    "far tail"  # name of the factors of the hazard where only a few records are, as a source of uncertainty
)
LARGEST_LOGARITHM = 50.0  # of R_max / R; the range would otherwise underflow where few records are near


@dataclass(frozen=True)
class MeanStratum(Stratum):
    """One segment of the mean law: a `Stratum` with unit-exponential coordinates."""

    lead_speed: Empirical
    draws: SmoothDraws
    factors = COORDINATES

    @property
    def support(self) -> Support:
        """Limits of the records."""
        return self.draws.support

    def points(self, lead_speed: Array, first: Array, second: Array) -> Array:
        """Return the n cut-ins, shape (n, 3), with given v_L [m/s] and coordinates, each of shape (n,)."""
        range_, speed = np.empty(first.size), np.empty(first.size)
        farthest = self.support.range_max
        for part in self.draws.parts(first.size):
            lead = lead_speed[part]
            ranges = self.draws.ranges_at(self.places(lead, np.full(lead.size, farthest)))
            value = solve(partial(self._range_score, ranges), first[part], np.ones(lead.size))
            range_[part] = farthest * np.exp(-np.minimum(value, LARGEST_LOGARITHM))
            speeds, log_weight = self._speeds(lead, range_[part], ranges, value)
            start = self.draws.laws[0].given(self.places(lead, range_[part])).inverse(second[part])
            speed[part] = solve(
                lambda c, row, at=speeds, weight=log_weight: mixed(*at.at(c, row), weight.take(row, axis=1)),
                second[part],
                np.maximum(start, TOLERANCE),
            )
        return np.column_stack([lead_speed, range_, speed])

    @property
    def pieces(self) -> Factors:
        """The unit exponential distributions of the coordinates, each divided into two pieces.

        The knot between the pieces is the 95 % quantile.
        """
        return Factors(CUT, CUT)

    @property
    def range_max(self) -> float:
        """The largest recorded range [m]."""
        return self.support.range_max

    def first(self, lead_speed: ArrayLike, inverse_range: ArrayLike) -> Array:
        """Return the first coordinate -log P(R^-1 > r | v_L), which is infinite for an infinite r.

        The arguments are v_L [m/s] and r [1/m], of shapes that broadcast.
        """
        speed, inverse_range = np.broadcast_arrays(*floats(lead_speed, inverse_range))
        coordinate = np.full(speed.shape, math.inf)
        near = np.isfinite(inverse_range)
        coordinate[near] = self.range_coordinate(speed[near], inverse_range[near])[0]
        return coordinate

    def log_first_slope(self, lead_speed: ArrayLike, inverse_range: ArrayLike) -> Array:
        """Return the log of the derivative of the first coordinate with respect to R^-1, for fixed v_L.

        The arguments are v_L [m/s] and R^-1 [1/m], of shapes that broadcast.
        """
        speed, inverse_range = np.broadcast_arrays(*floats(lead_speed, inverse_range))
        return np.log(self.range_coordinate(speed, inverse_range)[1]) - np.log(inverse_range)

    def second(self, lead_speed: ArrayLike, inverse_range: ArrayLike, closing_speed: ArrayLike) -> Array:
        """Return the second coordinate -log P(C > c | v_L, R), which is infinite for an infinite c.

        The arguments are v_L [m/s], R^-1 [1/m] and closing speed c [m/s], of shapes that broadcast.
        """
        arrays = np.broadcast_arrays(*floats(lead_speed, inverse_range, closing_speed))
        lead, inverse_range, closing = (array.ravel() for array in arrays)
        return self.second_at(lead, inverse_range, closing[:, None]).reshape(arrays[0].shape)

    def range_coordinate(self, lead_speed: Array, inverse_range: Array) -> tuple[Array, Array]:
        """Return the first coordinate, and its derivative with respect to log(R_max / R).

        The coordinate is the cumulative hazard of log(R_max / R), where R_max is the largest range. The
        arguments are v_L [m/s] and R^-1 [1/m]. Arguments and results have shape (n,).
        """
        scores = np.empty((2, lead_speed.size))
        for part in self.draws.parts(lead_speed.size):
            places = self.places(lead_speed[part], 1 / inverse_range[part])
            scores[:, part] = self._range_score(
                self.draws.ranges_at(places), self.logarithm(inverse_range[part])
            )
        return scores[0], scores[1]

    def second_at(self, lead_speed: Array, inverse_range: Array, closing_speeds: Array) -> Array:
        """Return the second coordinate of m closing speeds for each of n pairs of v_L and R^-1.

        v_L [m/s] and R^-1 [1/m] have shape (n,). Closing speeds [m/s] and result have shape (n, m).
        """
        return self._second(lead_speed, inverse_range, closing_speeds)[0]

    def log_second_slope(self, lead_speed: Array, inverse_range: Array, closing_speed: Array) -> Array:
        """Return the log of the derivative of the second coordinate with respect to the closing speed, (n,).

        The second coordinate is the cumulative hazard of the closing speed, so its derivative is the hazard.
        """
        return np.log(self._second(lead_speed, inverse_range, closing_speed[:, None])[1, :, 0])

    def _second(self, lead_speed: Array, inverse_range: Array, closing_speeds: Array) -> Array:
        """Return the second coordinates, as `second_at`, and their derivatives, shape (2, n, m)."""
        scores = np.full((2, *closing_speeds.shape), math.inf)
        for part in self.draws.parts(lead_speed.size):
            lead, range_, closing = lead_speed[part], 1 / inverse_range[part], closing_speeds[part]
            value = self.logarithm(inverse_range[part])
            ranges = self.draws.ranges_at(self.places(lead, range_))
            speeds, log_weight = self._speeds(lead, range_, ranges, value)
            for column, speed in enumerate(closing.T):
                finite = np.isfinite(speed)
                found = mixed(*speeds.at(np.where(finite, speed, 0.0)), log_weight)
                scores[:, part, column] = np.where(finite, found, math.inf)
        return scores

    def logarithm(self, inverse_range: Array) -> Array:
        """Return log(R_max / R) for R^-1 [1/m], with the largest range R_max; 0 if R is larger than R_max."""
        return np.maximum(np.log(self.support.range_max * inverse_range), 0.0)

    def places(self, lead_speed: Array, range_: Array) -> Places:
        """Return n pairs of lead speed [m/s] and range [m], with the values of the splines there."""
        return Places.of(lead_speed, range_, self.support)

    def _range_score(
        self, ranges: Hazards, value: Array, row: NDArray[np.intp] | None = None
    ) -> tuple[Array, Array]:
        """Return -log P(X > x) at x = log(R_max / R) under the mean of the draws, and its slope, (n,)."""
        shares = np.bincount(self.draws.shared, minlength=len(self.draws.ranges)) / self.draws.size
        cumulative, rate = ranges.at(value, row)
        return mixed(cumulative, np.log(rate) - cumulative, np.log(shares[:, None]))

    def _speeds(self, lead: Array, range_: Array, ranges: Hazards, value: Array) -> tuple[SpeedsAt, Array]:
        """Return the laws of the closing speed at n places, and log weights of the draws, shape (K, n)."""
        cumulative, rate = ranges.at(value)
        log_weight = (np.log(rate) - cumulative)[self.draws.shared]
        return self.draws.speeds_at(self.places(lead, range_)), log_weight - logsumexp(log_weight, axis=0)


@LAWS.add("mean")
@dataclass(frozen=True, repr=False)
class MeanLaw(Draws, StratifiedLaw):
    """The law in which v_L is as recorded, and range and closing speed follow the mean of K draws."""

    description: str
    # Lane changes by segment, in order of speed; the conditional distributions are the same in all segments.
    counts: Mapping[str, int]
    draws: SmoothDraws = field(compare=False)
    # The recorded v_L [m/s] by segment, which are read from the encounter table and not stored in the law
    # file.
    lead_speeds: Mapping[str, Empirical] = field(compare=False)
    # Cap [m/s] above which the outcome of no vehicle changes; a few draws have very heavy tails where there
    # are no records.
    closing_speed_max: float = math.inf

    @classmethod
    def fitted(
        cls,
        draws: SmoothDraws,
        encounters: pd.DataFrame,
        description: str,
        closing_speed_max: float = math.inf,
    ) -> Self:
        """Return the mean law of draws that were fitted to an encounter table.

        ``closing_speed_max`` is a cap [m/s].
        """
        counts, lead_speeds = recorded_segments(encounters)
        return cls(description, counts, draws, lead_speeds, closing_speed_max)

    def __repr__(self) -> str:
        """Return a text that identifies the law: description, counts, digest of the draws, and cap."""
        parts = self.description, dict(self.counts), self.draws.digest, self.closing_speed_max
        return f"{type(self).__name__}{parts}"

    @property
    def strata(self) -> dict[str, MeanStratum]:
        """The distribution in each segment, by name of the segment."""
        return {segment: MeanStratum(self.lead_speeds[segment], self.draws) for segment in self.counts}

    @property
    def proposal(self) -> Law:
        """The mean law itself."""
        return self

    @property
    def law(self) -> Law:
        """The mean law itself, with the draws."""
        return self

    @property
    def support(self) -> Support:
        """Limits of the records to which the draws were fitted."""
        return self.draws.support

    @property
    def names(self) -> tuple[str, ...]:
        """Name of the member of the family of each draw."""
        return self.draws.names

    @property
    def laws(self) -> Sequence[SpeedLaw]:
        """The law of the closing speed of each draw."""
        return self.draws.laws

    @property
    def typical(self) -> SpeedLaw:
        """The law of the closing speed of a draw of the member that has most draws."""
        return self.laws[int(np.argmax(self.member == np.bincount(self.member).argmax()))]

    @checked(**DRAWING)
    def draw_from_mean(self, n: int, generator: np.random.Generator) -> Array:
        """Draw n cut-ins from the mean law, shape (n, 3)."""
        return self.draw(n, generator)

    def fixed(self) -> Mapping[str, Draws]:
        """Return the draws with the factors of the far tails at their posterior means, if these are known."""
        typical = self.draws.with_mean_far_tails()
        return {} if typical is None else {FAR_TAIL: replace(self, draws=typical)}

    def with_cap_at(self, closing_speed_max: float) -> Self:
        """Return the mean law with another cap on the closing speed [m/s]; `math.inf` is no cap."""
        return replace(self, closing_speed_max=closing_speed_max)

    def only(self, stratum: str) -> Self:
        """Return the law restricted to one segment, given by its name, whose share is then one."""
        counts, lead_speeds = {stratum: self.counts[stratum]}, {stratum: self.lead_speeds[stratum]}
        return replace(self, counts=counts, lead_speeds=lead_speeds)

    def subset(self, chosen: NDArray[np.intp]) -> Self:
        """Return the mean law of the k draws with the given indices, shape (k,)."""
        return replace(self, draws=self.draws.only(chosen))

    def from_normal_scores(self, z: Array) -> Array:
        """Map normal scores z of v_L and of the two coordinates to n cut-ins, both of shape (n, 3).

        The cut-ins of all strata are computed together, because the conditional distributions are the same.
        """
        scores = np.empty((3, len(z)))
        for here, _, *coordinates in self.in_strata(z):
            scores[:, here] = coordinates
        return self.with_cap(next(iter(self.strata.values())).points(*scores))

    def log_densities(self, x: Array) -> Array:
        """Return the log density of n cut-ins x, shape (n, 3), under each draw, shape (K, n).

        As in `log_density`, it is the density of range and closing speed given v_L. At the cap, the density
        of the closing speed is replaced by the probability of the cap.
        """
        densities, inside = np.full((self.draws.size, len(x)), -math.inf), self.box.contains(x)
        densities[:, inside] = self.draws.log_densities(x[inside], self.closing_speed_max)
        return densities

    def log_density(self, x: Array) -> Array:
        """Return the log of the mean density of the draws at n cut-ins x, shape (n, 3)."""
        return logsumexp(self.log_densities(x), axis=0) - math.log(self.draws.size)

    def log_slices(self, k: int, x: Array, low: Array, high: Array) -> Array:
        """Return the log of the integral of the density of each draw over the closing speed, shape (K, n).

        It is the density given the lead speed, and k is the index of the closing speed; see `log_slice`.
        """
        low, high = self._speed_interval(k, low, high)
        logs = self.draws.log_slices(k, x, np.where(low < high, low, 0.0), high)
        logs[:, low >= high] = -math.inf
        return logs

    def log_slice(self, k: int, x: Array, low: Array, high: Array) -> Array:
        """Return the log of the integral of the mean density of the draws; see `SlicedLaw`."""
        return logsumexp(self.log_slices(k, x, low, high), axis=0) - math.log(self.draws.size)

    @property
    def sliced(self) -> Sequence[Law]:
        """The mean law itself, which has the slices of all draws."""
        return (self,)

    def log_ratios(self, x: Array) -> Array:
        """Return the log importance weights log(f_k / f_mean) of n cut-ins for each draw k, shape (K, n).

        They are at most log K. The cut-ins must be within the limits of the law.
        """
        return self.log_ratios_to_mean(x)

    def content(self) -> dict[str, Any]:
        """Return the content of the law file: the parameters of all draws."""
        draws = self.draws
        surfaces = {law.threshold.level: law.threshold for law in draws.laws if law.threshold is not None}
        return {
            "counts": dict(self.counts),
            "support": draws.support.content(),
            "range": [{"log_hazard": ranges.coefficients.tolist()} for ranges in draws.ranges],
            "closing_speed": [{"log_hazard": body.coefficients.tolist()} for body in draws.bodies],
            "thresholds": [threshold.content() for threshold in surfaces.values()],
            "draws": [
                {"name": name, "shared": int(shared)} | _tail_content(law)
                for name, shared, law in zip(draws.names, draws.shared, draws.laws, strict=True)
            ],
        }

    @classmethod
    def from_content(cls, content: Mapping[str, Any], box: Box, records: pd.DataFrame) -> Self:
        """Build a law from the content of its file, its limits, and the records, which supply v_L."""
        support = Support.of(content["support"])
        grids = range_grid(support), speed_grid(support)
        ranges, bodies = (
            tuple(SmoothHazard(grid, numbers_in(part["log_hazard"])) for part in content[name])
            for grid, name in zip(grids, ("range", "closing_speed"), strict=True)
        )
        surfaces = {part["level"]: Threshold.from_content(part, grids[1]) for part in content["thresholds"]}
        laws = tuple(_speed_law(part, bodies, surfaces) for part in content["draws"])
        shared = np.array([part["shared"] for part in content["draws"]])
        names = tuple(part["name"] for part in content["draws"])
        draws = SmoothDraws(ranges, bodies, laws, shared, names, support)
        counts, description = content["counts"], content["description"]
        return cls(description, counts, draws, recorded_lead_speeds(records, counts), box.upper[2])


def _tail_content(law: SpeedLaw) -> dict[str, Any]:
    tail = {} if law.tail is None else {"level": law.threshold.level} | law.tail.content()
    return tail if law.far is None else tail | {"far_tail": law.far.content()}


def _speed_law(
    part: Mapping[str, Any], bodies: tuple[SmoothHazard, ...], surfaces: Mapping[float, Threshold]
) -> SpeedLaw:
    tail = Excess.from_content(part) if "shape" in part else None
    far = FarTail.from_content(part["far_tail"]) if "far_tail" in part else None
    return SpeedLaw(bodies[part["shared"]], surfaces.get(part.get("level")), tail, far)
