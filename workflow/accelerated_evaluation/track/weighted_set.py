"""A weighted set of concrete encounters, from which the crash probability of any vehicle can be estimated.

Cut-ins are sorted by their severity for any vehicle: the constant deceleration a = C^2 / (2 R), with closing
speed C and range R, that just avoids the crash if it begins at once. Cut-ins below a smallest deceleration
are assumed to be safe. The others are divided into shells of a, each of which has a known probability P_k
under the law. The same number n_k of cut-ins is drawn from each shell under the law, and each has the weight
P_k / n_k. The sum of the weights of the crashes is an unbiased estimate for every vehicle that does not crash
in the cut-ins that are assumed to be safe (stratified sampling: Cochran 1977, chapter 5). The encounters of
other scenarios are sorted by the score of a built-in vehicle instead; see `draw_scored_set`.
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
from accelerated_evaluation.laws import CutIns, Law
from accelerated_evaluation.laws.joint import JointLaw
from accelerated_evaluation.laws.smooth.mean import MeanLaw
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.loading import load_vehicle

DRAWS = 100  # of a mean law, under which the cut-ins are weighted
PLACES = 20_000  # lead speeds and ranges at which the probabilities of the shells are computed
GOLDEN = (math.sqrt(5) - 1) / 2
SHELLS = 15
HARDEST = 15.0  # [m/s^2], where the last shell begins: beyond what tyres can do on a dry road
LEAST = 2 * SHELLS  # cut-ins of a set; two of each shell give a variance
MOST = 300
POOL = 200_000  # encounters of another scenario that are sorted by their scores
HARDEST_SHARE = 1e-3  # of them, in the last shell
EDGE = 1e-12  # numbers of the lattice stay that far from 0 and 1


@dataclass(frozen=True)
class WeightedSet:
    """Cut-ins with the shells that they represent.

    Attributes
    ----------
    table
        A row for each cut-in: ``scenario`` (its number, from 1), ``shell`` (from 1), ``weight``,
        ``lead_speed`` [m/s], ``range`` [m] and ``closing_speed`` [m/s].
    edges
        Value at which each shell begins: the deceleration [m/s^2] of a cut-in, or the score of a built-in
        vehicle. The last shell has no end.
    probabilities
        Probabilities of the shells under the law.
    draws
        Under a mean law, the weights of each cut-in under draws of the law: ``scenario``, then ``draw_001``
        and so on. None under a law of which no draws are known.
    """

    table: pd.DataFrame
    edges: Array
    probabilities: Array
    draws: pd.DataFrame | None = None

    @property
    def assumed_safe(self) -> float:
        """Probability of the cut-ins that are assumed to be safe."""
        return 1 - float(self.probabilities.sum())


def draw_weighted_set(
    law: Law, size: int, safe_deceleration: float, generator: np.random.Generator
) -> WeightedSet:
    """Draw a weighted set of cut-ins.

    Parameters
    ----------
    law
        Law of the cut-ins.
    size
        Largest number of cut-ins; every shell gets the same number.
    safe_deceleration
        Cut-ins that a smaller constant deceleration [m/s^2] would avoid are assumed to be safe.
    generator
        Source of all randomness.

    Raises
    ------
    InputError
        If the size or the deceleration is out of range, or a shell has no probability under the law.
    """
    _check_size(size)
    _check_deceleration(safe_deceleration)
    if isinstance(law, MeanLaw):
        law = law.thinned(DRAWS)
    edges = np.geomspace(safe_deceleration, HARDEST, SHELLS)
    places, stratum = _places(law, generator)
    begin = _tails(law, places, stratum, edges)
    end = np.column_stack([begin[:, 1:], np.zeros(PLACES)])
    probabilities = (begin - end).mean(axis=0)
    if not probabilities.all():
        empty = f"{edges[np.argmin(probabilities > 0)]:.3g} m/s^2"
        raise InputError(
            "law",
            seen=f"no cut-in that needs a deceleration of {empty}",
            expected="cut-ins in every shell",
            change="Choose a smaller --safe-deceleration, or a law with a tail.",
        )
    count = size // SHELLS
    shells = (_Shell(law, places, stratum, *ends) for ends in zip(begin.T, end.T, strict=True))
    drawn = np.hstack([shell.draw(count, generator) for shell in shells])
    table = _table(("lead_speed", "range", "closing_speed"), drawn, probabilities, count)
    draws = _draws(law, table) if isinstance(law, MeanLaw) else None
    return WeightedSet(table, edges, probabilities, draws)


def draw_scored_set(
    scenario: Scenario, law: JointLaw, size: int, generator: np.random.Generator
) -> WeightedSet:
    """Draw a weighted set of encounters of any scenario.

    Draws of the law are simulated with the built-in vehicle of the scenario, and sorted by their scores for
    the crash. They are divided into shells whose numbers of draws are in geometric progression, and equally
    many encounters are selected from each shell at random (two-phase sampling for stratification: Cochran
    1977, chapter 12). No encounter is assumed to be safe. The sum of the weights of the crashes is unbiased
    for every vehicle, and more accurate if the vehicle resembles the built-in one.

    Parameters
    ----------
    scenario, law
        The scenario and a joint law of its variables.
    size
        Largest number of encounters; every shell gets the same number.
    generator
        Source of all randomness.

    Raises
    ------
    InputError
        If the size is out of range.
    """
    _check_size(size)
    encounters = scenario.to_inputs(law.sample(POOL, generator))
    known = load_vehicle(scenario.default_vehicle, scenario)
    score = scenario.events[0].score(known.simulate(*encounters.T))
    order = np.argsort(-score, kind="stable")  # the hardest last
    begins = POOL - np.round(POOL * np.geomspace(1, HARDEST_SHARE, SHELLS)).astype(int)
    shells, count = np.split(order, begins[1:]), size // SHELLS
    chosen = np.concatenate([generator.choice(shell, count, replace=False) for shell in shells])
    probabilities = np.array([len(shell) / POOL for shell in shells])
    table = _table(scenario.names, encounters[chosen].T, probabilities, count)
    return WeightedSet(table, score[order[begins]], probabilities)


def _table(names: Sequence[str], drawn: Array, probabilities: Array, count: int) -> pd.DataFrame:
    """Return encounters, shape (d, n), with their shells and weights, equally many of each shell."""
    return pd.DataFrame(
        {
            "scenario": np.arange(count * SHELLS) + 1,
            "shell": np.repeat(np.arange(SHELLS) + 1, count),
            "weight": np.repeat(probabilities / count, count),
            **dict(zip(names, drawn, strict=True)),
        }
    )


def _draws(law: MeanLaw, table: pd.DataFrame) -> pd.DataFrame:
    """Return the weight of each cut-in under every draw: its weight under their mean times f_k / f_mean."""
    lead_speed, range_, speed = (table[name].to_numpy() for name in ("lead_speed", "range", "closing_speed"))
    ratios = np.exp(law.log_ratios(CutIns(lead_speed, 1 / range_, speed / range_)))
    weights = (ratios * table["weight"].to_numpy()).T
    names = [f"draw_{number:03d}" for number in range(1, law.draws.size + 1)]
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


def _places(law: Law, generator: np.random.Generator) -> tuple[CutIns, NDArray[np.intp]]:
    """Return lead speeds and ranges that represent the law evenly, by rising lead speed, and their strata.

    They are a lattice with the golden ratio, moved at random, so that every mean over them is unbiased. Their
    closing speeds mean nothing.
    """
    place, shift = np.arange(PLACES), generator.random(2)
    u = np.column_stack([(place + shift[0]) / PLACES, (place * GOLDEN + shift[1]) % 1])
    z = np.column_stack([ndtri(np.clip(u, EDGE, 1 - EDGE)), np.zeros(PLACES)])
    return law.from_normal_scores(z), law.stratum_of_normal_scores(z)


def _tails(law: Law, places: CutIns, stratum: NDArray[np.intp], edges: Array) -> Array:
    """Return the probability of each edge or more at each place, shape (places, edges)."""
    tails = np.empty((len(places), edges.size))
    for index, part in enumerate(law.strata.values()):
        here = stratum == index
        lead_speed, inverse_range = places.lead_speed[here], places.inverse_range[here]
        closing_speeds = np.sqrt(2 * edges / inverse_range[:, None])
        tails[here] = part.factors.second.sf(part.second_at(lead_speed, inverse_range, closing_speeds))
    return tails


@dataclass(frozen=True)
class _Shell:
    """Places of a shell with the probabilities at which its closing speeds begin and end, shape (places,)."""

    law: Law
    places: CutIns
    stratum: NDArray[np.intp]
    begin: Array
    end: Array

    def draw(self, count: int, generator: np.random.Generator) -> Array:
        """Draw cut-ins by the law: lead speed, range and closing speed, shape (3, count).

        They are spread evenly over the lead speeds and over the closing speeds (Latin hypercube), which keeps
        the means and makes their errors smaller.
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
            lead_speed = self.places.lead_speed[chosen][here]
            first = part.first(lead_speed, self.places.inverse_range[chosen][here])
            cut_ins = part.cut_ins(lead_speed, first, part.factors.second.isf(tail[here]))
            closing_speed = self.law.capped(cut_ins.closing_speed)
            drawn[:, here] = cut_ins.lead_speed, cut_ins.range_, closing_speed
        return drawn
