"""Whole-body regressions of the closing speed: gamma, Weibull, lognormal, and two kinds of drivers.

Scale and shape are smooth functions of lead speed and range, on the splines that the scale of the excess
uses. They are rivals of the laws with a threshold: the bulk of the records decides their parameters, so
they show what that costs in the tail. Covariates are taken at the middles of cells, so that a step costs
little more than one pass over the records.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import digamma, expit, gammaincc, gammaln, log_ndtr, logit

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.conditional import Places, speed_grid
from accelerated_evaluation.laws.smooth.family import DistinctRecords

SMOOTHING = (1.0, 1.0)  # of scale and shape, along lead speed and range
SLOWEST = 1e-4  # [m/s], closing speeds below are taken as this: a power of zero has no logarithm
SMALLEST = 1e-300


@dataclass(frozen=True)
class Regression:
    """A family of laws with a log scale, a log shape and numbers shared by all.

    Attributes
    ----------
    name
        What it is called.
    log_density
        Function of closing speed, log scale, log shape and the shared numbers that returns the log density
        and its derivatives by the three.
    log_survival
        Function of the same that returns log P(C > c).
    shared
        Where the shared numbers start.
    """

    name: str
    log_density: Callable[[Array, Array, Array, Array], tuple[Array, Array, Array, list[Array]]]
    log_survival: Callable[[Array, Array, Array, Array], Array]
    shared: tuple[float, ...] = ()


def _weibull_terms(c: Array, log_scale: Array, log_shape: Array) -> tuple[Array, Array, Array]:
    shape, x = np.exp(log_shape), np.log(c) - log_scale
    power = np.exp(shape * x)
    return log_shape - np.log(c) + shape * x - power, shape * (power - 1), 1 + shape * x * (1 - power)


def _weibull(c: Array, log_scale: Array, log_shape: Array, shared: Array) -> tuple[Array, Array, Array, list]:
    return *_weibull_terms(c, log_scale, log_shape), []


def _weibull_survival(c: Array, log_scale: Array, log_shape: Array, shared: Array) -> Array:
    return -np.exp(np.exp(log_shape) * (np.log(c) - log_scale))


def _gamma(c: Array, log_scale: Array, log_shape: Array, shared: Array) -> tuple[Array, Array, Array, list]:
    shape, x = np.exp(log_shape), np.log(c) - log_scale
    value = shape * x - np.exp(x) - np.log(c) - gammaln(shape)
    return value, np.exp(x) - shape, shape * (x - digamma(shape)), []


def _gamma_survival(c: Array, log_scale: Array, log_shape: Array, shared: Array) -> Array:
    return np.log(np.maximum(gammaincc(np.exp(log_shape), np.exp(np.log(c) - log_scale)), SMALLEST))


def _lognormal(
    c: Array, log_scale: Array, log_shape: Array, shared: Array
) -> tuple[Array, Array, Array, list]:
    precision = np.exp(log_shape)
    z = (np.log(c) - log_scale) * precision
    value = log_shape - np.log(c) - z**2 / 2 - np.log(2 * np.pi) / 2
    return value, z * precision, 1 - z**2, []


def _lognormal_survival(c: Array, log_scale: Array, log_shape: Array, shared: Array) -> Array:
    return log_ndtr(-(np.log(c) - log_scale) * np.exp(log_shape))


def _two_kinds(
    c: Array, log_scale: Array, log_shape: Array, shared: Array
) -> tuple[Array, Array, Array, list]:
    share, ratio, step = shared
    first, second = (_weibull_terms(c, log_scale + a, log_shape + b) for a, b in ((0.0, 0.0), (ratio, step)))
    parts = np.log(expit(-share)) + first[0], np.log(expit(share)) + second[0]
    value = np.logaddexp(*parts)
    other = np.exp(parts[1] - value)
    mixed = [(1 - other) * first[k] + other * second[k] for k in (1, 2)]
    return value, *mixed, [other - expit(share), other * second[1], other * second[2]]


def _two_kinds_survival(c: Array, log_scale: Array, log_shape: Array, shared: Array) -> Array:
    share, ratio, step = shared
    parts = (
        _weibull_survival(c, log_scale + a, log_shape + b, shared) for a, b in ((0.0, 0.0), (ratio, step))
    )
    first, second = parts
    return np.logaddexp(np.log(expit(-share)) + first, np.log(expit(share)) + second)


REGRESSIONS = (
    Regression("gamma", _gamma, _gamma_survival),
    Regression("Weibull", _weibull, _weibull_survival),
    Regression("lognormal", _lognormal, _lognormal_survival),
    Regression("two kinds of drivers", _two_kinds, _two_kinds_survival, (float(logit(0.1)), 0.5, -0.2)),
)


@dataclass(frozen=True)
class FittedRegression:
    """Coefficients of log scale and log shape, shape (2, p), and the shared numbers."""

    regression: Regression
    coefficients: Array
    shared: Array

    def given(self, places: Places) -> "GivenRegression":
        """Return the law at places."""
        return GivenRegression(
            self.regression, *(places.splines @ part for part in self.coefficients), self.shared
        )


@dataclass(frozen=True)
class GivenRegression:
    """The law of the closing speed at n places, with log scales and log shapes of shape (n,)."""

    regression: Regression
    log_scale: Array
    log_shape: Array
    shared: Array

    def log_density(self, closing_speed: Array) -> Array:
        """Return the log density at closing speeds, one a place."""
        c = np.maximum(closing_speed, SLOWEST)
        return self.regression.log_density(c, self.log_scale, self.log_shape, self.shared)[0]

    def cumulative(self, closing_speed: Array) -> Array:
        """Return -log P(C > c), one a place."""
        c = np.maximum(closing_speed, SLOWEST)
        return -self.regression.log_survival(c, self.log_scale, self.log_shape, self.shared)


def fit_regression(
    regression: Regression, records: DistinctRecords, start: FittedRegression | None = None
) -> FittedRegression:
    """Fit by penalised maximum likelihood.

    Parameters
    ----------
    regression
        The family.
    records
        Distinct cut-ins.
    start
        An earlier fit to start from.
    """
    cell, splines = _cells(records)
    p, c = splines.shape[1], np.maximum(records.closing_speed, SLOWEST)
    precision = records.support.penalty.total(SMOOTHING)

    def negative(values: Array) -> tuple[float, Array]:
        scale, shape = values[:p], values[p : 2 * p]
        terms = regression.log_density(c, (splines @ scale)[cell], (splines @ shape)[cell], values[2 * p :])
        value, *slopes, shared = terms
        total = -value.sum() + (scale @ precision @ scale + shape @ precision @ shape) / 2
        sums = [np.bincount(cell, slope, len(splines)) @ splines for slope in slopes]
        gradient = [
            precision @ scale - sums[0],
            precision @ shape - sums[1],
            [-part.sum() for part in shared],
        ]
        return float(total) / c.size, np.concatenate(gradient) / c.size

    first = np.concatenate([np.full(p, np.log(c.mean())), np.zeros(p), regression.shared])
    if start is not None:
        first = np.concatenate([*start.coefficients, start.shared])
    found = minimize(negative, first, jac=True, method="L-BFGS-B", options={"maxiter": 300, "ftol": 1e-10})
    return FittedRegression(regression, found.x[: 2 * p].reshape(2, p), found.x[2 * p :])


def _cells(records: DistinctRecords) -> tuple[NDArray[np.intp], Array]:
    """Return the cell of each event, and the splines at the middles of the cells."""
    edges = speed_grid(records.support).edges[:2]
    values = records.lead_speed, np.sqrt(records.range_)
    places = [
        np.clip(np.searchsorted(edge, x, side="right") - 1, 0, edge.size - 2)
        for edge, x in zip(edges, values, strict=True)
    ]
    middles = np.meshgrid(*((edge[1:] + edge[:-1]) / 2 for edge in edges), indexing="ij")
    shape = middles[0].shape
    along = [basis(middle.ravel()) for basis, middle in zip(records.support.bases, middles, strict=True)]
    splines = (along[0][:, :, None] * along[1][:, None, :]).reshape(middles[0].size, -1)
    return np.ravel_multi_index(places, shape), splines
