"""A weighted set of concrete encounters, from which the crash probability of any vehicle can be estimated.

Cut-ins are ordered by a severity that does not depend on the vehicle: the constant deceleration a = C^2 / (2
R), with closing speed C and range R, that just avoids a crash if it begins immediately. Cut-ins below a
smallest deceleration are assumed to be safe. The others are divided into shells by a. Shell k has a known
probability P_k under the law. From each shell, the same number n of cut-ins is drawn under the law, and each
cut-in has the weight P_k / n. The sum of the weights of the crashes is an unbiased estimate of the crash
probability of every vehicle that does not crash in the cut-ins that are assumed to be safe (stratified
sampling: Cochran 1977, chapter 5). The encounters of other scenarios, and cut-ins of laws without strata, are
ordered by the score of a built-in vehicle instead; see `draw_scored_set`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtri

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws import Law, StratifiedLaw
from accelerated_evaluation.laws.draws import as_draws
from accelerated_evaluation.laws.strata import VARIABLES
from accelerated_evaluation.scenarios.protocol import Scenario

DRAWS = 100  # largest number of draws of the law under which the encounters are weighted
PLACES = 20_000  # number of pairs of lead speed and range at which probabilities of shells are computed
GOLDEN = (math.sqrt(5) - 1) / 2
SHELLS = 15  # number of shells
HARDEST = 15.0  # [m/s^2], lower end of the last shell; more than tyres reach on a dry road
LEAST = 2 * SHELLS  # smallest number of encounters; a variance needs two in each shell
MOST = 300  # largest number of encounters
POOL = 200_000  # number of encounters that are ordered by their scores
HARDEST_SHARE = 1e-3  # share of these encounters in the last shell
EDGE = 1e-12  # smallest distance of a number of the lattice from 0 and 1


@dataclass(frozen=True)
class WeightedSet:
    """A weighted set of encounters, with the shells that they represent."""

    # One row for each encounter: ``scenario`` and ``shell``, both numbered from 1, ``weight``, and the
    # variables of the scenario.
    table: pd.DataFrame
    # Value at which each shell begins: the deceleration [m/s^2] of a cut-in, or the score of a built-in
    # vehicle, (shells,). The last shell has no end.
    edges: Array
    probabilities: Array  # of each shell under the law, (shells,)
    # Weight of each encounter under some draws of the law: ``scenario``, ``draw_001`` and so on.
    draws: pd.DataFrame | None = None
    # Whether the encounters are ordered by the score of a built-in vehicle, and not by deceleration.
    scored: bool = False

    @property
    def assumed_safe(self) -> float:
        """Probability, under the law, of the cut-ins that are assumed never to end in a crash."""
        return 1 - float(self.probabilities.sum())


def draw_weighted_set(
    law: StratifiedLaw, size: int, safe_deceleration: float, generator: np.random.Generator
) -> WeightedSet:
    """Draw a weighted set of at most ``size`` cut-ins; all shells have the same number.

    A cut-in is assumed to be safe if a constant deceleration below ``safe_deceleration`` [m/s^2] avoids a
    crash. InputError is raised if the size or the deceleration is out of range, or a shell has no probability
    under the law.
    """
    _check_size(size)
    _check_deceleration(safe_deceleration)
    law = as_draws(law).thinned(DRAWS).law
    edges = np.geomspace(safe_deceleration, HARDEST, SHELLS)
    places, stratum = _places(law, generator)
    begin = _tails(law, places, stratum, edges)
    end = np.column_stack([begin[:, 1:], np.zeros(PLACES)])
    probabilities = (begin - end).mean(axis=0)
    if not probabilities.all():
        empty = f"{edges[np.argmin(probabilities > 0)]:.3g} m/s^2"
        raise InputError(
            "law",
            seen=f"no cut-ins that need a deceleration of {empty}",
            expected="cut-ins in every shell of deceleration",
            change="Choose a smaller --safe-deceleration, or a law with a longer tail.",
        )
    count = size // SHELLS
    shells = (_Shell(law, places, stratum, *ends) for ends in zip(begin.T, end.T, strict=True))
    drawn = np.hstack([shell.draw(count, generator) for shell in shells])
    table = _table(VARIABLES, drawn, probabilities, count)
    draws = None
    if as_draws(law).size > 1:
        draws = _weights_of_draws(table, as_draws(law).log_ratios(table[list(VARIABLES)].to_numpy()))
    return WeightedSet(table, edges, probabilities, draws)


def draw_scored_set(scenario: Scenario, law: Law, size: int, generator: np.random.Generator) -> WeightedSet:
    """Draw a weighted set of encounters of any scenario.

    `POOL` encounters are drawn from the law, or from the mean of its draws. They are simulated with the
    built-in vehicle of the scenario, and ordered by their scores for a crash. They are divided into shells,
    whose shares decrease in geometric progression. The same number of encounters is selected from each shell
    at random (two-phase sampling for stratification: Cochran 1977, chapter 12). No encounter is assumed to be
    safe. The sum of the weights of the crashes is an unbiased estimate for every vehicle, and more accurate
    if the vehicle is similar to the built-in one. At most `DRAWS` draws of the law are used, and the set has
    at most ``size`` encounters. InputError is raised if the size is out of range.
    """
    _check_size(size)
    draws = as_draws(law).thinned(DRAWS)
    x = draws.draw_from_mean(POOL, generator)
    pool = len(x)
    score = scenario.events[0].score(scenario.known_vehicle().simulate(*x.T))
    order = np.argsort(-score, kind="stable")  # the hardest last
    begins = pool - np.round(pool * np.geomspace(1, HARDEST_SHARE, SHELLS)).astype(int)
    shells, count = np.split(order, begins[1:]), size // SHELLS
    chosen = np.concatenate([generator.choice(shell, count, replace=False) for shell in shells])
    probabilities = np.array([len(shell) / pool for shell in shells])
    table = _table(scenario.names, x[chosen].T, probabilities, count)
    weights = None
    if draws.size > 1:
        weights = _weights_of_draws(table, draws.log_ratios_to_mean(x[chosen]))
    return WeightedSet(table, score[order[begins]], probabilities, weights, scored=True)


def _table(names: Sequence[str], drawn: Array, probabilities: Array, count: int) -> pd.DataFrame:
    """Return a table of encounters, shape (d, n), with their shells and weights."""
    return pd.DataFrame(
        {
            "scenario": np.arange(count * SHELLS) + 1,
            "shell": np.repeat(np.arange(SHELLS) + 1, count),
            "weight": np.repeat(probabilities / count, count),
            **dict(zip(names, drawn, strict=True)),
        }
    )


def _weights_of_draws(table: pd.DataFrame, log_ratios: Array) -> pd.DataFrame:
    """Return the weights of n encounters under K draws: those of the table times f_k / f_mean, (K, n)."""
    weights = (np.exp(log_ratios) * table["weight"].to_numpy()).T
    names = [f"draw_{number:03d}" for number in range(1, len(log_ratios) + 1)]
    return pd.DataFrame(weights, columns=names).assign(scenario=table["scenario"])[["scenario", *names]]


def _check_size(size: int) -> None:
    if not LEAST <= size <= MOST:
        expected = f"{LEAST} to {MOST} scenarios"
        raise InputError("--size", seen=str(size), expected=expected, change="Choose another size.")


def _check_deceleration(safe_deceleration: float) -> None:
    if not 0.1 <= safe_deceleration <= HARDEST / 2:
        raise InputError(
            "--safe-deceleration",
            seen=f"{safe_deceleration:g}",
            expected=f"0.1 to {HARDEST / 2:g} m/s^2",
            change="Choose another value.",
        )


def _places(law: StratifiedLaw, generator: np.random.Generator) -> tuple[Array, NDArray[np.intp]]:
    """Return lead speeds and ranges that represent the law evenly, by rising lead speed, and their strata.

    They are a lattice with the golden ratio and a random shift, so that every mean over them is unbiased. The
    closing speeds of the returned cut-ins are arbitrary and not used.
    """
    place, shift = np.arange(PLACES), generator.random(2)
    u = np.column_stack([(place + shift[0]) / PLACES, (place * GOLDEN + shift[1]) % 1])
    z = np.column_stack([ndtri(np.clip(u, EDGE, 1 - EDGE)), np.zeros(PLACES)])
    return law.from_normal_scores(z), law.stratum_of_normal_scores(z)


def _tails(law: StratifiedLaw, places: Array, stratum: NDArray[np.intp], edges: Array) -> Array:
    """Return the probability of at least each deceleration ``edges`` at each place, shape (places, edges)."""
    tails = np.empty((len(places), edges.size))
    for index, part in enumerate(law.strata.values()):
        here = stratum == index
        lead_speed, inverse_range = places[here, 0], 1 / places[here, 1]
        closing_speeds = np.sqrt(2 * edges / inverse_range[:, None])
        tails[here] = part.factors.second.sf(part.second_at(lead_speed, inverse_range, closing_speeds))
    return tails


@dataclass(frozen=True)
class _Shell:
    """A shell: its places, and the tail probabilities at the ends of its closing speeds, shape (places,)."""

    law: StratifiedLaw
    places: Array
    stratum: NDArray[np.intp]
    begin: Array
    end: Array

    def draw(self, count: int, generator: np.random.Generator) -> Array:
        """Draw cut-ins of the shell under the law: lead speed, range and closing speed, shape (3, count).

        A Latin hypercube spreads them evenly over lead speeds and closing speeds. This does not bias means
        over the cut-ins, and reduces their errors.
        """
        u = (
            generator.permuted(np.tile(np.arange(count), (2, 1)), axis=1) + generator.random((2, count))
        ) / count
        mass = np.cumsum(self.begin - self.end)
        chosen = np.searchsorted(mass / mass[-1], u[0])
        tail = self.end[chosen] + (self.begin - self.end)[chosen] * u[1]
        drawn = np.empty((3, count))
        for index, part in enumerate(self.law.strata.values()):
            here = self.stratum[chosen] == index
            lead_speed, range_, _ = self.places[chosen][here].T
            first = part.first(lead_speed, 1 / range_)
            drawn[:, here] = part.points(lead_speed, first, part.factors.second.isf(tail[here])).T
        drawn[2] = self.law.capped(drawn[2])
        return drawn
