"""Weights of laws from their held-out scores: none is picked by hand."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import logsumexp, softmax

from accelerated_evaluation.base.arrays import Array

FLOOR = -1e4  # of a score, so that sums stay defined where a law calls a record impossible


def bootstrapped_weights(
    scores: Array, inside: NDArray[np.bool_], draws: int, generator: np.random.Generator
) -> Array:
    """Return weights by pseudo-Bayesian model averaging with the Bayesian bootstrap (Yao et al. 2018).

    Each draw weighs the records anew, sums the scores of each law, and takes the laws in proportion to the
    exponential of their sums. So the weights know that a difference of scores is itself uncertain.

    Parameters
    ----------
    scores
        Held-out log scores, shape (laws, records).
    inside
        Whether a record lies in the region of the scores. The others, whose scores hardly differ, are one.
    draws
        Number of draws.
    generator
        Weighs the records.

    Returns
    -------
    numpy.ndarray
        Shape (draws, laws); rows add up to 1.
    """
    floored = np.maximum(scores - scores.max(axis=0), FLOOR)
    parts = floored[:, inside]
    masses = generator.standard_exponential((draws, parts.shape[1]))
    masses *= parts.shape[1] / masses.sum(axis=1, keepdims=True)
    return softmax(masses @ parts.T + floored[:, ~inside].sum(axis=1), axis=1)


def stacking_weights(scores: Array, inside: NDArray[np.bool_]) -> Array:
    """Return the weights of the mixture of laws with the best held-out log score, shape (laws,).

    The score is concave in the weights, which are found as the softmax of free numbers (Yao et al. 2018).

    Parameters
    ----------
    scores
        Held-out log scores, shape (laws, records).
    inside
        Whether a record lies in the region of the scores. The scores of the others differ so little that the
        logarithm of their mixture is linear in the weights.
    """
    floored = np.maximum(scores - scores.max(axis=0), FLOOR)
    densities, outside = np.exp(floored[:, inside]), floored[:, ~inside].sum(axis=1)

    def negative(free: Array) -> tuple[float, Array]:
        weights = softmax(free)
        mixture = weights @ densities
        slope = densities @ (1 / mixture) + outside
        value = np.log(mixture).sum() + weights @ outside
        return -float(value), -weights * (slope - weights @ slope)

    return softmax(minimize(negative, np.zeros(len(scores)), jac=True, method="L-BFGS-B").x)


def mixture_scores(scores: Array, weights: Array) -> Array:
    """Return the log scores of the mixture of laws with given weights, shape (records,)."""
    with np.errstate(divide="ignore"):
        return logsumexp(scores + np.log(weights)[:, None], axis=0)
