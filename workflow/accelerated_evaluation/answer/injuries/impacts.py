"""Impact speeds of the crashes under a law, and the risk of injury of the two drivers.

A crash is treated as a plastic impact: both cars have the same velocity afterwards. With the impact speed v
and the masses m_host of the car under test and m_lead of the car that cuts in, the delta-v is

    v m_lead / (m_host + m_lead)   for the car under test, which is struck in front,
    v m_host / (m_host + m_lead)   for the car that cuts in, which is struck from behind.

Each interval of a crash map is divided into parts, and the vehicle is simulated at some closing speeds in
each part. The probability of a part under a law times the mean risk in the part, summed over all parts, is
the expected number of injured drivers in a cut-in.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit, ndtri

from accelerated_evaluation.answer.injuries.curves import FRONTAL, LEVELS, REAR, RiskCurve
from accelerated_evaluation.answer.injuries.sources import published_curves
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.laws.smooth.conditional import SpeedLaw
from accelerated_evaluation.scenarios.cut_in import SPEED_LIMIT
from accelerated_evaluation.vehicles.protocol import Vehicle

# 5 and 95 % of the cars sold in the United States in 2017 are lighter than this [lb] (Stolle and others 2020,
# Evaluation and update of MASH test vehicles, University of Nebraska-Lincoln).
MASSES = (2800, 5850)
NODES = 15  # number of nodes of the integral over the masses
PARTS = 8  # number of parts of a wide interval of a crash map
POINTS = 4  # number of closing speeds that are simulated in a part
INSIDE = (np.arange(POINTS) + 0.5) / POINTS  # positions of these closing speeds in the part, from 0 to 1
NARROW = 0.5  # [m/s], intervals up to this width are not divided
TAIL = 4  # exponent by which the parts at large closing speeds have smaller probabilities
FAR = 50.0  # largest cumulative hazard in a part, in place of an infinite one
SPEEDS = np.linspace(0, 80, 1601)  # [m/s], impact speeds at which risks are tabulated
GENTLE = 3.0  # [m/s], at smaller impact speeds hardly any car is towed, so the curves are extrapolated

Key = tuple[str, str, str]  # level of injury, struck end of the car, source of the curve


@dataclass(frozen=True)
class MassRatio:
    """The distribution of the mass of the car that cuts in divided by the mass of the car under test.

    The ratio is lognormal. By default the masses of both cars are drawn independently from the same lognormal
    distribution.

    Attributes
    ----------
    mean, deviation
        Mean and standard deviation of the logarithm of the ratio.
    """

    mean: float = 0.0
    deviation: float = float(np.sqrt(2) * np.log(MASSES[1] / MASSES[0]) / (2 * ndtri(0.95)))

    def expected_risk(self, curve: RiskCurve, impact: str, speed: Array) -> Array:
        """Return the risk of an injury at given impact speeds, averaged over the masses, shape (n,).

        Parameters
        ----------
        curve
            Risk of the injury, given the delta-v.
        impact
            Struck end of the car, `FRONTAL` for the car under test or `REAR` for the car that cuts in.
        speed
            Impact speeds [m/s], shape (n,).
        """
        nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
        log_ratio = self.mean + self.deviation * nodes
        share = expit(log_ratio if impact == FRONTAL else -log_ratio)
        return curve(speed[:, None] * share) @ (weights / weights.sum())


@dataclass(frozen=True)
class ImpactSpeeds:
    """The crashes of a vehicle with their impact speeds.

    Attributes
    ----------
    lines
        Crash map whose intervals are divided into parts.
    speed
        Impact speeds at some closing speeds of each part [m/s], NaN without a crash, shape (parts, POINTS).
    """

    lines: CrashLines
    speed: Array

    @classmethod
    def of(cls, lines: CrashLines, vehicle: Vehicle, law: SpeedLaw) -> "ImpactSpeeds":
        """Divide the intervals of a crash map, and simulate the vehicle in each part.

        Intervals wider than `NARROW` are divided into `PARTS` parts. The vehicle is simulated at `POINTS`
        closing speeds in each part.

        Parameters
        ----------
        lines
            Crash map: lines, and the intervals of closing speeds in which the vehicle crashes.
        vehicle
            The vehicle of the map.
        law
            Distribution of the closing speed, whose quantiles determine the ends of the parts.

        Returns
        -------
        ImpactSpeeds
            The divided map, with the impact speeds in each part.
        """
        if not lines.row.size:
            return cls(lines, np.empty((0, POINTS)))
        wide = lines.end - lines.start > NARROW
        divided = _whole(_only(lines, ~wide)), _divided(_only(lines, wide), law)
        row, start, end, points = (np.concatenate(column) for column in zip(*divided, strict=True))
        place = np.repeat(row, POINTS)
        # With few records, quantiles of the laws may exceed any speed that a vehicle accepts.
        outcomes = lines.simulate(vehicle, place, np.minimum(points.ravel(), SPEED_LIMIT))
        speed = np.where(outcomes.crash, outcomes.impact_speed, np.nan).reshape(points.shape)
        return cls(replace(lines, row=row, start=start, end=end), speed)

    def mean_of(self, risks: Array) -> Array:
        """Return the mean of a tabulated risk over the crashes of each part, shape (parts,).

        If none of the simulations of a part is a crash, the risk at an impact speed of 0 is used. It is also
        used for negative impact speeds, which occur in sideways contacts with a faster car.

        Parameters
        ----------
        risks
            Risk at each of `SPEEDS`, shape (speeds,).
        """
        crashed = ~np.isnan(self.speed)
        risk = np.interp(np.where(crashed, self.speed, 0.0), SPEEDS, risks)
        total = np.where(crashed, risk, 0.0).sum(axis=1)
        return np.where(crashed.any(axis=1), total / np.maximum(crashed.sum(axis=1), 1), risks[0])

    def risks(self, tabulated: Mapping[Key, Array]) -> Array:
        """Return the mean risk over the crashes of each part for each curve, shape (curves, parts).

        Parameters
        ----------
        tabulated
            Risks of the curves at the impact speeds `SPEEDS`, as from `tabulated_risks`.
        """
        return np.array([self.mean_of(risks) for risks in tabulated.values()])


def tabulated_risks(masses: MassRatio | None = None) -> dict[Key, Array]:
    """Return the risks of all published curves at `SPEEDS`, averaged over the masses of the cars.

    For each curve there is a second entry under the level ``gentle(level)``, whose risk is 0 at impact speeds
    of `GENTLE` or more.

    Parameters
    ----------
    masses
        Distribution of the ratio of the masses; by default both cars have the same distribution.

    Returns
    -------
    dict
        Risks at `SPEEDS`, by level of injury, struck end of the car and source of the curve.
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


def _only(lines: CrashLines, chosen: Array) -> CrashLines:
    return replace(lines, row=lines.row[chosen], start=lines.start[chosen], end=lines.end[chosen])


def _whole(lines: CrashLines) -> tuple[Array, Array, Array, Array]:
    """Return row, start, end and simulated closing speeds of intervals that are not divided."""
    points = lines.start[:, None] + (lines.end - lines.start)[:, None] * INSIDE
    return lines.row, lines.start, lines.end, points


def _divided(lines: CrashLines, law: SpeedLaw) -> tuple[Array, Array, Array, Array]:
    """Return row, start, end and simulated closing speeds of each part of all intervals."""
    given = law.given(lines.places.only(lines.row))
    start, end = given.cumulative(lines.start), given.cumulative(lines.end)
    start = np.where(np.isfinite(start), start, 0.0)  # the law may have no probability beyond a finite end

    def above(share: float) -> Array:
        """Return the closing speed above which a given share of the probability of each interval lies."""
        level = start - np.log1p((1 - share) * np.expm1(start - end))
        return np.clip(given.inverse(np.minimum(level, start + FAR)), lines.start, lines.end)

    shares = (1 - np.arange(PARTS + 1) / PARTS) ** TAIL
    edges = np.column_stack([lines.start, *(above(share) for share in shares[1:-1]), lines.end])
    inside = shares[:-1, None] + np.diff(shares)[:, None] * INSIDE
    points = np.column_stack([above(share) for share in inside.ravel()]).reshape(-1, POINTS)
    return np.repeat(lines.row, PARTS), edges[:, :-1].ravel(), edges[:, 1:].ravel(), points
