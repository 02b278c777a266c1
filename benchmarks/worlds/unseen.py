"""Worlds that the far tails of the laws were not made for; see `far_tail`.

As in `beyond`, each is the world `exponential` but for one property, and its crash probability is the sum
over the intervals of the same map. The kinds of `unseen_worlds` were invented before the laws got their far
tails, and simulated afterwards. Two of them decided between two widths of the prior. The kinds of
`fresh_worlds` were invented after this, and nothing was changed after they had been simulated. In the kinds
of `worlds_by_place` the tail changes in one half of the traffic only.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.laws.smooth.conditional import Places, SpeedLaw
from accelerated_evaluation.laws.smooth.family import DistinctRecords, LawFamily, Member
from accelerated_evaluation.laws.smooth.shapes import Exponential
from beyond import Bent, HostSpeedLimit
from kinds import LEVEL, Smooth, TwoKindsOfDrivers, World, draw_smooth
from numpy.typing import NDArray

FADED, AGGRESSIVE = 4.0, 3.0  # excess in scales from which on the excess is stretched
NEARBY = 15.0  # [m] over which aggressiveness fades
SLOW, HEAVIER = 13.0, 1.5  # [m/s], lead speed at which the tail changes, and the factor of the excess
GRADUAL, SHAPE = 4.0, 0.2  # excess in scales from which on it is generalised Pareto, and the shape


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

    The function ``factor`` takes places and the scales [m/s] there; ``begin`` is in scales.
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
        return replace(lines, start=start, end=end).masses(self.family.ranges, self.law)

    def _far(self, places: Places) -> tuple[Array, Array]:
        """Return the closing speed [m/s] at which the far part begins, and the factor, (n,) each."""
        scale = self.law.tail.scale(places.splines)
        threshold = self.law.threshold(places.lead_speed, places.range_)
        return threshold + self.begin * scale, self.factor(places, scale)


def _base(family: LawFamily) -> SpeedLaw:
    return SpeedLaw(family.body, family.thresholds[LEVEL], family.tails[Member(LEVEL, "exponential")])


def _shaped(family: LawFamily, shape: Exponential) -> World:
    base = _base(family)
    return Smooth(family, replace(base, tail=replace(base.tail, shape=shape)))


def unseen_worlds(family: LawFamily) -> dict[str, World]:
    """Return the kinds of worlds that were invented before the laws got their far tails."""
    base, above = _base(family), family.exceedances[LEVEL]
    common = float(np.exp(np.mean(above.splines @ base.tail.coefficients)))
    return {
        "season": Season(family, base, share=0.3, nearer=0.75, faster=1.3),
        "some with a limit": HostSpeedLimit(family, base, limit=27.0, least=2.0, share=0.4),
        "late bend": _shaped(family, Bent((7.0,), (0.4,))),
        "steep end": _shaped(family, Bent((6.0,), (2.0,))),
        "fading dependence": Stretched(family, base, FADED, lambda places, scale: common / scale),
    }


def fresh_worlds(family: LawFamily) -> dict[str, World]:
    """Return the kinds of worlds that were invented after the prior had been chosen."""
    base = _base(family)
    return {
        "slow trucks": HostSpeedLimit(family, base, limit=0.0, least=6.0, share=0.1),
        "double bend": _shaped(family, Bent((4.0, 7.0), (1.5, 0.4))),
        "gradual bend": _shaped(family, Gradual()),
        "aggressive when near": Stretched(
            family, base, AGGRESSIVE, lambda places, scale: 1 + 0.4 * np.exp(-places.range_ / NEARBY)
        ),
    }


def worlds_by_place(family: LawFamily) -> dict[str, World]:
    """Return the kinds of worlds whose far tail is heavier at some lead speeds only."""
    base = _base(family)

    def heavier(is_heavier: Callable[[Array], NDArray[np.bool_]]) -> World:
        def factor(places: Places, scale: Array) -> Array:
            return np.where(is_heavier(places.lead_speed), HEAVIER, 1.0)

        return Stretched(family, base, FADED, factor)

    return {
        "heavier in fast traffic": heavier(lambda lead_speed: lead_speed >= SLOW),
        "heavier in slow traffic": heavier(lambda lead_speed: lead_speed < SLOW),
    }
