"""Conditional extremes: a law of the closing speed with one common threshold."""

from dataclasses import dataclass

import numpy as np
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import ConvergenceError
from accelerated_evaluation.laws.smooth.conditional import Given, Places, SpeedLaw
from accelerated_evaluation.laws.smooth.excess import Excess, fit_excess
from accelerated_evaluation.laws.smooth.family import FEWEST, DistinctRecords
from accelerated_evaluation.laws.smooth.shapes import Shape
from accelerated_evaluation.laws.smooth.smooth_hazard import SmoothHazard
from accelerated_evaluation.laws.smooth.splines import Constant, Penalty
from scipy.special import logsumexp

LATTICE = np.linspace(0, 30, 121)  # [m/s], grid of excesses on which the density is tabulated
PLACES_AT_ONCE = 20_000


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
