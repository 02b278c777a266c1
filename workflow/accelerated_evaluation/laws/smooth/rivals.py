"""Alternative laws of the closing speed: TTC^-1 independent of the range, and conditional extremes.

The family of smooth laws is compared with these laws. Each class has a method ``fit``, which takes records,
and a method ``given(places)``, which returns the distribution of the closing speed at given lead speeds and
ranges.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import ConvergenceError
from accelerated_evaluation.laws.paper.piecewise import usable_knots
from accelerated_evaluation.laws.smooth.conditional import Given, Places, SpeedLaw
from accelerated_evaluation.laws.smooth.excess import Excess, fit_excess
from accelerated_evaluation.laws.smooth.family import FEWEST, DistinctRecords
from accelerated_evaluation.laws.smooth.shapes import Shape
from accelerated_evaluation.laws.smooth.smooth_hazard import SmoothHazard
from accelerated_evaluation.laws.smooth.splines import Constant, Penalty
from accelerated_evaluation.records.segments import MINIMUM_ROWS

BODY_BINS = 200  # number of bins of the histogram of TTC^-1 below the knot
LATTICE = np.linspace(0, 30, 121)  # [m/s], grid of excesses on which conditional extremes are tabulated
PLACES_AT_ONCE = 20_000


@dataclass(frozen=True)
class IndependentTail:
    """A law in which TTC^-1 is independent of the range; in each segment it has a histogram and a tail.

    Attributes
    ----------
    edges, densities
        Bins of TTC^-1 [1/s] below the knot, and the density in them, by segment.
    level
        Probability that TTC^-1 is below the knot.
    tails
        Distribution of the excess of TTC^-1 over the knot, by segment.
    between
        Lead speeds at which the segments meet [m/s].
    """

    edges: list[Array]
    densities: list[Array]
    level: float
    tails: list[Excess]
    between: tuple[float, ...]

    @classmethod
    def fit(cls, records: DistinctRecords, level: float, shape: Shape) -> "IndependentTail":
        """Return the law with a histogram and a tail of TTC^-1 fitted in each segment of the lead speed.

        A segment with fewer than `MINIMUM_ROWS` records gets the distribution of all records. A knot that too
        few records exceed is moved as little as necessary.

        Parameters
        ----------
        records
            Distinct cut-ins.
        level
            Level of the quantile at which the knot is placed.
        shape
            Shape of the excess over the knot.
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
    """Distributions of the closing speed given n pairs of lead speed and range, under `IndependentTail`.

    Attributes
    ----------
    law
        The law.
    segment, range_
        Index of the segment, and range [m], of each pair, shape (n,).
    """

    law: IndependentTail
    segment: Array
    range_: Array

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


@dataclass(frozen=True)
class ConditionalExtremes:
    """Conditional extremes (Heffernan and Tawn 2004): range and speed given an extreme closing speed.

    Above one common threshold, the excess of the closing speed has one of the distributions in `SHAPES`.
    Given the excess, the lead speed and the square root of the range are jointly normal, with means that are
    linear in the excess and its square root. Bayes' rule gives the distribution of the closing speed given
    lead speed and range. A smooth body describes closing speeds below the threshold, and the probability of
    exceeding the threshold.

    Attributes
    ----------
    body
        Smooth hazard of the closing speed.
    threshold
        Threshold of the closing speed [m/s].
    tail
        Distribution of the excess [m/s].
    slopes
        Coefficients of the regression of lead speed and root of the range on the excess, shape (3, 2).
    precision
        Inverse of the covariance matrix of the residuals, shape (2, 2).
    """

    body: SmoothHazard
    threshold: float
    tail: Excess
    slopes: Array
    precision: Array

    @classmethod
    def fit(
        cls, records: DistinctRecords, body: SmoothHazard, level: float, shape: Shape
    ) -> "ConditionalExtremes":
        """Return the law fitted to the records whose closing speed is above a quantile.

        Parameters
        ----------
        records
            Distinct cut-ins.
        body
            Smooth hazard of the closing speed, fitted to the same records.
        level
            Level of the quantile of all closing speeds that is the threshold.
        shape
            Shape of the excess over the threshold.

        Raises
        ------
        ConvergenceError
            If fewer than `FEWEST` records exceed the threshold.
        """
        threshold = float(np.quantile(records.closing_speed, level))
        above = records.closing_speed > threshold
        if above.sum() < FEWEST:
            raise ConvergenceError(
                "conditional extremes",
                reached=f"{above.sum()} records above the threshold",
                limit=f"{FEWEST}",
                change="Add records.",
            )
        excess = records.closing_speed[above] - threshold
        tail = fit_excess(excess, np.ones((excess.size, 1)), Penalty.of([Constant()]), shape)
        covariates = np.column_stack([records.lead_speed, np.sqrt(records.range_)])[above]
        slopes = np.linalg.lstsq(_regressors(excess), covariates)[0]
        residuals = covariates - _regressors(excess) @ slopes
        return cls(body, threshold, tail, slopes, np.linalg.inv(np.cov(residuals.T)))

    def given(self, places: Places) -> "GivenExtremes":
        """Return the distributions of the closing speed given n pairs of lead speed and range.

        Above the threshold, the density of the closing speed is computed on a grid of excesses by Bayes'
        rule.
        """
        scale = float(np.exp(self.tail.coefficients[0]))
        prior = self.tail.shape.log_density(LATTICE / scale, self.tail.parameters)
        means = _regressors(LATTICE) @ self.slopes
        covariates = np.column_stack([places.lead_speed, np.sqrt(places.range_)])
        table = np.empty((len(covariates), LATTICE.size))
        for first in range(0, len(covariates), PLACES_AT_ONCE):
            part = slice(first, first + PLACES_AT_ONCE)
            away = covariates[part, None, :] - means
            table[part] = prior - np.einsum("nki,ij,nkj->nk", away, self.precision, away) / 2
        table -= logsumexp(table, axis=1, keepdims=True) + np.log(LATTICE[1])
        body = SpeedLaw(self.body).given(places)
        threshold = np.full(len(covariates), self.threshold)
        return GivenExtremes(body, threshold, body.cumulative(threshold), table)


def _regressors(excess: Array) -> Array:
    """Return the design matrix of the regression on the excess, shape (n, 3)."""
    return np.column_stack([np.ones(excess.size), excess, np.sqrt(excess)])


@dataclass(frozen=True)
class GivenExtremes:
    """Distributions of the closing speed given n pairs of lead speed and range, under `ConditionalExtremes`.

    Attributes
    ----------
    body
        Conditional distributions below the threshold.
    threshold, at_threshold
        Threshold [m/s], and cumulative hazard of the body at the threshold, each of shape (n,).
    table
        Log density of the excess at the nodes of `LATTICE`, shape (n, nodes).
    """

    body: Given
    threshold: Array
    at_threshold: Array
    table: Array

    def cumulative(self, closing_speed: Array) -> Array:
        """Return the cumulative hazard -log P(C > c) at a closing speed c [m/s] for each pair, (n,)."""
        low, share = self._place(closing_speed)
        beyond = np.cumsum(np.exp(self.table[:, ::-1]), axis=1)[:, ::-1] * LATTICE[1]
        row = np.arange(low.size)
        left = (1 - share) * beyond[row, low] + share * beyond[row, low + 1]
        above = self.at_threshold - np.log(np.maximum(left, 1e-300))
        return np.where(closing_speed > self.threshold, above, self.body.cumulative(closing_speed))

    def log_density(self, closing_speed: Array) -> Array:
        """Return the log density of the closing speed at one value [m/s] for each pair, shape (n,)."""
        low, share = self._place(closing_speed)
        row = np.arange(low.size)
        above = (1 - share) * self.table[row, low] + share * self.table[row, low + 1] - self.at_threshold
        return np.where(closing_speed > self.threshold, above, self.body.log_density(closing_speed))

    def _place(self, closing_speed: Array) -> tuple[Array, Array]:
        place = np.clip((closing_speed - self.threshold) / LATTICE[1], 0, LATTICE.size - 1.001)
        low = place.astype(int)
        return low, place - low
