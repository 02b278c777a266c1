"""Synthetic worlds: laws of cut-ins whose crash probability is known, and records drawn from them."""

from dataclasses import dataclass, replace
from typing import ClassVar, Protocol

import numpy as np
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.laws.distributions import Distribution
from accelerated_evaluation.laws.draws import OneLaw
from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.laws.smooth.conditional import Places, SpeedLaw
from accelerated_evaluation.laws.smooth.draws import SmoothDraws
from accelerated_evaluation.laws.smooth.family import DistinctRecords, LawFamily, Member
from accelerated_evaluation.laws.smooth.shapes import Generalised
from accelerated_evaluation.laws.smooth.support import SUPPORT
from numpy.typing import NDArray

LEVEL = 0.95  # of the threshold of the worlds with an excess
SHARE = 0.03  # of the second kind of drivers
NEARER = 0.6  # exponent of their ranges' distribution function: they cut in at shorter range
PART = 4000  # cut-ins that are drawn at once
FASTER = 1.25  # ratio of their closing speeds


class World(Protocol):
    """A law of cut-ins."""

    def draw(self, lead_speed: Array, generator: np.random.Generator) -> DistinctRecords:
        """Draw a cut-in for each lead speed [m/s]."""

    def masses(self, lines: CrashLines) -> Array:
        """Return the probability of a crash in each interval of the lines."""


@dataclass(frozen=True)
class Independent:
    """The paper's law: R^-1 and TTC^-1 independent in each segment; its cap is no part of the world."""

    law: IndependentLaw
    edges: ClassVar[Array] = np.array([15.0, 25.0])  # [m/s], of the segments

    def draw(self, lead_speed: Array, generator: np.random.Generator) -> DistinctRecords:
        """Draw R^-1, then TTC^-1 in each segment."""
        inverse_range = self.law.inverse_range.rvs(generator, lead_speed.size)
        inverse_ttc, segment = np.empty(lead_speed.size), np.digitize(lead_speed, self.edges)
        for number, distribution in enumerate(by_rising_speed(self.law)):
            here = segment == number
            inverse_ttc[here] = distribution.rvs(generator, int(here.sum()))
        range_ = np.minimum(1 / inverse_range, SUPPORT.range_max)
        return DistinctRecords(lead_speed, range_, inverse_ttc * range_)

    def masses(self, lines: CrashLines) -> Array:
        """Return the probability of the intervals under the law of each segment."""
        return lines.masses(OneLaw(self.law))[0]


def by_rising_speed(law: IndependentLaw) -> list[Distribution]:
    """Return the distributions of TTC^-1, by rising speed of the segments that their names begin with."""
    return [
        law.inverse_ttc[name] for name in sorted(law.inverse_ttc, key=lambda name: float(name.split("-")[0]))
    ]


@dataclass(frozen=True)
class Smooth:
    """Range given lead speed, and closing speed given both, with an excess above a smooth threshold."""

    family: LawFamily
    law: SpeedLaw

    def draw(self, lead_speed: Array, generator: np.random.Generator) -> DistinctRecords:
        """Draw by the inverse of the cumulative hazards."""
        return draw_smooth(self.family, self.law, lead_speed, generator)

    def masses(self, lines: CrashLines) -> Array:
        """Weigh the intervals."""
        return lines.masses(SmoothDraws.of_laws(self.family.ranges, [self.law]))[0]


def draw_smooth(
    family: LawFamily,
    law: SpeedLaw,
    lead_speed: Array,
    generator: np.random.Generator,
    nearer: Array | float = 1.0,
    faster: Array | float = 1.0,
    fastest: Array | None = None,
) -> DistinctRecords:
    """Draw ranges, and closing speeds given them, nearer and faster where asked.

    With ``fastest`` [m/s], closing speeds are drawn on condition that they do not exceed it.
    """
    range_, speed = np.empty(lead_speed.size), np.empty(lead_speed.size)
    levels = generator.standard_exponential((2, lead_speed.size)) / np.array(
        [nearer * np.ones(lead_speed.size), np.ones(lead_speed.size)]
    )
    # In small parts, so that the tables of cumulative hazards stay in the processor's cache.
    for first in range(0, lead_speed.size, PART):
        part = slice(first, first + PART)
        along_speed = SUPPORT.bases[0](lead_speed[part])
        range_[part] = SUPPORT.range_max * np.exp(
            -family.ranges.cumulative(along_speed).inverse(levels[0, part])
        )
        given, level = law.given(Places.of(lead_speed[part], range_[part])), levels[1, part]
        if fastest is not None:
            level = -np.log1p(-np.expm1(-level) * np.expm1(-given.cumulative(fastest[part])))
        speed[part] = given.inverse(level)
    return DistinctRecords(lead_speed, range_, faster * speed)


@dataclass(frozen=True)
class TwoKindsOfDrivers:
    """A few drivers cut in at shorter ranges and with higher closing speeds, in body and tail."""

    family: LawFamily
    law: SpeedLaw
    share: float = SHARE
    nearer: float = NEARER
    faster: float = FASTER

    def draw(self, lead_speed: Array, generator: np.random.Generator) -> DistinctRecords:
        """Draw the kind of each driver first."""
        second = self.is_second(lead_speed.size, generator)
        return draw_smooth(
            self.family,
            self.law,
            lead_speed,
            generator,
            np.where(second, self.nearer, 1.0),
            np.where(second, self.faster, 1.0),
        )

    def is_second(self, size: int, generator: np.random.Generator) -> NDArray[np.bool_]:
        """Return which of the cut-ins are made by the second kind of drivers, at random."""
        return generator.random(size) < self.share

    def masses(self, lines: CrashLines) -> Array:
        """Return the probability of the intervals under both kinds."""
        laws, places = SmoothDraws.of_laws(self.family.ranges, [self.law]), lines.places
        slower = replace(lines, start=lines.start / self.faster, end=lines.end / self.faster)
        beyond = places.range_hazards(self.family.ranges).at(np.log(SUPPORT.range_max / places.range_))
        nearer = self.nearer * np.exp((1 - self.nearer) * beyond)  # ratio of the densities of the range
        first, second = (each.masses(laws)[0] for each in (lines, slower))
        return (1 - self.share) * first + self.share * second * nearer[lines.row]


class Ended(Generalised):
    """The generalised Pareto law itself, which ends where its shape is below zero."""

    name = "ended"

    def cumulative(self, z: Array, parameters: Array) -> Array:
        """Return H(z), infinite beyond the end."""
        with np.errstate(divide="ignore"):
            return np.log(np.maximum(1 + parameters[0] * z, 0)) / parameters[0]

    def inverse(self, level: Array, parameters: Array) -> Array:
        """Return the excess at which H reaches a level."""
        return np.expm1(parameters[0] * level) / parameters[0]


def worlds(family: LawFamily, law: IndependentLaw) -> dict[str, World]:
    """Return all kinds of worlds, made from fits to the records."""
    tail = family.tails[Member(LEVEL, "exponential")]
    base = SpeedLaw(family.body, family.thresholds[LEVEL], tail)

    def shaped(shape: float) -> SpeedLaw:
        kind = Generalised() if shape > 0 else Ended()
        return replace(base, tail=replace(tail, shape=kind, parameters=np.array([shape])))

    return {
        "paper": Independent(law),
        "exponential": Smooth(family, base),
        "heavy": Smooth(family, shaped(0.1)),
        "light": Smooth(family, shaped(-0.1)),
        "two kinds": TwoKindsOfDrivers(family, base),
    }
