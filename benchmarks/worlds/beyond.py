"""Worlds beyond the family: laws of cut-ins that no law of the family equals, with known crash probabilities.

Each of them contradicts one assumption of the family, and is otherwise the world `exponential`. Its crash
probability is the sum of the probabilities of the same intervals of the map by which the answer is computed;
`benchmarks/tests/test_benchmark_worlds.py` compares it with the share of crashes among simulated cut-ins.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.laws.smooth.conditional import SpeedLaw
from accelerated_evaluation.laws.smooth.family import DistinctRecords, LawFamily, Member
from accelerated_evaluation.laws.smooth.far_tail import Layers
from accelerated_evaluation.laws.smooth.shapes import Exponential
from kinds import LEVEL, Smooth, TwoKindsOfDrivers, World, draw_smooth

HOST_MAX, LEAST_CLOSING, NO_LIMIT = 31.0, 3.0, 1e3  # [m/s]
BEND, SLOPE = 5.0, 0.5  # excess in scales where the hazard changes, and its factor from there on
HABIT_SPEEDS, HABIT, HABIT_RANGE = (12.0, 16.0), 0.5, 10.0  # [m/s], and [m] over which the habit fades
FACTORS = (0.75, 0.9, 1.0, 1.1, 1.25)  # of the closing speeds of equally many drivers
CUT_INS = 50  # of each driver, one after the other


@dataclass(frozen=True)
class HostSpeedLimit:
    """A share of the hosts never drives faster than a limit [m/s], but may always close in slowly."""

    family: LawFamily
    law: SpeedLaw
    limit: float = HOST_MAX
    least: float = LEAST_CLOSING
    share: float = 1.0

    def draw(self, lead_speed: Array, generator: np.random.Generator) -> DistinctRecords:
        """Draw closing speeds on condition that they are within the limit."""
        fastest = self.fastest(lead_speed)
        if self.share < 1:
            fastest = np.where(generator.random(lead_speed.size) < self.share, fastest, NO_LIMIT)
        return draw_smooth(self.family, self.law, lead_speed, generator, fastest=fastest)

    def masses(self, lines: CrashLines) -> Array:
        """Return the probability of the intervals: within the limit, given that it is kept, or without it."""
        fastest = self.fastest(lines.places.lead_speed)
        kept = -np.expm1(-self.law.given(lines.places).cumulative(fastest))
        start, end = (np.minimum(ends, fastest[lines.row]) for ends in (lines.start, lines.end))
        within = replace(lines, start=start, end=end).masses(self.family.ranges, self.law) / kept[lines.row]
        return self.share * within + (1 - self.share) * lines.masses(self.family.ranges, self.law)

    def fastest(self, lead_speed: Array) -> Array:
        """Return the largest closing speed [m/s] next to each lead speed [m/s]."""
        return np.maximum(self.limit - lead_speed, self.least)


class Bent(Exponential):
    """Exponential excesses whose hazard is multiplied by a factor beyond each of some excesses [scales]."""

    name = "bent"

    def __init__(self, bends: Sequence[float] = (BEND,), factors: Sequence[float] = (SLOPE,)) -> None:
        self.changed = Layers(np.array(bends, dtype=float), np.array(factors, dtype=float))

    def cumulative(self, z: Array, parameters: Array) -> Array:
        """Return the cumulative hazard."""
        return self.changed.cumulative(np.asarray(z, dtype=float))

    def inverse(self, level: Array, parameters: Array) -> Array:
        """Return the excess at which the cumulative hazard reaches a level."""
        return self.changed.original(np.asarray(level, dtype=float))


@dataclass(frozen=True)
class LocalHabit:
    """In a band of lead speeds, drivers close in faster at short ranges; the laws vary smoothly."""

    family: LawFamily
    law: SpeedLaw

    def draw(self, lead_speed: Array, generator: np.random.Generator) -> DistinctRecords:
        """Draw by the smooth law, and multiply the closing speeds."""
        drawn = draw_smooth(self.family, self.law, lead_speed, generator)
        factor = self.factor(drawn.lead_speed, drawn.range_)
        return replace(drawn, closing_speed=factor * drawn.closing_speed)

    def masses(self, lines: CrashLines) -> Array:
        """Return the probability of the intervals, whose ends are divided by the factor."""
        factor = self.factor(lines.places.lead_speed, lines.places.range_)[lines.row]
        slower = replace(lines, start=lines.start / factor, end=lines.end / factor)
        return slower.masses(self.family.ranges, self.law)

    @staticmethod
    def factor(lead_speed: Array, range_: Array) -> Array:
        """Return the factor of the closing speed at lead speeds [m/s] and ranges [m]."""
        inside = (lead_speed >= HABIT_SPEEDS[0]) & (lead_speed < HABIT_SPEEDS[1])
        return 1 + np.where(inside, HABIT * np.exp(-range_ / HABIT_RANGE), 0.0)


@dataclass(frozen=True)
class FewDrivers:
    """Each driver makes many cut-ins in a row, all faster or slower; the laws take records as independent."""

    family: LawFamily
    law: SpeedLaw
    cut_ins: int = CUT_INS

    def draw(self, lead_speed: Array, generator: np.random.Generator) -> DistinctRecords:
        """Draw by the smooth law, and multiply the closing speeds of each driver."""
        drivers = generator.choice(FACTORS, -(-lead_speed.size // self.cut_ins))
        factor = np.repeat(drivers, self.cut_ins)[: lead_speed.size]
        return draw_smooth(self.family, self.law, lead_speed, generator, faster=factor)

    def masses(self, lines: CrashLines) -> Array:
        """Return the mean over the drivers of the probability of the intervals."""
        each = (replace(lines, start=lines.start / f, end=lines.end / f) for f in FACTORS)
        return np.mean([slower.masses(self.family.ranges, self.law) for slower in each], axis=0)


def worlds_beyond(family: LawFamily) -> dict[str, World]:
    """Return all kinds of worlds beyond the family."""
    tail = family.tails[Member(LEVEL, "exponential")]
    base = SpeedLaw(family.body, family.thresholds[LEVEL], tail)
    return {
        "reckless drivers": TwoKindsOfDrivers(family, base, share=0.002, nearer=0.5, faster=1.9),
        "two regions": TwoKindsOfDrivers(family, base, share=0.3, nearer=0.8, faster=1.35),
        "host speed limit": HostSpeedLimit(family, base),
        "bent tail": Smooth(family, replace(base, tail=replace(tail, shape=Bent()))),
        "local habit": LocalHabit(family, base),
        "few drivers": FewDrivers(family, base),
    }
