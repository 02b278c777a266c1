"""A prediction of the impact speed of crashes, with which few runs estimate how many crashes are severe."""

from collections.abc import Callable

import numpy as np
from scipy.special import ndtr

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.vehicles.protocol import Outcomes

RIDGE = 1e-2  # ridge penalty of the regression, in units of the variance of its terms
SMALLEST_DEVIATION = 0.3  # [m/s], smallest standard deviation of the residuals
FEWEST = 15  # smallest number of crashes for a regression


def impact_share(z: Array, outcomes: Outcomes, threshold: float) -> Callable[[Array], Array]:
    """Return a function that predicts the probability that a crash has an impact speed above a threshold.

    The impact speeds of the crashes are regressed on a quadratic function of the normal scores, with normal
    residuals. The predictions are used only for a control variate, so they need not be exact. With fewer than
    `FEWEST` crashes, the predicted probability is 1 everywhere. The function takes normal scores of shape (m,
    d), and returns probabilities of shape (m,). The threshold is in m/s.
    """
    if outcomes.crash.sum() < FEWEST:
        return lambda points: np.ones(len(points))
    centre, scale = z[outcomes.crash].mean(axis=0), z[outcomes.crash].std(axis=0) + SMALLEST_DEVIATION
    terms, speeds = _quadratic((z[outcomes.crash] - centre) / scale), outcomes.impact_speed[outcomes.crash]
    penalty = RIDGE * len(terms) * np.eye(terms.shape[1])
    coefficients = np.linalg.solve(terms.T @ terms + penalty, terms.T @ speeds)
    deviation = max(float((speeds - terms @ coefficients).std()), SMALLEST_DEVIATION)

    def share(points: Array) -> Array:
        if not len(points):
            return np.empty(0)
        return ndtr((_quadratic((points - centre) / scale) @ coefficients - threshold) / deviation)

    return share


def _quadratic(x: Array) -> Array:
    """Return a constant, the d variables and their products as columns, shape (n, 1 + d + d (d + 1) / 2)."""
    products = [x[:, i] * x[:, j] for i in range(x.shape[1]) for j in range(i + 1)]
    return np.column_stack([np.ones(len(x)), x, *products])
