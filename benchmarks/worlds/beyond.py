"""Worlds beyond the family: laws of cut-ins that no law of the family equals, with known crash probabilities.

Each of them contradicts one assumption of the family, and is otherwise the world `exponential`. Its crash
probability is the sum of the probabilities of the same intervals of the map by which the answer is computed;
`benchmarks/tests/test_benchmark_worlds.py` compares it with the share of crashes among simulated cut-ins.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.laws.smooth.conditional import Places, SpeedLaw
from accelerated_evaluation.laws.smooth.draws import SmoothDraws
from accelerated_evaluation.laws.smooth.family import DistinctRecords, LawFamily, Member
from accelerated_evaluation.laws.smooth.far_tail import Layers
from accelerated_evaluation.laws.smooth.shapes import Exponential
from kinds import LEVEL, Smooth, TwoKindsOfDrivers, World, draw_smooth
from numpy.typing import NDArray

HOST_MAX, LEAST_CLOSING, NO_LIMIT = 31.0, 3.0, 1e3  # [m/s]
BEND, SLOPE = 5.0, 0.5  # excess in scales where the hazard changes, and its factor from there on
HABIT_SPEEDS, HABIT, HABIT_RANGE = (12.0, 16.0), 0.5, 10.0  # [m/s], and [m] over which the habit fades
FACTORS = (0.75, 0.9, 1.0, 1.1, 1.25)  # of the closing speeds of equally many drivers
CUT_INS = 50  # of each driver, one after the other
FADED, AGGRESSIVE = 4.0, 3.0  # excess in scales from which on the excess is stretched
NEARBY = 15.0  # [m] over which aggressiveness fades
SLOW, HEAVIER = 13.0, 1.5  # [m/s], lead speed at which the tail changes, and the factor of the excess
GRADUAL, SHAPE = 4.0, 0.2  # excess in scales from which on it is generalised Pareto, and the shape


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
        laws = SmoothDraws.of_laws(self.family.ranges, [self.law])
        within = replace(lines, start=start, end=end).masses(laws)[0] / kept[lines.row]
        return self.share * within + (1 - self.share) * lines.masses(laws)[0]

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


def local_habit(places: Places, scale: Array) -> Array:
    """Return the factor of closing speeds, which is above 1 at short ranges in a band of lead speeds."""
    inside = (places.lead_speed >= HABIT_SPEEDS[0]) & (places.lead_speed < HABIT_SPEEDS[1])
    return 1 + np.where(inside, HABIT * np.exp(-places.range_ / HABIT_RANGE), 0.0)


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
        laws = SmoothDraws.of_laws(self.family.ranges, [self.law])
        each = (replace(lines, start=lines.start / f, end=lines.end / f) for f in FACTORS)
        return np.mean([slower.masses(laws)[0] for slower in each], axis=0)


class Season(TwoKindsOfDrivers):
    """The second kind of drivers makes all cut-ins of the last part of the records, and no others."""

    def is_second(self, size: int, generator: np.random.Generator) -> NDArray[np.bool_]:
        """Return which of the cut-ins are in the last part."""
        return np.arange(size) >= (1 - self.share) * size


class Gradual(Exponential):
    """Exponential excesses that turn into generalised Pareto ones, with a continuous hazard."""

    name = "gradual"

    def cumulative(self, z: Array, parameters: Array) -> Array:
        """Return the cumulative hazard."""
        z = np.asarray(z, dtype=float)
        return np.minimum(z, GRADUAL) + np.log1p(SHAPE * np.maximum(z - GRADUAL, 0)) / SHAPE

    def inverse(self, level: Array, parameters: Array) -> Array:
        """Return the excess at which the cumulative hazard reaches a level."""
        level = np.asarray(level, dtype=float)
        return np.minimum(level, GRADUAL) + np.expm1(SHAPE * np.maximum(level - GRADUAL, 0)) / SHAPE


@dataclass(frozen=True)
class Stretched:
    """From some excess on, the excess is stretched by a factor that depends on range and lead speed.

    The function ``factor`` takes places and the scales [m/s] there; ``begin`` is in scales, and -inf for the
    whole closing speed.
    """

    family: LawFamily
    law: SpeedLaw
    begin: float
    factor: Callable[[Places, Array], Array]

    def draw(self, lead_speed: Array, generator: np.random.Generator) -> DistinctRecords:
        """Draw by the smooth law, and stretch the far part of the excess."""
        drawn = draw_smooth(self.family, self.law, lead_speed, generator)
        begin, factor = self._far(drawn.places)
        far = np.maximum(drawn.closing_speed - begin, 0)
        return replace(drawn, closing_speed=drawn.closing_speed + far * (factor - 1))

    def masses(self, lines: CrashLines) -> Array:
        """Return the probability of the intervals, whose ends are mapped to those of the smooth law."""
        begin, factor = (values[lines.row] for values in self._far(lines.places))
        start, end = (
            np.minimum(ends, begin) + np.maximum(ends - begin, 0) / factor
            for ends in (lines.start, lines.end)
        )
        laws = SmoothDraws.of_laws(self.family.ranges, [self.law])
        return replace(lines, start=start, end=end).masses(laws)[0]

    def _far(self, places: Places) -> tuple[Array, Array]:
        """Return the closing speed [m/s] at which the far part begins, and the factor, (n,) each."""
        scale = self.law.tail.scale(places.splines)
        threshold = self.law.threshold(places.lead_speed, places.range_)
        return np.maximum(threshold + self.begin * scale, 0), self.factor(places, scale)


def worlds_beyond(family: LawFamily) -> dict[str, World]:
    """Return all kinds of worlds beyond the family.

    The first six showed that the laws need far tails (see `far_tail`). The five after them were invented
    before the laws got these and simulated afterwards; two of them decided between two widths of the prior.
    The four after these were invented later, and nothing was changed after they had been simulated. In the
    last two, the tail changes in one half of the traffic only.
    """
    base = SpeedLaw(family.body, family.thresholds[LEVEL], family.tails[Member(LEVEL, "exponential")])
    common = float(np.exp(np.mean(family.exceedances[LEVEL].splines @ base.tail.coefficients)))

    def shaped(shape: Exponential) -> World:
        return Smooth(family, replace(base, tail=replace(base.tail, shape=shape)))

    def heavier(is_heavier: Callable[[Array], NDArray[np.bool_]]) -> World:
        def factor(places: Places, scale: Array) -> Array:
            return np.where(is_heavier(places.lead_speed), HEAVIER, 1.0)

        return Stretched(family, base, FADED, factor)

    return {
        "reckless drivers": TwoKindsOfDrivers(family, base, share=0.002, nearer=0.5, faster=1.9),
        "two regions": TwoKindsOfDrivers(family, base, share=0.3, nearer=0.8, faster=1.35),
        "host speed limit": HostSpeedLimit(family, base),
        "bent tail": shaped(Bent()),
        "local habit": Stretched(family, base, -np.inf, local_habit),
        "few drivers": FewDrivers(family, base),
        "season": Season(family, base, share=0.3, nearer=0.75, faster=1.3),
        "some with a limit": HostSpeedLimit(family, base, limit=27.0, least=2.0, share=0.4),
        "late bend": shaped(Bent((7.0,), (0.4,))),
        "steep end": shaped(Bent((6.0,), (2.0,))),
        "fading dependence": Stretched(family, base, FADED, lambda places, scale: common / scale),
        "slow trucks": HostSpeedLimit(family, base, limit=0.0, least=6.0, share=0.1),
        "double bend": shaped(Bent((4.0, 7.0), (1.5, 0.4))),
        "gradual bend": shaped(Gradual()),
        "aggressive when near": Stretched(
            family, base, AGGRESSIVE, lambda places, scale: 1 + 0.4 * np.exp(-places.range_ / NEARBY)
        ),
        "heavier in fast traffic": heavier(lambda lead_speed: lead_speed >= SLOW),
        "heavier in slow traffic": heavier(lambda lead_speed: lead_speed < SLOW),
    }
