"""Distributions of the closing speed given lead speed and range, with a smooth body and a parametric tail.

The body is a smooth hazard. A threshold is the surface u(v_L, R) that the body exceeds with a fixed
probability. Above the threshold, the excess has a parametric distribution whose scale depends on range and
lead speed. With the cumulative hazard Lambda_0 of the body, the cumulative hazard of the law is

    Lambda(c) = Lambda_0(c)                            up to u,
    Lambda(c) = Lambda_0(u) + H((c - u) / scale)       above u.

Here H is the cumulative hazard of the excess in units of its scale. Body and tail have no common parameters.
Therefore the likelihood is the product of their likelihoods, and they are independent in the posterior. Where
only a few records are, the hazard is multiplied by the factors of a `FarTail`. The second coordinate of a
cut-in, which has a unit exponential distribution, is the cumulative hazard with these factors.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from accelerated_evaluation.base.arrays import Array, Chosen, numbers_in
from accelerated_evaluation.laws.smooth.excess import Excess
from accelerated_evaluation.laws.smooth.far_tail import FarTail, Layers
from accelerated_evaluation.laws.smooth.smooth_hazard import Cumulative, HazardGrid, SmoothHazard
from accelerated_evaluation.laws.smooth.splines import Basis, Constant
from accelerated_evaluation.laws.smooth.support import SUPPORT, Support

SPEED_BINS = (30, 24)  # numbers of bins of the lead speed and of the square root of the range
SPEED_STEP = 0.5  # [m/s], width of the bins of the closing speed
RANGE_BINS = (30, 100)  # numbers of bins of the lead speed and of log(R_max / R)
SPEED_SEGMENTS, RANGE_SEGMENTS = 9, 12  # numbers of segments of the splines


def speed_grid(support: Support = SUPPORT) -> HazardGrid:
    """Return the grid for a smooth hazard of the closing speed given the lead speed and the range.

    The covariates of the grid are the lead speed and the square root of the range.
    """
    edges = [
        np.linspace(basis.low, basis.high, count + 1)
        for basis, count in zip(support.bases, SPEED_BINS, strict=True)
    ]
    speeds = np.arange(0, support.closing_top + SPEED_STEP / 2, SPEED_STEP)
    return HazardGrid((*edges, speeds), (*support.bases, Basis(0.0, support.closing_top, SPEED_SEGMENTS)))


def range_grid(support: Support = SUPPORT) -> HazardGrid:
    """Return the grid for a smooth hazard of the range given the lead speed.

    The variable of the grid is log(R_max / R), where R_max is the largest range in the limits of the records.
    """
    top, (of_speed, of_range) = support.log_range_top, RANGE_BINS
    speeds, ranges = np.linspace(*support.lead_speeds, of_speed + 1), np.linspace(0, top, of_range + 1)
    bases = support.bases[0], Constant(), Basis(0.0, top, RANGE_SEGMENTS)
    return HazardGrid((speeds, np.array([0.0, 1.0]), ranges), bases)


@dataclass(frozen=True)
class Places:
    """Pairs of lead speed and range with the values of the splines, which are computed once for many laws."""

    lead_speed: Array  # m/s, (n,)
    range_: Array  # m, (n,)
    along_speed: Array  # values of the p splines of the lead speed, (n, p)
    splines: Array  # their products with the q splines of the square root of the range, (n, p q)

    @classmethod
    def of(cls, lead_speed: ArrayLike, range_: ArrayLike, support: Support = SUPPORT) -> "Places":
        """Return the pairs of lead speeds [m/s] and ranges [m], each of shape (n,), with their splines."""
        lead_speed, range_ = np.asarray(lead_speed, dtype=float), np.asarray(range_, dtype=float)
        along_speed, along_range = support.bases[0](lead_speed), support.bases[1](np.sqrt(range_))
        splines = (along_speed[:, :, None] * along_range[:, None, :]).reshape(
            lead_speed.size, along_speed.shape[1] * along_range.shape[1]
        )
        return cls(lead_speed, range_, along_speed, splines)

    def only(self, chosen: Chosen) -> "Places":
        """Return the pairs that an index array or a mask selects, with the values of their splines."""
        return Places(
            *(getattr(self, name)[chosen] for name in ("lead_speed", "range_", "along_speed", "splines"))
        )

    def body(self, body: SmoothHazard) -> Cumulative:
        """Return the cumulative hazard of the closing speed at the lead speed and range of each place.

        ``body`` is a smooth hazard of the closing speed given lead speed and range.
        """
        return body.cumulative(self.splines)

    def range_hazards(self, ranges: SmoothHazard) -> Cumulative:
        """Return the cumulative hazard of log(R_max / R) at the lead speed of each place.

        ``ranges`` is the smooth hazard of log(R_max / R), where R_max is the largest range.
        """
        return ranges.cumulative(self.along_speed)


@dataclass(frozen=True)
class Threshold:
    """The threshold: a quantile of the closing speed as a function of lead speed and root of the range.

    The function is interpolated bilinearly between nodes.
    """

    level: float  # probability of closing speeds below it under the body from which it was computed
    lead_speeds: Array  # nodes [m/s], equally spaced
    roots: Array  # Nodes: square roots of ranges, equally spaced
    table: Array  # closing speeds [m/s] at the nodes, (lead speeds, roots)

    @classmethod
    def of(cls, body: SmoothHazard, level: float, support: Support = SUPPORT) -> "Threshold":
        """Return the threshold, computed as a quantile of the body at all nodes of lead speed and range."""
        nodes = body.grid.edges[:2]
        speeds, roots = (x.ravel() for x in np.meshgrid(*nodes, indexing="ij"))
        table = Places.of(speeds, roots**2, support).body(body).inverse(-np.log1p(-level))
        return cls(level, *nodes, table.reshape(nodes[0].size, nodes[1].size))

    def __call__(self, lead_speed: ArrayLike, range_: ArrayLike) -> Array:
        """Return the threshold [m/s] for lead speeds [m/s] and ranges [m], shape (n,).

        It is constant beyond the nodes.
        """
        (i, a), (j, b) = (
            _between(nodes, x)
            for nodes, x in ((self.lead_speeds, np.asarray(lead_speed)), (self.roots, np.sqrt(range_)))
        )
        low = (1 - b) * self.table[i, j] + b * self.table[i, j + 1]
        high = (1 - b) * self.table[i + 1, j] + b * self.table[i + 1, j + 1]
        return (1 - a) * low + a * high

    def content(self) -> dict[str, Any]:
        """Return the content of the law file: level, unit and table."""
        return {"level": self.level, "unit": "m/s", "table": self.table.tolist()}

    @classmethod
    def from_content(cls, content: Mapping[str, Any], grid: HazardGrid) -> "Threshold":
        """Build a threshold from the value that `content` returned.

        The nodes are the edges of the bins of lead speed and root of the range in the grid.
        """
        table, nodes = numbers_in(content["table"]), grid.edges[:2]
        if table.shape != tuple(map(len, nodes)):
            raise ValueError(f"a table of thresholds of shape {table.shape}")
        return cls(float(content["level"]), *nodes, table)


def _between(nodes: Array, x: Array) -> tuple[Array, Array]:
    """Return the index of the node below each value, and the position (0 to 1) between it and the next."""
    step = (nodes[-1] - nodes[0]) / (nodes.size - 1)
    place = np.clip((x - nodes[0]) / step, 0, nodes.size - 1)
    low = np.minimum(place.astype(int), nodes.size - 2)
    return low, place - low


@dataclass(frozen=True)
class SpeedLaw:
    """A distribution of the closing speed given lead speed and range: a body, optionally with a tail.

    The tail is the distribution of the excess over the threshold, and ``far`` are the factors of the hazard
    where only a few records are.
    """

    body: SmoothHazard
    threshold: Threshold | None = None
    tail: Excess | None = None
    far: FarTail | None = None

    def given(self, places: Places, below: Cumulative | None = None) -> "Given":
        """Return the distributions of the closing speed given n pairs of lead speed and range.

        If the cumulative hazards of the body at these pairs are known, they are taken from ``below``.
        """
        below = places.body(self.body) if below is None else below
        far = None if self.far is None else self.far.at(places.splines)
        if self.tail is None:
            return Given(below, far=far)
        threshold = self.threshold(places.lead_speed, places.range_)
        return Given(below, threshold, self.tail.scale(places.splines), self.tail, far)

    def drawn(self, generator: np.random.Generator, body: SmoothHazard | None = None) -> "SpeedLaw":
        """Return a law with body and tail drawn from their posteriors, which are independent.

        A body that has already been drawn may be given. The far tail is not drawn; see `LawFamily.drawn`.
        """
        body = self.body.drawn(generator) if body is None else body
        tail = None if self.tail is None else self.tail.drawn(generator)
        return replace(self, body=body, tail=tail)


@dataclass(frozen=True)
class Given:
    """Distributions of the closing speed given n pairs of lead speed and range, under a `SpeedLaw`."""

    below: Cumulative  # cumulative hazards of the body
    # Threshold and scale of a tail [m/s], each of shape (n,).
    threshold: Array = field(default_factory=partial(np.empty, 0))
    scale: Array = field(default_factory=partial(np.empty, 0))
    tail: Excess | None = None
    far: Layers | None = None  # factors of the hazard, (layers, n)

    @cached_property
    def at_threshold(self) -> Array:
        """Cumulative hazard of the body at the threshold, shape (n,)."""
        return self.below.at(self.threshold)

    def cumulative(self, closing_speed: Array, row: NDArray[np.intp] | None = None) -> Array:
        """Return -log P(C > c) at one closing speed c [m/s] for each pair (of index ``row``), (n,)."""
        finite = np.isfinite(closing_speed)
        speed = closing_speed if finite.all() else np.where(finite, closing_speed, 0.0)
        if self.tail is None:
            value = self.below.at(speed, row)
        else:
            threshold, scale = (x if row is None else x[row] for x in (self.threshold, self.scale))
            z = np.maximum(speed - threshold, 0) / scale
            value = self.below.at(np.minimum(speed, threshold), row)
            value += self.tail.shape.cumulative(z, self.tail.parameters)
        value = value if self.far is None else self.far.only(row).cumulative(value)
        return value if speed is closing_speed else np.where(finite, value, np.inf)

    def cumulative_at(self, closing_speeds: Array, part: slice) -> Array:
        """Return -log P(C > c) for a slice of k pairs at the same m closing speeds [m/s], shape (m, k).

        The closing speeds are finite and rise. With a small k the arrays stay in the cache of the processor.
        """
        value = self._original_at(closing_speeds, part)
        return value if self.far is None else self.far.only(part).cumulative(value)

    def _original_at(self, closing_speeds: Array, part: slice) -> Array:
        """Return the same as `cumulative_at`, but without the factors of the far tail."""
        if self.tail is None:
            return self.below.at_all(closing_speeds, part)
        threshold, scale = self.threshold[part], self.scale[part]
        excess = closing_speeds[:, None] - threshold
        value = np.broadcast_to(self.at_threshold[part], excess.shape).copy()
        low = slice(0, int(np.searchsorted(closing_speeds, threshold.max(initial=0.0))))
        body = self.below.at_all(closing_speeds[low], part)
        np.copyto(value[low], body, where=excess[low] < 0)
        z = np.maximum(excess, 0, out=excess)
        z /= scale
        value += self.tail.shape.cumulative(z, self.tail.parameters)
        return value

    def log_density(self, closing_speed: Array) -> Array:
        """Return the log density of the closing speed at one value [m/s] for each pair, shape (n,)."""
        density = np.log(self.below.rate(closing_speed)) - self.below.at(closing_speed)
        if self.tail is not None:
            z = np.maximum(closing_speed - self.threshold, 0) / self.scale
            above = self.tail.shape.log_density(z, self.tail.parameters) - np.log(self.scale)
            density = np.where(closing_speed > self.threshold, above - self.at_threshold, density)
        if self.far is None:
            return density
        original = replace(self, far=None).cumulative(closing_speed)
        return density + self.far.log_density_ratio(original)

    def inverse(self, level: ArrayLike) -> Array:
        """Return the closing speed [m/s] at which the cumulative hazard reaches a level, for each pair."""
        level = np.broadcast_to(np.asarray(level, dtype=float), len(self.below.table))
        level = level if self.far is None else self.far.original(level)
        if self.tail is None:
            return self.below.inverse(level)
        above = np.maximum(level - self.at_threshold, 0)
        tail = self.threshold + self.scale * self.tail.shape.inverse(above, self.tail.parameters)
        return np.where(above > 0, tail, self.below.inverse(np.minimum(level, self.at_threshold)))
