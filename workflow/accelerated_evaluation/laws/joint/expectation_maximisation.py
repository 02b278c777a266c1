"""Maximum likelihood of a mixture of truncated normal distributions, by the EM algorithm for truncated data.

Let o1 and o2 be the first and second moments of the records of a component about the present mean of the
component, and i1 and i2 the moments of the component itself within the box, about the same mean. The M-step
is

    mean + step (o1 - i1)   and   covariance + step (o2 - i2)   (second moments about the present mean).

If the step is P, the probability of the box under the component, this is the M-step of the EM algorithm whose
missing data are the points outside the box; it never lowers the likelihood. The step 1 is that of Lee and
Scott (2012), which is faster if P is small, but may overshoot. The step 1 is tried first, and the step P is
taken if the likelihood falls.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.cluster.vq import kmeans2

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.joint import normalised
from accelerated_evaluation.laws.joint.truncated import Normals
from accelerated_evaluation.laws.protocol import Box

STARTS = 8  # number of runs of k-means from which the EM algorithm begins
SHORT = 15  # number of iterations after which the starts are compared
ITERATIONS = 500  # largest number of iterations from the best start
TOLERANCE = 1e-6  # the iterations end if the mean log likelihood of a record increases by less
NARROWEST = 0.05  # least standard deviation of a component in any direction, relative to that of the records
LEAST_MASS = 0.01  # least probability of the box under a component; with less, drawing would be slow

Mixture = tuple[Array, Normals]


@dataclass(frozen=True)
class Fitted:
    """Summary of the fit of a mixture.

    The information criteria count the weights, means and covariances of K components of d variables, which
    are K - 1 + K (d + d (d + 1) / 2) parameters.
    """

    records: int
    log_likelihood: float  # of the records, with weights whose mean is 1
    iterations: int  # from the best start
    converged: bool  # whether the log likelihood stopped increasing before the limit of iterations
    aic: float
    bic: float

    @classmethod
    def of(
        cls, log_likelihood: float, parameters: int, records: int, iterations: int, converged: bool
    ) -> Self:
        """Return the summary of a fit, with the AIC and BIC for the given number of parameters."""
        aic = 2 * parameters - 2 * log_likelihood
        bic = parameters * math.log(records) - 2 * log_likelihood
        return cls(records, log_likelihood, iterations, converged, aic, bic)


@dataclass(frozen=True)
class Expected:
    """A mixture, and the result of the E-step that the next M-step needs."""

    shares: Array
    normals: Normals
    mass: Array  # probability of the box under each component, (K,)
    first: Array  # mean within the box of x minus the mean of the component, (K, d)
    second: Array  # second moments about the same mean, (K, d, d)
    responsibility: Array  # probability of each component given each record, (K, n)
    value: float  # mean log likelihood of a record


def parameters_of_mixture(components: int, dimension: int) -> int:
    """Return the number of free parameters of a mixture of K components, normal in d dimensions.

    It is K - 1 + K (d + d (d + 1) / 2), for example 10 K - 1 for d = 3.
    """
    return components - 1 + components * (dimension + dimension * (dimension + 1) // 2)


def fit_mixture(
    x: Array,
    box: Box,
    components: int,
    generator: np.random.Generator,
    weights: Array | None = None,
    start: Mixture | None = None,
) -> tuple[Array, Normals, Fitted]:
    """Fit a mixture of K normal distributions, each truncated to a box, to records x of shape (n, d).

    Return the shares of the components within the box, (K,), the components before the truncation, and a
    summary. Without a ``start`` (shares and components), the iterations begin at the best of `STARTS` runs of
    k-means.
    """
    n, d = x.shape
    weight, centre, scale = normalised(weights, n), x.mean(axis=0), x.std(axis=0)
    # Records are standardised, so that one least standard deviation is suitable for all directions.
    y = (x - centre) / scale
    sides = (tuple((np.array(end) - centre) / scale) for end in (box.lower, box.upper))
    own = Box(box.names, *sides)
    if start is None:
        begins = [
            _climb(y, weight, _clustered(y, own, components, generator), SHORT)[0] for _ in range(STARTS)
        ]
        best = max(begins, key=lambda begin: begin.value)
    else:
        shares, normals = start
        rescaled = Normals((normals.mean - centre) / scale, normals.covariance / np.outer(scale, scale), own)
        best = _expect(y, weight, shares, rescaled)
    found, iterations, converged = _climb(y, weight, best, ITERATIONS)
    log_likelihood = n * (found.value - float(np.log(scale).sum()))
    parameters = parameters_of_mixture(len(found.shares), d)
    fitted = Fitted.of(log_likelihood, parameters, n, iterations, converged)
    mean, covariance = centre + scale * found.normals.mean, found.normals.covariance * np.outer(scale, scale)
    return found.shares, Normals(mean, covariance, box), fitted


def _clustered(y: Array, box: Box, components: int, generator: np.random.Generator) -> Expected:
    """Return the mixture of the clusters that k-means finds from a random start."""
    _, label = kmeans2(y, components, minit="++", rng=generator)
    whole = np.atleast_2d(np.cov(y.T))
    mean, covariance, counts = [], [], np.bincount(label, minlength=components)
    for k in range(components):
        own = y[label == k]
        mean.append(own.mean(axis=0) if len(own) else y[generator.integers(len(y))])
        covariance.append(np.atleast_2d(np.cov(own.T)) if len(own) > y.shape[1] + 1 else whole)
    normals = Normals(np.array(mean), _floored(np.array(covariance)), box)
    return _expect(y, np.ones(len(y)), np.maximum(counts, 1) / np.maximum(counts, 1).sum(), normals)


def _climb(y: Array, weight: Array, state: Expected, limit: int) -> tuple[Expected, int, bool]:
    """Iterate until the likelihood no longer increases.

    Return the last state, the number of iterations, and whether the iterations converged before ``limit``.
    """
    for iteration in range(limit):
        new = _maximised(y, weight, state, np.ones(len(state.shares)))
        if new.value < state.value:
            new = _maximised(y, weight, state, state.mass)
        if new.value < state.value:
            return state, iteration + 1, True  # because of the least width of a component, or of rounding
        gain, state = new.value - state.value, new
        if gain < TOLERANCE:
            return state, iteration + 1, True
    return state, limit, False


def _maximised(y: Array, weight: Array, state: Expected, step: Array) -> Expected:
    """Take an M-step with a given step for each component, shape (K,), and the E-step that follows."""
    normals, part = state.normals, state.responsibility * weight
    total = np.maximum(part.sum(axis=1), np.finfo(float).tiny)
    difference = y - normals.mean[:, None, :]
    o1 = (part[:, None, :] @ difference)[:, 0] / total[:, None]
    o2 = (part[..., None] * difference).transpose(0, 2, 1) @ difference / total[:, None, None]
    shift = step[:, None] * (o1 - state.first)
    second = normals.covariance + step[:, None, None] * (o2 - state.second)
    covariance = _floored(second - shift[:, :, None] * shift[:, None, :])
    new = Normals(normals.mean + shift, covariance, normals.box)
    return _expect(y, weight, total / total.sum(), new, state)


def _expect(
    y: Array, weight: Array, shares: Array, normals: Normals, before: Expected | None = None
) -> Expected:
    """Take an E-step.

    A component under which the box has less probability than `LEAST_MASS` gets the parameters that it has in
    ``before``.
    """
    moments = normals.moments()
    if before is not None and (lost := ~(moments[0] >= LEAST_MASS)).any():
        mean = np.where(lost[:, None], before.normals.mean, normals.mean)
        covariance = np.where(lost[:, None, None], before.normals.covariance, normals.covariance)
        normals = Normals(mean, covariance, normals.box)
        moments = normals.moments()
    with np.errstate(divide="ignore"):
        logs = normals.log_densities(y) + (np.log(shares) - np.log(moments[0]))[:, None]
    density = np.logaddexp.reduce(logs, axis=0)  # `logsumexp` takes several times as long
    return Expected(shares, normals, *moments, np.exp(logs - density), float(np.mean(weight * density)))


def _floored(covariance: Array) -> Array:
    """Return covariance matrices with standard deviations of at least `NARROWEST` in all directions."""
    values, vectors = np.linalg.eigh((covariance + covariance.transpose(0, 2, 1)) / 2)
    return (vectors * np.maximum(values, NARROWEST**2)[:, None, :]) @ vectors.transpose(0, 2, 1)
