"""Impact speeds of the crashes under a law, and the risk of injury of the two drivers.

A crash is treated as a plastic impact: both cars have the same velocity afterwards. With the impact speed v
and the masses m_host of the car under test and m_lead of the car that cuts in, the delta-v is

    v m_lead / (m_host + m_lead)   for the car under test, which is struck in front,
    v m_host / (m_host + m_lead)   for the car that cuts in, which is struck from behind.

The crashes of an answer come in parts, such as the intervals of a crash map, each with its probability under
every draw of the law. The probability of a part times the mean risk in the part, summed over all parts, is
the expected number of injured drivers in a cut-in.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import expit, ndtri

from accelerated_evaluation.answer.injuries.curves import FRONTAL, LEVELS, REAR, RiskCurve
from accelerated_evaluation.answer.injuries.sources import published_curves
from accelerated_evaluation.base.arrays import Array

# 5 and 95 % of the cars sold in the United States in 2017 are lighter than this [lb] (Stolle and others 2020,
# Evaluation and update of MASH test vehicles, University of Nebraska-Lincoln).
MASSES = (2800, 5850)
NODES = 15  # number of nodes of the integral over the masses
SPEEDS = np.linspace(0, 80, 1601)  # [m/s], impact speeds at which risks are tabulated
GENTLE = 3.0  # [m/s], at smaller impact speeds hardly any car is towed, so the curves are extrapolated

Key = tuple[str, str, str]  # level of injury, struck end of the car, source of the curve


@dataclass(frozen=True)
class MassRatio:
    """The distribution of the mass of the car that cuts in divided by the mass of the car under test.

    The ratio is lognormal. By default the masses of both cars are drawn independently from the same lognormal
    distribution.
    """

    mean: float = 0.0  # of the logarithm of the ratio
    # Of the logarithm of the ratio.
    deviation: float = float(np.sqrt(2) * np.log(MASSES[1] / MASSES[0]) / (2 * ndtri(0.95)))

    def expected_risk(self, curve: RiskCurve, impact: str, speed: Array) -> Array:
        """Return the risk of an injury at impact speeds [m/s], averaged over the masses, shape (n,).

        ``impact`` is the struck end of the car: `FRONTAL` for the car under test, `REAR` for the car that
        cuts in.
        """
        nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
        log_ratio = self.mean + self.deviation * nodes
        share = expit(log_ratio if impact == FRONTAL else -log_ratio)
        return curve(speed[:, None] * share) @ (weights / weights.sum())


def mean_risks(impact_speed: Array, tabulated: Mapping[Key, Array]) -> Array:
    """Return the mean of each tabulated risk over the crashes of each part, shape (curves, parts).

    The impact speeds [m/s] of a part are a row, shape (parts, points), with NaN where there is no crash. If
    none of the simulations of a part is a crash, the risk at an impact speed of 0 is used. It is also used
    for negative impact speeds, which occur in sideways contacts with a faster car.
    """
    crashed = ~np.isnan(impact_speed)
    speed, any_crash = np.where(crashed, impact_speed, 0.0), crashed.any(axis=1)
    counts, means = np.maximum(crashed.sum(axis=1), 1), []
    for risks in tabulated.values():
        total = np.where(crashed, np.interp(speed, SPEEDS, risks), 0.0).sum(axis=1)
        means.append(np.where(any_crash, total / counts, risks[0]))
    return np.array(means)


def tabulated_risks(masses: MassRatio | None = None) -> dict[Key, Array]:
    """Return the risks of all published curves at `SPEEDS`, averaged over the masses of the cars.

    For each curve there is a second entry under the level ``gentle(level)``, whose risk is 0 at impact speeds
    of `GENTLE` or more. The keys are level of injury, struck end of the car and source of the curve. By
    default both cars have the same distribution of the mass.
    """
    masses = MassRatio() if masses is None else masses
    risks = {
        (level, impact, source): masses.expected_risk(curve, impact, SPEEDS)
        for level in LEVELS
        for impact in (FRONTAL, REAR)
        for source, curve in published_curves(level, impact).items()
    }
    below = SPEEDS < GENTLE
    return risks | {
        (gentle(level), *rest): np.where(below, risk, 0.0) for (level, *rest), risk in risks.items()
    }


def gentle(level: str) -> str:
    """Return the name under which the risk of a level of injury in impacts below `GENTLE` is stored."""
    return f"{level}, gentle"
