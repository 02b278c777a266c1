"""A car whose crash probability has a closed form, and laws to drive it with."""

from dataclasses import dataclass

import mpmath
import numpy as np
from accelerated_evaluation.laws import distributions as dist
from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.vehicles import Outcomes
from builders import coarse_grid

GRID = coarse_grid(speeds=(5, 15, 8), ranges=(75, 40), closing=(60, 160), refinement=4)
LOWER = 1 / 75
RANGE_LAWS = {
    "exponential": dist.BoundedExponential(50.0, LOWER),
    "pieces": dist.PiecewiseMixture(
        [0.8, 0.2], [dist.BoundedExponential(107.0, LOWER, 0.0374), dist.BoundedExponential(42.7, 0.0374)]
    ),
    "pareto": dist.Pareto(1.73, LOWER),
}
BODY = dist.Mixture([0.3, 0.7], [dist.BoundedNormal(scale, 0.0, 0.166) for scale in (0.04, 0.09)])
TTC_LAWS = {
    "exponential": dist.BoundedExponential(21.0),
    "pieces": dist.PiecewiseMixture([0.95, 0.05], [BODY, dist.BoundedExponential(21.0, 0.166)]),
}


@dataclass
class WallCar:
    """Crashes from ``first`` m/s of closing speed on, but not in the hole."""

    first: float = 12.0
    hole: tuple[float, float] = (12.5, 12.8)

    def simulate(self, lead_speed, range_, closing_speed):
        crash = (closing_speed >= self.first) & ~(
            (closing_speed >= self.hole[0]) & (closing_speed < self.hole[1])
        )
        gap = np.where(crash, 0.0, np.minimum(range_, np.maximum(self.first - closing_speed, 0.01)))
        return Outcomes(crash, gap, range_ / closing_speed, np.where(crash, closing_speed, 0.0))


SPEEDS = dist.Empirical(np.random.default_rng(3).uniform(5, 15, 2000))


def law_of(range_law, ttc_law, speeds=SPEEDS, cap=np.inf):
    """Return the law of one segment, 5 to 15 m/s."""
    return IndependentLaw("test", {"5-15": 1}, range_law, {"5-15": ttc_law}, {"5-15": speeds}, cap)


def integral(range_law, ttc_law, edges):
    """P of closing speeds in [edges[0], edges[1]) or from edges[2] on, by adaptive quadrature over R^-1."""

    def log_tail(speed, x):
        return float(ttc_law.logsf(speed * x))

    def integrand(x):
        x = float(x)
        terms = np.exp(log_tail(edges[0], x)) - np.exp(log_tail(edges[1], x)) + np.exp(log_tail(edges[2], x))
        return terms * np.exp(float(range_law.logpdf(x)))

    bounds = sorted({LOWER, 0.0374, *(0.166 / edge for edge in edges), 0.1, 0.3, 1.0, 3.0})
    return float(mpmath.quad(integrand, [b for b in bounds if b >= LOWER]))
