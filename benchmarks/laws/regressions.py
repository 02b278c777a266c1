"""Regressions for the whole distribution of the closing speed: gamma, Weibull, lognormal and two kinds.

The log scale and the log shape are spline functions of lead speed and range, with the same splines as the
scale of the excess. The regressions are alternatives to the laws with a threshold. Their parameters are
determined by the bulk of the records, so a comparison shows how much accuracy this costs in the tail.
Covariates are rounded to the middles of cells, so that one iteration takes little more than one pass over the
records.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import ConvergenceError
from accelerated_evaluation.laws.smooth.conditional import Places, speed_grid
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.special import digamma, expit, gammaincc, gammaln, log_ndtr, logit, polygamma

SMOOTHING = (1.0, 1.0)  # smoothing parameters of log scale and log shape, along lead speed and range
SLOWEST = 1e-4  # [m/s]; smaller closing speeds are replaced by this one, because log(0) is not finite
SMALLEST = 1e-300  # smallest survival probability, because log(0) is not finite
ITERATIONS = 100  # largest number of Newton steps
TOLERANCE = 1e-6  # the iterations end if a Newton step is expected to gain less in log likelihood
SMALLEST_STEP = 1e-6  # smallest factor of a Newton step
ROUNDING = 1e-12  # relative rounding error of the log likelihood
FIRST_DAMPING = 1e-3  # first damping of Newton steps, relative to the diagonal of the information
LARGEST_DAMPING = 1e8  # above which it is given up


@dataclass(frozen=True)
class Terms:
    """The log density of n records, and its derivatives.

    The derivatives are with respect to log scale, log shape and the constant parameters (``shared``).

    Attributes
    ----------
    value
        Log density, shape (n,).
    gradient
        First derivatives, shape (2 + shared, n).
    hessian
        Second derivatives, shape (2 + shared, 2 + shared, n).
    """

    value: Array
    gradient: Array
    hessian: Array


@dataclass(frozen=True)
class Regression:
    """A family of distributions with a log scale, a log shape and further parameters that are constant.

    Attributes
    ----------
    name
        Name of the family.
    terms
        Function of closing speed, log scale, log shape and the constant parameters. It returns the log
        density and its derivatives.
    log_survival
        Function of the same arguments that returns log P(C > c).
    shared
        Starting values of the constant parameters.
    """

    name: str
    terms: Callable[[Array, Array, Array, Array], Terms]
    log_survival: Callable[[Array, Array, Array, Array], Array]
    shared: tuple[float, ...] = ()


def _two_numbers(value: Array, first: tuple[Array, Array], second: tuple[Array, Array, Array]) -> Terms:
    """Return the terms of a family without constant parameters.

    Parameters
    ----------
    value
        Log density, shape (n,).
    first
        First derivatives with respect to log scale and log shape.
    second
        Second derivatives: scale-scale, scale-shape and shape-shape.
    """
    gradient, hessian = np.empty((2, value.size)), np.empty((2, 2, value.size))
    gradient[0], gradient[1] = first
    hessian[0, 0], hessian[0, 1], hessian[1, 1] = second
    hessian[1, 0] = hessian[0, 1]
    return Terms(value, gradient, hessian)


def _weibull(c: Array, log_scale: Array, log_shape: Array, shared: Array) -> Terms:
    shape, x = np.exp(log_shape), np.log(c) - log_scale
    kx = shape * x
    power = np.exp(kx)
    return _two_numbers(
        log_shape - np.log(c) + kx - power,
        (shape * (power - 1), 1 + kx * (1 - power)),
        (-(shape**2) * power, shape * (power - 1 + kx * power), kx * (1 - power - kx * power)),
    )


def _weibull_survival(c: Array, log_scale: Array, log_shape: Array, shared: Array) -> Array:
    return -np.exp(np.exp(log_shape) * (np.log(c) - log_scale))


def _gamma(c: Array, log_scale: Array, log_shape: Array, shared: Array) -> Terms:
    shape, x = np.exp(log_shape), np.log(c) - log_scale
    ratio, slope = np.exp(x), shape * (x - digamma(shape))
    value = shape * x - ratio - np.log(c) - gammaln(shape)
    curvature = slope - shape**2 * polygamma(1, shape)
    return _two_numbers(value, (ratio - shape, slope), (-ratio, -shape, curvature))


def _gamma_survival(c: Array, log_scale: Array, log_shape: Array, shared: Array) -> Array:
    return np.log(np.maximum(gammaincc(np.exp(log_shape), np.exp(np.log(c) - log_scale)), SMALLEST))


def _lognormal(c: Array, log_scale: Array, log_shape: Array, shared: Array) -> Terms:
    precision = np.exp(log_shape)
    z = (np.log(c) - log_scale) * precision
    value = log_shape - np.log(c) - z**2 / 2 - np.log(2 * np.pi) / 2
    return _two_numbers(value, (z * precision, 1 - z**2), (-(precision**2), 2 * z * precision, -2 * z**2))


def _lognormal_survival(c: Array, log_scale: Array, log_shape: Array, shared: Array) -> Array:
    return log_ndtr(-(np.log(c) - log_scale) * np.exp(log_shape))


def _two_kinds(c: Array, log_scale: Array, log_shape: Array, shared: Array) -> Terms:
    """Return the terms of a mixture of two Weibull distributions.

    The constant parameters are the logit of the share of the second component, and the log ratios of the two
    scales and of the two shapes. Let r be the probability that a record belongs to the second component. Let
    g_i and H_i be the gradient and the Hessian of the log of the weighted density of component i, and let
    d = g_2 - g_1. Then the log density of the mixture has the gradient g_1 + r d and the Hessian
    (1 - r) H_1 + r H_2 + r (1 - r) d d'.
    """
    logit_, ratio, step = shared
    share = expit(logit_)
    first, second = (
        _weibull(c, log_scale + a, log_shape + b, shared) for a, b in ((0.0, 0.0), (ratio, step))
    )
    values = np.log(expit(-logit_)) + first.value, np.log(share) + second.value
    value = np.logaddexp(*values)
    other = np.exp(values[1] - value)
    away = np.concatenate([second.gradient - first.gradient, np.ones((1, c.size)), second.gradient])
    gradient = other * away
    gradient[:2] += first.gradient
    gradient[2] -= share
    hessian = away[:, None] * ((other * (1 - other)) * away)
    for rows in (slice(0, 2), slice(3, 5)):
        for columns in (slice(0, 2), slice(3, 5)):
            hessian[rows, columns] += other * second.hessian
    hessian[:2, :2] += (1 - other) * first.hessian
    hessian[2, 2] -= share * (1 - share)
    return Terms(value, gradient, hessian)


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
    """A fitted regression.

    Attributes
    ----------
    regression
        The family of distributions.
    coefficients
        Coefficients of the splines of log scale and log shape, shape (2, p).
    shared
        Constant parameters.
    """

    regression: Regression
    coefficients: Array
    shared: Array

    def given(self, places: Places) -> "GivenRegression":
        """Return the distributions of the closing speed given n pairs of lead speed and range."""
        return GivenRegression(
            self.regression, *(places.splines @ part for part in self.coefficients), self.shared
        )


@dataclass(frozen=True)
class GivenRegression:
    """Distributions of the closing speed given n pairs of lead speed and range, under a regression.

    Attributes
    ----------
    regression
        The family of distributions.
    log_scale, log_shape
        Log scale and log shape for each pair, shape (n,).
    shared
        Constant parameters.
    """

    regression: Regression
    log_scale: Array
    log_shape: Array
    shared: Array

    def log_density(self, closing_speed: Array) -> Array:
        """Return the log density of the closing speed at one value [m/s] for each pair, shape (n,)."""
        c = np.maximum(closing_speed, SLOWEST)
        return self.regression.terms(c, self.log_scale, self.log_shape, self.shared).value

    def cumulative(self, closing_speed: Array) -> Array:
        """Return the cumulative hazard -log P(C > c) at a closing speed c [m/s] for each pair, (n,)."""
        c = np.maximum(closing_speed, SLOWEST)
        return -self.regression.log_survival(c, self.log_scale, self.log_shape, self.shared)


def fit_regression(
    regression: Regression, records: DistinctRecords, start: FittedRegression | None = None
) -> FittedRegression:
    """Return a regression fitted by penalised maximum likelihood, with Newton steps.

    Parameters
    ----------
    regression
        The family of distributions.
    records
        Distinct cut-ins.
    start
        An earlier fit, which supplies starting values.

    Raises
    ------
    ConvergenceError
        If the Newton steps do not converge.
    """
    cell, splines = _cells(records)
    closing_speed = np.maximum(records.closing_speed, SLOWEST)
    problem = _Problem(regression, closing_speed, cell, splines, records.support.penalty.total(SMOOTHING))
    p = splines.shape[1]
    values = np.concatenate([np.full(p, np.log(closing_speed.mean())), np.zeros(p), regression.shared])
    if start is not None:
        values = np.concatenate([*start.coefficients, start.shared])
    with np.errstate(over="ignore", invalid="ignore"):  # a trial step that overflows is halved
        values = problem.newton(values)
    return FittedRegression(regression, values[: 2 * p].reshape(2, p), values[2 * p :])


@dataclass(frozen=True)
class _Problem:
    """The penalised likelihood of records, as a function of coefficients and constant parameters."""

    regression: Regression
    closing_speed: Array
    cell: NDArray[np.intp]
    splines: Array  # at the cells
    precision: Array

    def newton(self, values: Array) -> Array:
        """Return the parameters that maximize the penalised likelihood, found from starting values."""
        objective, score, information = self._at(values)
        gain = np.inf
        for _ in range(ITERATIONS):
            if not (np.isfinite(objective) and np.isfinite(score).all() and np.isfinite(information).all()):
                break  # parameters that the records do not determine may overflow
            try:
                step = _ascent(information, score)
            except LinAlgError:
                break
            gain, size = float(step @ score), 1.0
            trial = self._at(values + step)
            while not trial[0] >= objective - ROUNDING * abs(objective) and size > SMALLEST_STEP:
                size /= 2
                trial = self._at(values + size * step)
            values, (objective, score, information) = values + size * step, trial
            if gain < TOLERANCE:
                return values
        change = "Add records, or leave this regression out."
        reached = f"a gain of {gain:.2g} in log likelihood"
        what = f"the regression {self.regression.name}"
        raise ConvergenceError(what, reached=reached, limit=f"{TOLERANCE:g}", change=change)

    def _at(self, values: Array) -> tuple[float, Array, Array]:
        """Return the objective, its gradient, and its negative second derivatives."""
        cells, p = self.splines.shape
        coefficients, shared = values[: 2 * p].reshape(2, p), values[2 * p :]
        scale, shape = (self.splines @ part for part in coefficients)
        terms = self.regression.terms(self.closing_speed, scale[self.cell], shape[self.cell], shared)
        designs = [self.splines, self.splines, *[np.ones((cells, 1))] * shared.size]
        penalty = np.zeros((values.size, values.size))
        penalty[:p, :p] = penalty[p : 2 * p, p : 2 * p] = self.precision
        score = [design.T @ self._by_cell(row) for design, row in zip(designs, terms.gradient, strict=True)]
        blocks = [
            [-(one * self._by_cell(terms.hessian[i, j])[:, None]).T @ two for j, two in enumerate(designs)]
            for i, one in enumerate(designs)
        ]
        objective = float(terms.value.sum() - values @ penalty @ values / 2)
        return objective, np.concatenate(score) - penalty @ values, np.block(blocks) + penalty

    def _by_cell(self, of_records: Array) -> Array:
        """Return the sum of a quantity over the records of each cell."""
        return np.bincount(self.cell, of_records, len(self.splines))


def _ascent(information: Array, score: Array) -> Array:
    """Return the Newton step; the information matrix is damped until it is positive definite.

    LinAlgError is raised if no damping makes it so, which happens with few records.
    """
    damping, scale = 0.0, np.abs(np.diag(information))
    while damping <= LARGEST_DAMPING and np.isfinite(damping * scale.max()):
        try:
            return cho_solve(cho_factor(information + np.diag(damping * scale)), score)
        except LinAlgError:
            damping = max(FIRST_DAMPING, 10 * damping)
    raise LinAlgError("no damping makes the information matrix positive definite")


def _cells(records: DistinctRecords) -> tuple[NDArray[np.intp], Array]:
    """Return the index of the cell of each record, and the splines at the middles of the cells."""
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
