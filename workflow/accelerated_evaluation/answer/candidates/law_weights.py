"""Weights of laws from their held-out log scores, by the Bayesian bootstrap."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, softmax

from accelerated_evaluation.base.arrays import Array

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


def mixture_scores(scores: Array, weights: Array) -> Array:
    """Return the log scores of the mixture of laws with given weights, shape (records,)."""
    with np.errstate(divide="ignore"):
        return logsumexp(scores + np.log(weights)[:, None], axis=0)
