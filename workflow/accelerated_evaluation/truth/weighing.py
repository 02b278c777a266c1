"""Weights of laws from their held-out scores: none is picked by hand."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, softmax

from accelerated_evaluation.distributions.protocol import Array

ITERATIONS = 2000
TOLERANCE = 1e-10


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
    # Records of probability zero under a law refuse it in every draw; a finite floor keeps the sums defined.
    floored = np.maximum(scores - scores.max(axis=0), -1e4)
    parts = floored[:, inside]
    masses = generator.standard_exponential((draws, parts.shape[1]))
    masses *= parts.shape[1] / masses.sum(axis=1, keepdims=True)
    return softmax(masses @ parts.T + floored[:, ~inside].sum(axis=1), axis=1)


def stacking_weights(scores: Array) -> Array:
    """Return the weights of the mixture of laws with the best held-out log score, shape (laws,).

    The score is concave in the weights; the EM algorithm of mixture weights climbs to its maximum.

    Parameters
    ----------
    scores
        Held-out log scores, shape (laws, records).
    """
    density = np.exp(scores - scores.max(axis=0))
    weights = np.full(len(scores), 1 / len(scores))
    for _ in range(ITERATIONS):
        shares = weights[:, None] * density
        new = (shares / shares.sum(axis=0)).mean(axis=1)
        if np.abs(new - weights).max() < TOLERANCE:
            break
        weights = new
    return weights / weights.sum()


def stacked_score(scores: Array, weights: Array) -> float:
    """Return the sum of the log scores of the mixture of laws with given weights."""
    with np.errstate(divide="ignore"):
        return float(logsumexp(scores + np.log(weights)[:, None], axis=0).sum())
