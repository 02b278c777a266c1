"""The paper's law of the closing speed, with which laws with dependence are compared."""

from dataclasses import dataclass

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.paper.piecewise import usable_knots
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.excess import Excess, fit_excess
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.shapes import Shape
from accelerated_evaluation.laws.smooth.splines import Constant, Penalty
from accelerated_evaluation.records.segments import MINIMUM_ROWS

BODY_BINS = 200  # number of bins of the histogram of TTC^-1 below the knot


@dataclass(frozen=True)
class IndependentTail:
    """A law in which TTC^-1 is independent of the range; in each segment it has a histogram and a tail."""

    edges: list[Array]  # bins of TTC^-1 [1/s] below the knot, by segment
    densities: list[Array]  # the density in the bins, by segment
    level: float  # probability that TTC^-1 is below the knot
    tails: list[Excess]  # of the excess of TTC^-1 over the knot, by segment
    between: tuple[float, ...]  # lead speeds at which the segments meet [m/s]

    @classmethod
    def fit(cls, records: DistinctRecords, level: float, shape: Shape) -> "IndependentTail":
        """Return the law with a histogram and a tail of TTC^-1 fitted in each segment of the lead speed.

        A segment with fewer than `MINIMUM_ROWS` records gets the distribution of all records. A knot that too
        few records exceed is moved as little as necessary. The knot is the quantile of the given level.
        """
        inverse_ttc, between = records.closing_speed / records.range_, records.support.segment_edges
        segment = np.digitize(records.lead_speed, between)
        edges, densities, tails = [], [], []
        for number in range(len(between) + 1):
            x = inverse_ttc[segment == number]
            x = inverse_ttc if x.size < MINIMUM_ROWS else x
            (knot,) = usable_knots(x, [float(np.quantile(x, level))])
            density, edge = np.histogram(x[x <= knot], BODY_BINS, range=(0, knot), density=True)
            excess = x[x > knot] - knot
            ones = np.ones((excess.size, 1))
            edges.append(edge)
            densities.append(level * np.maximum(density, 1e-12))
            tails.append(fit_excess(excess, ones, Penalty.of([Constant()]), shape))
        return cls(edges, densities, level, tails, between)

    def given(self, places: Places) -> "GivenIndependent":
        """Return the distributions of the closing speed given n pairs of lead speed and range."""
        return GivenIndependent(self, np.digitize(places.lead_speed, self.between), places.range_)


@dataclass(frozen=True)
class GivenIndependent:
    """Distributions of the closing speed given n pairs of lead speed and range, under `IndependentTail`."""

    law: IndependentTail
    segment: Array  # index of the segment of each pair, (n,)
    range_: Array  # m, (n,)

    def cumulative(self, closing_speed: Array) -> Array:
        """Return the cumulative hazard -log P(C > c) at a closing speed c [m/s] for each pair, (n,)."""
        return self._each(closing_speed)[0]

    def log_density(self, closing_speed: Array) -> Array:
        """Return the log density of the closing speed at one value [m/s] for each pair, shape (n,)."""
        return self._each(closing_speed)[1] - np.log(self.range_)

    def _each(self, closing_speed: Array) -> tuple[Array, Array]:
        x = closing_speed / self.range_
        cumulative, density = np.empty(x.size), np.empty(x.size)
        for number, (edges, heights, tail) in enumerate(
            zip(self.law.edges, self.law.densities, self.law.tails, strict=True)
        ):
            here = self.segment == number
            value, knot, scale = x[here], edges[-1], float(np.exp(tail.coefficients[0]))
            inside = np.clip(np.searchsorted(edges, value, side="right") - 1, 0, heights.size - 1)
            sums = np.concatenate([[0.0], np.cumsum(heights * np.diff(edges))])
            below = np.minimum(
                sums[inside] + heights[inside] * (np.minimum(value, knot) - edges[inside]), self.law.level
            )
            z, out = np.maximum(value - knot, 0) / scale, -np.log1p(-self.law.level)
            above = value > knot
            cumulative[here] = np.where(
                above, out + tail.shape.cumulative(z, tail.parameters), -np.log1p(-below)
            )
            upper = tail.shape.log_density(z, tail.parameters) - out - np.log(scale)
            density[here] = np.where(above, upper, np.log(heights[inside]))
        return cumulative, density
