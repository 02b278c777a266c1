"""A law of cut-ins with dependence, all of whose conditional probabilities have closed forms.

R^-1 depends on v_L: P(R^-1 > x | v) = exp(-rate(v) (x - LOWER)). The closing speed C depends on both:
P(C > c | v, x) = exp(-(c / scale(v, x))^POWER). The coordinates are the two exponents, which are independent
and unit-exponential, so that closing speeds are larger where the range is larger, and at higher speeds.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from accelerated_evaluation.laws import Factors, StratifiedLaw, Stratum
from accelerated_evaluation.laws.distributions import BoundedExponential, Empirical, PiecewiseMixture

LOWER, POWER = 1 / 75, 1.5
UNIT = BoundedExponential(1.0)
FACTORS = Factors(UNIT, UNIT)
# The same distribution in two pieces, which the paper's methods tilt apart.
PIECES = PiecewiseMixture(
    [-np.expm1(-2), np.exp(-2)], [BoundedExponential(1.0, 0.0, 2.0), BoundedExponential(1.0, 2.0)]
)


def rate(lead_speed):
    return 40 + 2 * lead_speed


def scale(lead_speed, inverse_range):
    return 0.6 + 0.03 * lead_speed + 0.045 / inverse_range


def closing_speed_tail(lead_speed, inverse_range, closing_speed):
    """P(C > c | v_L, R^-1)."""
    return np.exp(-((closing_speed / scale(lead_speed, inverse_range)) ** POWER))


@dataclass(frozen=True)
class DependentStratum(Stratum):
    lead_speed: Empirical
    factors: Factors = FACTORS

    range_max = 1 / LOWER
    pieces = Factors(PIECES, PIECES)

    def points(self, lead_speed, first, second):
        inverse_range = LOWER + first / rate(lead_speed)
        closing_speed = scale(lead_speed, inverse_range) * second ** (1 / POWER)
        return np.column_stack([lead_speed, 1 / inverse_range, closing_speed])

    def first(self, lead_speed, inverse_range):
        return rate(lead_speed) * (inverse_range - LOWER)

    def second(self, lead_speed, inverse_range, closing_speed):
        return (closing_speed / scale(lead_speed, inverse_range)) ** POWER

    def log_first_slope(self, lead_speed, inverse_range):
        return np.log(rate(lead_speed)) + 0 * inverse_range

    def log_second_slope(self, lead_speed, inverse_range, closing_speed):
        width = scale(lead_speed, inverse_range)
        return np.log(POWER / width) + (POWER - 1) * np.log(closing_speed / width)


@dataclass(frozen=True)
class DependentLaw(StratifiedLaw):
    kind: ClassVar[str] = "toy with dependence"
    from_content = None  # it is in no file

    parts: Mapping[str, DependentStratum]
    weights: Mapping[str, float]
    description: str = "a toy"
    closing_speed_max: float = np.inf

    @property
    def shares(self):
        return self.weights

    @property
    def strata(self):
        return self.parts

    def content(self):
        return {"shares": self.weights, "factors": repr([part.factors for part in self.parts.values()])}

    def only(self, stratum):
        part = {stratum: self.parts[stratum]}
        return DependentLaw(part, {stratum: 1.0}, self.description, self.closing_speed_max)


def dependent_law(factors=FACTORS, cap=np.inf):
    """Return a law of two strata, 5 to 10 and 10 to 15 m/s, of unequal shares."""
    generator = np.random.default_rng(4)
    speeds = {"slow": generator.uniform(5, 10, 1000), "fast": generator.uniform(10, 15, 1000)}
    parts = {name: DependentStratum(Empirical(values), factors) for name, values in speeds.items()}
    return DependentLaw(parts, {"slow": 0.7, "fast": 0.3}, closing_speed_max=cap)


NODES, NODE_WEIGHTS = np.polynomial.legendre.leggauss(200)


def mean_over_cut_ins(stratum, function, inverse_range_max=np.inf):
    """E of a function of v_L and R^-1 up to a largest R^-1, by Gauss-Legendre quadrature."""
    speed = stratum.lead_speed.values[:, None]
    half = np.minimum(rate(speed) * (inverse_range_max - LOWER), 40.0) / 2  # beyond 40 lies exp(-40)
    first = half * (NODES + 1)
    values = function(speed, LOWER + first / rate(speed)) * np.exp(-first) * half
    return float((values @ NODE_WEIGHTS).mean())


def crash_probability(stratum, edges):
    """P of closing speeds in [edges[0], edges[1]) or from edges[2] on: what `WallCar` calls a crash."""

    def tail(speed, inverse_range):
        below, hole, above = (closing_speed_tail(speed, inverse_range, edge) for edge in edges)
        return below - hole + above

    return mean_over_cut_ins(stratum, tail)
