"""Impact speeds of the crashes of a law, and the injuries of the two drivers.

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
from accelerated_evaluation.vehicles.protocol import Vehicle

# 5 and 95 % of the cars sold in the United States in 2017 are lighter than this [lb] (Stolle and others 2020,
# Evaluation and update of MASH test vehicles, University of Nebraska-Lincoln).
MASSES = (2800, 5850)
NODES = 15  # of the integral over the masses
PARTS = 8  # of a wide interval of a crash map
POINTS = 4  # that are simulated in a part
INSIDE = (np.arange(POINTS) + 0.5) / POINTS  # where they are
NARROW = 0.5  # [m/s], width up to which an interval is not divided
TAIL = 4  # exponent that makes the parts smaller in probability where the closing speed is large
FAR = 50.0  # cumulative hazard beyond any crash, in place of an infinite one
SPEEDS = np.linspace(0, 80, 1601)  # [m/s], at which risks are tabulated
GENTLE = 3.0  # [m/s], impact speed below which hardly any car is towed, so that no curve was fitted there

Key = tuple[str, str, str]  # level of injury, struck end of the car, source of the curve


@dataclass(frozen=True)
class MassRatio:
    """The logarithm of the mass of the car that cuts in, divided by that of the car under test: normal.

    By default both cars are drawn independently from the same lognormal distribution of masses.

    Attributes
    ----------
    mean, deviation
        Mean and standard deviation.
    """

    mean: float = 0.0
    deviation: float = float(np.sqrt(2) * np.log(MASSES[1] / MASSES[0]) / (2 * ndtri(0.95)))

    def expected_risk(self, curve: RiskCurve, impact: str, speed: Array) -> Array:
        """Return the risk of an injury at impact speeds [m/s], averaged over the masses.

        Parameters
        ----------
        curve
            Risk of the injury, given the delta-v.
        impact
            Struck end of the car, `FRONTAL` for the car under test or `REAR` for the car that cuts in.
        speed
            Impact speeds, shape (n,).
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

        Parameters
        ----------
        lines
            Crash map.
        vehicle
            The vehicle of the map.
        law
            Distribution of the closing speed that says where the ends of the parts are.
        """
        if not lines.row.size:
            return cls(lines, np.empty((0, POINTS)))
        wide = lines.end - lines.start > NARROW
        divided = _whole(_only(lines, ~wide)), _divided(_only(lines, wide), law)
        row, start, end, points = (np.concatenate(column) for column in zip(*divided, strict=True))
        place = np.repeat(row, POINTS)
        outcomes = lines.simulate(vehicle, place, points.ravel())
        speed = np.where(outcomes.crash, outcomes.impact_speed, np.nan).reshape(points.shape)
        return cls(replace(lines, row=row, start=start, end=end), speed)

    def mean_of(self, risks: Array) -> Array:
        """Return the mean of a tabulated risk over the crashes of each part, shape (parts,).

        A part in which no crash was simulated counts as crashes at an impact speed of zero. So do impacts
        with a negative speed, which are sideways contacts with a car that drives away.

        Parameters
        ----------
        risks
            Risk at `SPEEDS`.
        """
        crashed = ~np.isnan(self.speed)
        risk = np.interp(np.where(crashed, self.speed, 0.0), SPEEDS, risks)
        total = np.where(crashed, risk, 0.0).sum(axis=1)
        return np.where(crashed.any(axis=1), total / np.maximum(crashed.sum(axis=1), 1), risks[0])

    def risks(self, tabulated: Mapping[Key, Array]) -> Array:
        """Return the mean risk of each part for each curve, shape (curves, parts)."""
        return np.array([self.mean_of(risks) for risks in tabulated.values()])


def tabulated_risks(masses: MassRatio | None = None) -> dict[Key, Array]:
    """Return the risks of all published curves at `SPEEDS`, averaged over the masses of the cars.

    Each curve has a second entry, with the level `gentle(level)`, that contains only the impacts below
    `GENTLE`.
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
    """Return the name of a level of injury for impacts below `GENTLE` alone."""
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
    start = np.where(np.isfinite(start), start, 0.0)  # a law with a finite end has no probability beyond it

    def above(share: float) -> Array:
        """Return the closing speed that is exceeded with a share of the probability of each interval."""
        level = start - np.log1p((1 - share) * np.expm1(start - end))
        return np.clip(given.inverse(np.minimum(level, start + FAR)), lines.start, lines.end)

    shares = (1 - np.arange(PARTS + 1) / PARTS) ** TAIL
    edges = np.column_stack([lines.start, *(above(share) for share in shares[1:-1]), lines.end])
    inside = shares[:-1, None] + np.diff(shares)[:, None] * INSIDE
    points = np.column_stack([above(share) for share in inside.ravel()]).reshape(-1, POINTS)
    return np.repeat(lines.row, PARTS), edges[:, :-1].ravel(), edges[:, 1:].ravel(), points
