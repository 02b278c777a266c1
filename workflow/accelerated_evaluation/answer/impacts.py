"""Impact speeds of the runs that crashed, regressed on the normal scores, as part of a control variate."""

from collections.abc import Callable

import numpy as np
from scipy.special import ndtr

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.vehicles.protocol import Outcomes

RIDGE = 1e-2  # of the regression, in units of the variance of its terms
SMALLEST_DEVIATION = 0.3  # [m/s], of an impact speed from its regression
FEWEST = 15  # crashes, from which impact speeds are regressed


def impact_share(z: Array, outcomes: Outcomes, threshold: float) -> Callable[[Array], Array]:
    """Return the probability that a crash at normal scores is faster than a threshold [m/s].

    Impact speeds of the crashes are regressed on a quadratic function of the normal scores, with normal
    residuals. The function only serves as a control variate, so that it reduces the variance and need not be
    exact. It is 1 where there are too few crashes.
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
    """Return a constant, the variables and their products, shape (n, d) to (n, 1 + d + d (d + 1) / 2)."""
    products = [x[:, i] * x[:, j] for i in range(x.shape[1]) for j in range(i + 1)]
    return np.column_stack([np.ones(len(x)), x, *products])
