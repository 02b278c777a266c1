"""Draws of a law of cut-ins from its posterior, which are evaluated together, and their mixtures.

A draw is one law of the family with drawn parameters of the tail, of the body and of the distribution of the
range. The three kinds of parameters are independent in the posterior. Crashes mostly happen in the tail, so
every draw has a tail of its own. Bodies and distributions of the range are fewer, and each of them is
combined with several tails. This saves time, because only bodies and distributions of the range need tables
of cumulative hazards.
"""

import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.compiling import cached_njit
from accelerated_evaluation.laws.smooth.conditional import Places, SpeedLaw
from accelerated_evaluation.laws.smooth.family import LawFamily, Member
from accelerated_evaluation.laws.smooth.far_tail import FarTail
from accelerated_evaluation.laws.smooth.shapes import Shape
from accelerated_evaluation.laws.smooth.smooth_hazard import LOG_HAZARD_MAX, SmoothHazard
from accelerated_evaluation.laws.smooth.support import SUPPORT, Support

PLACES_AT_ONCE = 400  # limits the memory to about 100 MB with 500 draws
INTERVALS_AT_ONCE = 20_000  # divided by the number of draws, so that few draws have larger parts
SHARED = 50  # largest number of bodies and of distributions of the range


@dataclass(frozen=True)
class SmoothDraws:
    """K draws of a law of cut-ins from its posterior."""

    # Draws of the hazard of log(R_max / R); their number a is at most `SHARED`.
    ranges: tuple[SmoothHazard, ...] = field(repr=False)
    bodies: tuple[SmoothHazard, ...] = field(repr=False)  # as many draws of the body of the closing speed
    # The K laws of the closing speed; the body of each is one of `bodies`.
    laws: tuple[SpeedLaw, ...] = field(repr=False)
    shared: NDArray[np.intp] = field(repr=False)  # index of each draw into `ranges` and `bodies`, (K,)
    names: tuple[str, ...] = field(repr=False)  # name of the member of the family of each draw
    support: Support
    family: LawFamily | None = field(
        default=None, repr=False
    )  # that was drawn from; None after reading a file

    @classmethod
    def of(
        cls,
        family: LawFamily,
        members: Sequence[Member],
        support: Support,
        generator: np.random.Generator,
    ) -> Self:
        """Draw the parameters of K given members from their posteriors, after a fit to all records."""
        size = len(members)
        count = min(SHARED, size)
        ranges = tuple(family.ranges.drawn(generator) for _ in range(count))
        bodies = tuple(family.body.drawn(generator) for _ in range(count))
        shared = np.arange(size) % count
        laws = [
            family.drawn(member, generator, bodies[body])
            for member, body in zip(members, shared, strict=True)
        ]
        names = tuple(member.name for member in members)
        return cls(ranges, bodies, tuple(laws), shared, names, support, family)

    def with_mean_far_tails(self) -> Self | None:
        """Return the draws with the posterior means of the factors of the far tails, given all else.

        The result is None if the laws have no far tails, or if the family of the draws is not known.
        """
        if self.family is None or self.family.far_records is None:
            return None
        return replace(self, laws=tuple(map(self.family.with_mean_far_tail, self.laws)), family=None)

    @classmethod
    def of_laws(cls, ranges: SmoothHazard, laws: Sequence[SpeedLaw], support: Support = SUPPORT) -> Self:
        """Return laws of the closing speed with the same body as draws, all with one law of the range."""
        bodies, shared = (laws[0].body,), np.zeros(len(laws), dtype=int)
        return cls((ranges,), bodies, tuple(laws), shared, ("",) * len(laws), support)

    def parts(self, n: int) -> list[slice]:
        """Return slices that together cover n places, each with few enough of them for the memory."""
        at_once = max(PLACES_AT_ONCE, INTERVALS_AT_ONCE // self.size)
        return [slice(start, start + at_once) for start in range(0, n, at_once)]

    @property
    def size(self) -> int:
        """Number K of draws."""
        return len(self.laws)

    @cached_property
    def digest(self) -> str:
        """Digest of the parameters of all draws, as 16 hexadecimal digits."""
        tails = [(law.tail.coefficients, law.tail.parameters) for law in self.laws if law.tail is not None]
        arrays = [hazard.coefficients for hazard in (*self.ranges, *self.bodies)]
        arrays += [] if self.far is None else [self.far.levels, self.far.log_factors]
        content = hashlib.sha256(repr((self.names, self.shared.tolist())).encode())
        for array in (*arrays, *(part for tail in tails for part in tail)):
            content.update(np.ascontiguousarray(array).tobytes())
        return content.hexdigest()[:16]

    def only(self, chosen: NDArray[np.intp]) -> Self:
        """Return a set of the k draws with the given indices, shape (k,)."""
        used, shared = np.unique(self.shared[chosen], return_inverse=True)
        return replace(
            self,
            ranges=tuple(self.ranges[place] for place in used),
            bodies=tuple(self.bodies[place] for place in used),
            laws=tuple(self.laws[place] for place in chosen),
            shared=shared,
            names=tuple(self.names[place] for place in chosen),
        )

    def ranges_at(self, places: Places) -> "Hazards":
        """Return the hazards of log(R_max / R) at n lead speeds, under each of the draws in ``ranges``.

        R_max is the largest range in the limits of the records.
        """
        return Hazards.of(self._along[0], self.ranges[0].grid.edges[2], places.along_speed)

    def speeds_at(self, places: Places) -> "SpeedsAt":
        """Return the distributions of the closing speed under all K draws, given pairs of speed and range."""
        body = Hazards.of(self._along[1], self.bodies[0].grid.edges[2], places.splines)
        return SpeedsAt(self, places, body)

    def log_densities(self, x: Array, cap: float = math.inf) -> Array:
        """Return the log density of n cut-ins x, shape (n, 3), under each draw given v_L, shape (K, n).

        At the cap on the closing speed [m/s], its density is replaced by the probability of the cap.
        """
        density = np.empty((self.size, len(x)))
        for part, of_range, speeds, row in self._in_parts(x):
            hazard, of_speed = speeds.at(x[part, 2], row)
            density[:, part] = of_range + np.where(x[part, 2] >= cap, -hazard, of_speed)
        return density

    def with_cap_at(self, closing_speed_max: float) -> Self:
        """Return the draws themselves, which have no cap on the closing speed."""
        return self

    def log_slices(self, k: int, x: Array, low: Array, high: Array) -> Array:
        """Return the result of `SlicedLaw.log_slice` under each draw, shape (K, n), without a cap.

        The variable k is the closing speed, and the interval may be infinite.
        """
        logs = np.empty((self.size, len(x)))
        for part, of_range, speeds, row in self._in_parts(x):
            # Many intervals end where the next one begins, so that most hazards are needed once.
            finite, begins = np.isfinite(high[part]), low[part]
            apart = np.append((np.diff(row) != 0) | (high[part][:-1] != begins[1:]), True) & finite
            start = speeds.at(begins, row, with_density=False)[0]
            end = np.roll(start, -1, axis=1)
            end[:, apart] = speeds.at(high[part][apart], row[apart], with_density=False)[0]
            with np.errstate(divide="ignore", invalid="ignore"):
                of_speed = np.log(-np.expm1(np.where(finite, start - end, -math.inf))) - start
            # A draw may have no probability beyond a finite closing speed.
            logs[:, part] = of_range + np.where(np.isfinite(start), of_speed, -math.inf)
        return logs

    def _in_parts(self, x: Array) -> Iterator[tuple[slice, Array, "SpeedsAt", NDArray[np.intp]]]:
        """Yield parts of cut-ins x, shape (n, 3), with the log density of the range under each draw, (K, m).

        Then come the laws of the closing speed at the places of a part, and the index of the place of each
        cut-in. Cut-ins at the same place should follow each other, because the place is evaluated once.
        """
        for part in self.parts(len(x)):
            lead_speed, range_ = x[part, 0], x[part, 1]
            new = np.append(True, (np.diff(lead_speed) != 0) | (np.diff(range_) != 0))
            places, row = Places.of(lead_speed[new], range_[new], self.support), np.cumsum(new) - 1
            cumulative, rate = self.ranges_at(places).at(np.log(self.support.range_max / places.range_))
            of_range = np.log(rate) - cumulative - np.log(places.range_)
            of_range[:, places.range_ > self.support.range_max] = -math.inf
            yield part, of_range[self.shared][:, row], self.speeds_at(places), row

    @cached_property
    def _along(self) -> list[Array]:
        """The coefficients of `_along_variable` of the draws of the range, and of the bodies."""
        return [_along_variable(self.ranges), _along_variable(self.bodies)]

    @cached_property
    def far(self) -> FarTail | None:
        """The factors of the far tails of all draws; None if the laws have no far tails."""
        tails = [law.far for law in self.laws if law.far is not None]
        return FarTail.stacked(tails) if tails else None

    @cached_property
    def groups(self) -> list["Group"]:
        """The draws with a tail, grouped by the shape of the tail."""
        shapes = {law.tail.shape.name: law.tail.shape for law in self.laws if law.tail is not None}
        return [Group.of(self, shape) for shape in shapes.values()]


@dataclass(frozen=True)
class Group:
    """The k draws whose tails have the same shape."""

    shape: Shape
    index: NDArray[np.intp]  # indices of these draws among all draws, (k,)
    level: NDArray[np.intp]  # index of the threshold of each draw in `thresholds`, (k,)
    thresholds: tuple
    coefficients: Array  # of the splines of the log scale, (k, p)
    parameters: Array  # of the shape, (q, k, 1)

    @classmethod
    def of(cls, draws: SmoothDraws, shape: Shape) -> Self:
        """Return the group of those draws whose tails have the given shape."""
        index = np.array(
            [
                place
                for place, law in enumerate(draws.laws)
                if law.tail is not None and law.tail.shape.name == shape.name
            ]
        )
        laws = [draws.laws[place] for place in index]
        thresholds = {law.threshold.level: law.threshold for law in laws}
        places = {level: place for place, level in enumerate(thresholds)}
        parameters = np.array([law.tail.parameters for law in laws])
        return cls(
            shape,
            index,
            np.array([places[law.threshold.level] for law in laws]),
            tuple(thresholds.values()),
            np.array([law.tail.coefficients for law in laws]),
            parameters.reshape(len(laws), -1).T[:, :, None],
        )


@dataclass(frozen=True)
class Hazards:
    """Piecewise constant hazards of a variable under a number a of draws, given n sets of covariates."""

    edges: Array  # edges of the bins of the variable, (bins + 1,); the last bin extends to infinity
    hazard: Array  # hazard in each bin, (a, n, bins)
    table: Array  # cumulative hazard at the edges, (a, n, bins + 1)

    @classmethod
    def of(cls, along: Array, edges: Array, splines: Array) -> Self:
        """Return the hazards, given splines of the covariates, (n, p), and coefficients, (a, p, bins)."""
        hazard = splines @ along
        np.exp(np.clip(hazard, -LOG_HAZARD_MAX, LOG_HAZARD_MAX, out=hazard), out=hazard)
        return cls(edges, hazard, _integrated(hazard, np.diff(edges)))

    def at(self, value: Array, row: NDArray[np.intp] | None = None) -> tuple[Array, Array]:
        """Return cumulative hazard and hazard, both (a, n), at one value for each set of covariates.

        With ``row``, shape (n,), value i belongs to the set of covariates with the index ``row[i]``.
        """
        bin_ = np.clip(np.searchsorted(self.edges, value, side="right") - 1, 0, self.edges.size - 2)
        row = np.arange(value.size) if row is None else row
        rate = self.hazard[:, row, bin_]
        return self.table[:, row, bin_] + rate * (value - self.edges[bin_]), rate


@cached_njit()
def _integrated(hazard: Array, widths: Array) -> Array:
    """Return the cumulative hazard at the edges of bins with given widths, which is 0 at the first edge.

    NumPy's `cumsum` along the last of three axes takes four times as long.
    """
    draws, rows, bins = hazard.shape
    table = np.zeros((draws, rows, bins + 1))
    for draw in range(draws):
        for row in range(rows):
            for k in range(bins):
                table[draw, row, k + 1] = table[draw, row, k] + hazard[draw, row, k] * widths[k]
    return table


class SpeedsAt:
    """Distributions of the closing speed under each of K draws, given n pairs of lead speed and range."""

    def __init__(self, draws: SmoothDraws, places: Places, body: Hazards) -> None:
        self.draws, self.body, self._tails = draws, body, []
        self._far = None if draws.far is None else draws.far.at(places.splines)
        for group in draws.groups:
            surfaces = [threshold(places.lead_speed, places.range_) for threshold in group.thresholds]
            reached = np.array([body.at(surface)[0] for surface in surfaces])
            self._tails.append(
                (
                    group,
                    np.array(surfaces)[group.level],
                    reached[group.level, draws.shared[group.index]],
                    group.coefficients @ places.splines.T,
                )
            )

    def at(
        self, closing_speed: Array, row: NDArray[np.intp] | None = None, *, with_density: bool = True
    ) -> tuple[Array, Array]:
        """Return -log P(C > c) and the log density, both (K, n), at one closing speed c [m/s] for each pair.

        With ``row``, there is one closing speed for each pair of that index.
        """
        cumulative, rate = self.body.at(closing_speed, row)
        cumulative = cumulative[self.draws.shared]
        log_density = np.log(rate)[self.draws.shared] - cumulative if with_density else np.empty(0)
        for group, *of_places in self._tails:
            threshold, reached, log_scale = (
                values if row is None else values.take(row, axis=1) for values in of_places
            )
            above = closing_speed > threshold
            z = np.maximum(closing_speed - threshold, 0) * np.exp(-log_scale)
            tail = reached + group.shape.cumulative(z, group.parameters)
            cumulative[group.index] = np.where(above, tail, cumulative[group.index])
            if with_density:
                density = group.shape.log_density(z, group.parameters) - log_scale - reached
                log_density[group.index] = np.where(above, density, log_density[group.index])
        if self._far is None:
            return cumulative, log_density
        far = self._far.only(row)
        if with_density:
            log_density += far.log_density_ratio(cumulative)
        return far.cumulative(cumulative), log_density


def _along_variable(hazards: Sequence[SmoothHazard]) -> Array:
    """Return, for each bin of the variable, the coefficients of the log hazard, shape (a, p, bins).

    They are the coefficients of the p splines of the covariates.
    """
    parts = [np.tensordot(hazard.coefficients, hazard.grid.tensor.matrices[2], (2, 1)) for hazard in hazards]
    return np.array([part.reshape(-1, part.shape[2]) for part in parts])
