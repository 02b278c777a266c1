"""Weights of laws from their held-out log scores: by the Bayesian bootstrap, and by stacking."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import logsumexp, softmax

from accelerated_evaluation.base.arrays import Array

SMALLEST = 1e-300  # lower bound of a mixture density, so that its logarithm is finite
SEARCH = {"ftol": 1e-13, "maxiter": 1000}
LEAST_WEIGHT = 1e-6  # a smaller weight is replaced by 0
NEWTON_STEPS = 4  # number of Newton steps, from weights with six correct digits
FLOOR = -1e4  # lower bound of a score, so that sums are finite if a law has no density at a record


def bootstrapped_weights(
    scores: Array, inside: NDArray[np.bool_], draws: int, generator: np.random.Generator
) -> Array:
    """Draw weights of laws by pseudo-Bayesian model averaging with the Bayesian bootstrap (Yao et al. 2018).

    In each draw, the records get random weights, and the weighted scores of each law are added up. The weight
    of a law is proportional to the exponential of its sum. Scores have the shape (laws, records), and only
    the records ``inside`` the region are reweighted. The weights have the shape (draws, laws), with rows that
    sum to 1.
    """
    floored = np.maximum(scores - scores.max(axis=0), FLOOR)
    parts = floored[:, inside]
    masses = generator.standard_exponential((draws, parts.shape[1]))
    masses *= parts.shape[1] / masses.sum(axis=1, keepdims=True)
    return softmax(masses @ parts.T + floored[:, ~inside].sum(axis=1), axis=1)


def stacking_weights(scores: Array, inside: NDArray[np.bool_]) -> Array:
    """Return the weights of the mixture of laws with the largest held-out log score, shape (laws,).

    The score is a concave function of the weights (Yao et al. 2018). Sequential quadratic programming finds
    the laws with a positive weight. Newton steps for these weights then reach the maximum to nine digits, so
    that the result does not depend on the processor. The scores of records outside of the region differ so
    little between the laws that the logarithm of their mixture is taken to be linear in the weights.
    """
    floored = np.maximum(scores - scores.max(axis=0), FLOOR)
    densities, outside = np.exp(floored[:, inside]), floored[:, ~inside].sum(axis=1)
    laws, records = densities.shape

    def negative(weights: Array) -> tuple[float, Array]:
        mixture = np.maximum(weights @ densities, SMALLEST)
        value, slope = np.log(mixture).sum() + weights @ outside, densities @ (1 / mixture) + outside
        return -float(value) / records, -slope / records

    total = {"type": "eq", "fun": lambda weights: weights.sum() - 1, "jac": np.ones_like}
    equal, within = np.full(laws, 1 / laws), [(0.0, 1.0)] * laws
    found = minimize(
        negative, equal, jac=True, method="SLSQP", bounds=within, constraints=total, options=SEARCH
    )
    used = np.flatnonzero(found.x > LEAST_WEIGHT)
    weights = np.zeros(laws)
    weights[used] = _newton(densities[used], outside[used], found.x[used] / found.x[used].sum())
    return weights


def _newton(densities: Array, outside: Array, weights: Array) -> Array:
    """Return the weights of the best mixture by Newton steps, from positive weights that sum to 1."""
    for _ in range(NEWTON_STEPS):
        relative = densities / (weights @ densities)
        slope = relative.sum(axis=1) + outside
        curvature = np.block([[relative @ relative.T, np.ones((slope.size, 1))], [np.ones(slope.size), 0.0]])
        step = np.linalg.lstsq(curvature, np.append(slope, 0.0))[0][:-1]
        if np.any(weights + step <= 0):  # for example if two laws are equal: only their sum is then defined
            break
        weights = weights + step
    return weights


def mixture_scores(scores: Array, weights: Array) -> Array:
    """Return the log scores of the mixture of laws with given weights, shape (records,)."""
    with np.errstate(divide="ignore"):
        return logsumexp(scores + np.log(weights)[:, None], axis=0)
