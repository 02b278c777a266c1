"""Simulations of opening cut-ins behind a lead vehicle that changes its speed, whose crashes are very rare.

Recorded opening cut-ins are drawn with replacement, together with the inputs of a law of lead motion. The
draws are made in rounds. In the first round, short ranges and rare motions are drawn preferentially. In later
rounds, half of the draws are concentrated where earlier rounds came closest to a crash: the lead speed, the
range, the closing speed and each input are drawn in parts of their ranks, with probabilities from the crashes
found so far (the Cross-Entropy method, Rubinstein and Kroese 2004). The weight of a draw is the density of
the law divided by the mean density of all rounds (adaptive multiple importance sampling, Cornuet and others
2012), so that every round counts, the first one included.

The rounds end when the crashes have a sufficient effective number, or at a largest number of rounds. If the
crashes are then too few for an estimate, cut-ins are drawn without preference, so that the upper limit of the
probability is small. The crashes of a random vehicle depend on variables that are not among the inputs, so
its rounds are not concentrated: they would miss crashes elsewhere.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from fewruns.weights import effective_number
from numpy.typing import NDArray

from accelerated_evaluation.answer.ways.posterior import FEWEST
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.motion import LeadMotion, draw_wide_inputs, wide_density
from accelerated_evaluation.laws.smooth.family import DistinctRecords

# Ends of the parts of a rank or an input; the outer ones are small, because crashes are at the extremes.
EDGES = np.array([0, 1e-4, 1e-3, 0.01, 0.05, 0.2, 0.5, 0.8, 0.95, 0.99, 0.999, 0.9999, 1.0])
WIDTHS = np.diff(EDGES)
ROUND = 20_000  # number of cut-ins in a round
LEAST, MOST = 8, 15  # smallest and largest number of rounds
ENOUGH = 50  # effective number of crashes at which the rounds end
PLAIN = 900_000  # number of cut-ins that are drawn without preference if the crashes are too few
CLOSEST = 200  # number of cut-ins, crashes first, on which a round is concentrated
FLAT = 0.2  # share of the concentrated draws that is spread over all parts
CONCENTRATED = 0.5  # share of the concentrated draws in a round

# A function of rows of recorded cut-ins, shape (n,), and inputs, (n, inputs). It returns whether each cut-in
# crashes with a constant lead speed and with each law of motion, (1 + laws, n), and how near it comes to a
# crash with the first law, (n,).
Simulate = Callable[[NDArray[np.intp], Array], tuple[Array, Array]]


def parts_of(values: Array) -> NDArray[np.intp]:
    """Return the number of the part, between two `EDGES`, of each value from 0 to 1."""
    return np.clip(np.searchsorted(EDGES, values, side="right") - 1, 0, WIDTHS.size - 1)


@dataclass(frozen=True)
class Preferred:
    """Draws that prefer short ranges and rare motions, or draws of the law if it prefers nothing."""

    chance: Array  # probability of each recorded cut-in, (n,)
    is_plain: bool = False

    def draw(self, motion: LeadMotion, size: int, generator: np.random.Generator) -> tuple[Array, Array]:
        """Return rows of recorded cut-ins, shape (size,), and inputs of a law of motion, (size, inputs)."""
        row = generator.choice(self.chance.size, size, p=self.chance)
        if self.is_plain:
            return row, generator.random((size, motion.inputs))
        return row, draw_wide_inputs(motion, size, generator)[0]

    def density(self, row: NDArray[np.intp], inputs: Array) -> Array:
        """Return the density of draws divided by that of the law, shape (n,)."""
        return self.chance[row] * self.chance.size * (1.0 if self.is_plain else wide_density(inputs))


@dataclass(frozen=True)
class Concentrated:
    """Draws of which a part is where the vehicle came closest to a crash."""

    first: Preferred  # the other draws
    chance: Array  # probability of each recorded cut-in, (n,)
    masses: Array  # probability of each part of each input, (inputs, parts)

    def draw(self, motion: LeadMotion, size: int, generator: np.random.Generator) -> tuple[Array, Array]:
        """Return rows of recorded cut-ins, shape (size,), and inputs of a law of motion, (size, inputs)."""
        row, inputs = self.first.draw(motion, size, generator)
        near = np.flatnonzero(generator.random(size) < CONCENTRATED)
        row[near] = generator.choice(self.chance.size, near.size, p=self.chance)
        for k, masses in enumerate(self.masses):
            part = generator.choice(WIDTHS.size, near.size, p=masses)
            inputs[near, k] = EDGES[part] + WIDTHS[part] * generator.random(near.size)
        return row, inputs

    def density(self, row: NDArray[np.intp], inputs: Array) -> Array:
        """Return the density of draws divided by that of the law, shape (n,)."""
        near = self.chance[row] * self.chance.size
        for masses, values in zip(self.masses, inputs.T, strict=True):
            near *= (masses / WIDTHS)[parts_of(values)]
        return CONCENTRATED * near + (1 - CONCENTRATED) * self.first.density(row, inputs)


def opening_terms(
    simulate: Simulate,
    recorded: DistinctRecords,
    motion: LeadMotion,
    effort: float,
    generator: np.random.Generator,
    *,
    concentrates: bool = True,
) -> tuple[Array, float]:
    """Return weighted crashes of opening cut-ins, shape (2, n), and the largest possible weight.

    Their means are the crash probabilities with a constant lead speed and with lead motion, which have the
    same draws. ``effort`` is a factor of the numbers of simulations.
    """
    count = recorded.size
    values = np.array([recorded.lead_speed, recorded.range_, recorded.closing_speed])
    parts = parts_of((scipy.stats.rankdata(values, method="ordinal", axis=1) - 0.5) / count)
    nearness = 1 / recorded.range_
    first = Preferred((1 / count + nearness / nearness.sum()) / 2)
    laws, sizes = [], []
    row, inputs = np.empty(0, np.intp), np.empty((0, motion.inputs))
    crashes, score = np.empty((2, 0)), np.empty(0)
    weights = score

    def add(law: Preferred | Concentrated, size: int) -> Array:
        """Simulate further draws, and return all weighted crashes."""
        nonlocal row, inputs, crashes, score, weights
        new = law.draw(motion, size, generator)
        # In the order of the records, because a law of motion is faster for encounters that are repeated.
        order = np.argsort(new[0], kind="stable")
        row, inputs = np.append(row, new[0][order]), np.vstack([inputs, new[1][order]])
        crash, near = simulate(row[-size:], inputs[-size:])
        crashes, score = np.hstack([crashes, crash]), np.append(score, near)
        laws.append(law)
        sizes.append(size)
        weights = np.zeros(row.size)
        shown = crashes.any(axis=0)
        shown[closest(score)] = True
        densities = [each.density(row[shown], inputs[shown]) for each in laws]
        weights[shown] = 1 / np.average(densities, axis=0, weights=sizes)
        return weights * crashes

    law: Preferred | Concentrated = first
    for number in range(1, MOST + 1):
        terms = add(law, round(effort * ROUND))
        if number >= LEAST and (not crashes.any() or effective_number(terms[1]) >= ENOUGH):
            break
        if concentrates:
            chosen = np.flatnonzero(crashes[1])
            if chosen.size < CLOSEST:
                chosen = closest(score)
            law = _concentrated(first, parts, row[chosen], inputs[chosen], weights[chosen])
    largest = (
        2 * 2 / (1 - CONCENTRATED * concentrates)
    )  # of the preferred draws, which are a part of each round
    if effective_number(terms[1]) < FEWEST:
        plain = round(effort * PLAIN)
        terms = add(Preferred(np.full(count, 1 / count), is_plain=True), plain)
        largest = sum(sizes) / plain
    return terms, largest


def closest(score: Array) -> NDArray[np.intp]:
    """Return the indices of the `CLOSEST` smallest scores, smallest first and then in their order.

    Few scores are sorted, which takes a tenth of the time of sorting millions.
    """
    few = np.arange(score.size)
    if score.size > CLOSEST:
        few = np.flatnonzero(score <= np.partition(score, CLOSEST)[CLOSEST])
    return few[np.argsort(score[few], kind="stable")[:CLOSEST]]


def _concentrated(
    first: Preferred, parts: Array, row: NDArray[np.intp], inputs: Array, weights: Array
) -> Concentrated:
    """Return the law of a round from weighted crashes, or cut-ins closest to one.

    ``parts`` are those of the ranks of the recorded cut-ins, shape (3, n).
    """
    share, chance = weights / weights.sum(), np.ones(parts.shape[1])
    for own in parts:
        usual = np.bincount(own, minlength=WIDTHS.size) / own.size
        masses = FLAT * usual + (1 - FLAT) * np.bincount(own[row], share, WIDTHS.size)
        chance *= np.divide(masses, usual, out=np.zeros_like(usual), where=usual > 0)[own]
    flat = FLAT / WIDTHS.size
    masses = [flat + (1 - FLAT) * np.bincount(parts_of(own), share, WIDTHS.size) for own in inputs.T]
    return Concentrated(first, chance / chance.sum(), np.reshape(masses, (-1, WIDTHS.size)))
