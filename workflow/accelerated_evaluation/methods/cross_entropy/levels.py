"""The sample of one iteration of a search, and the event that its update uses (sections V.C.1, 2 and 5)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws import Factors
from accelerated_evaluation.methods.cross_entropy.families import ProposalFamily
from accelerated_evaluation.methods.importance_sampling import Sample
from accelerated_evaluation.methods.problem import Problem

Families = tuple[ProposalFamily, ProposalFamily]  # of 1 / range and of 1 / TTC


@dataclass(frozen=True)
class SearchSettings:
    """Settings of the Cross-Entropy search."""

    sample_size: int = 1000  # number N of simulations in an iteration
    # Share of a sample that belongs to the next relaxed event, as long as the crash is too rare.
    event_quantile: float = 0.1
    # Threshold of the range over threshold of the time to collision [m/s]; small, because encounters that
    # merely begin at a short range are not dangerous and would mislead the search.
    range_per_ttc: float = 0.1
    # Smallest number of events in an iteration; more batches of N are simulated to find them (section V.C.2).
    minimum_events: int = 50
    maximum_batches: int = 5  # largest number of batches of N simulations in one iteration
    # The search ends after so many consecutive updates in which the event was the crash itself.
    crash_iterations: int = 2
    maximum_iterations: int = 60


@dataclass(frozen=True)
class Shift:
    """Steps by which truncation points move up, and when; without steps they are fixed."""

    inverse_range: float = 0.0  # [1/m]
    inverse_ttc: float = 0.0  # [1/s]
    every_iteration: bool = False  # False: only if an iteration has too few events (section V.C.5)

    def raised(self, families: Families, events: tuple[Array, Array] | None = None) -> Families:
        """Return the families whose tail has its largest weight with truncation points one step higher.

        If the coordinates of events are given, the last truncation point stays at least one step below all.
        """
        first, second = events or (None, None)
        return families[0].raised(self.inverse_range, first), families[1].raised(self.inverse_ttc, second)


@dataclass(frozen=True)
class Level:
    """The sample of one iteration, the families from which it was drawn, and its event."""

    families: Families
    sample: Sample
    happened: NDArray[np.bool_]  # whether each simulation belongs to the event, shape (n,)
    threshold: float  # t_TTC of the event [s]
    simulations: int  # of this iteration, including those from which the truncation points moved away

    @property
    def events(self) -> tuple[Array, Array]:
        """Coordinates of the events, 1 / range [1/m] and 1 / TTC [1/s], each of shape (events,)."""
        return self.sample.first[self.happened], self.sample.second[self.happened]

    @property
    def weight(self) -> Array:
        """Importance weights f / f* of the events, divided by the largest one, shape (events,)."""
        log_ratio = self.sample.log_ratio[self.happened]
        # Only the ratios of weights matter, and the largest log ratio may be too large for exp.
        return np.exp(log_ratio - log_ratio.max(initial=-np.inf))


def draw_level(
    problem: Problem,
    stratum: str,
    families: Families,
    settings: SearchSettings,
    shift: Shift,
    threshold: float,
    generator: np.random.Generator,
) -> Level:
    """Draw the sample of an iteration, and choose its event, whose threshold [s] never rises.

    The threshold is the event quantile of the scores of N simulations. If this is not below the previous
    threshold, the relaxed events no longer improve f*. More batches of N are then drawn until the crash has
    happened ``minimum_events`` times, and the threshold is the score of rank ``minimum_events``. Further
    batches follow while a large piece has too few events. At most ``maximum_batches`` are drawn.

    The paper's heuristic acts if even the previous threshold has fewer than ``minimum_events`` events: the
    truncation points move up (`Shift.raised`), and the simulations before the move are not used.
    """

    def draw(families: Families) -> Sample:
        proposal = Factors(families[0].distribution, families[1].distribution)
        return Sample.of(problem, stratum, proposal, generator, settings.sample_size)

    def enough(sample: Sample) -> bool:
        scores = event_score(sample, settings.range_per_ttc)
        return bool(np.count_nonzero(scores <= threshold) >= settings.minimum_events)

    sample, batches = draw(families), 1
    quantile = _smallest(sample, settings, int(settings.event_quantile * settings.sample_size))
    if quantile < threshold:
        threshold = quantile
    else:
        while batches < settings.maximum_batches and sample.happened.sum() < settings.minimum_events:
            moved = families if shift.every_iteration or enough(sample) else shift.raised(families)
            sample = sample.join(draw(moved)) if moved == families else draw(moved)
            families, batches = moved, batches + 1
        threshold = min(threshold, _smallest(sample, settings, settings.minimum_events))
    while True:
        happened = event_score(sample, settings.range_per_ttc) <= threshold
        level = Level(families, sample, happened, threshold, batches * settings.sample_size)
        if batches >= settings.maximum_batches or _determines_large_pieces(level):
            return level
        sample, batches = sample.join(draw(families)), batches + 1


def event_score(sample: Sample, range_per_ttc: float) -> Array:
    """Return for each simulation the smallest threshold t_TTC [s] of a relaxed event to which it belongs.

    This is min(TTC, R / range_per_ttc), with the smallest time to collision and the smallest range of the
    simulation and ``range_per_ttc`` in m/s, and 0 if the event itself happened; shape (n,).
    """
    outcomes = sample.outcomes
    near = np.minimum(outcomes.min_ttc, outcomes.min_range / range_per_ttc)
    return np.where(sample.happened, 0.0, near)


def _smallest(sample: Sample, settings: SearchSettings, rank: int) -> float:
    """Return the score of a rank, counted from 1 and limited to the size of the sample [s]."""
    scores = event_score(sample, settings.range_per_ttc)
    place = min(max(rank, 1), scores.size) - 1
    return float(np.partition(scores, place)[place])


def _determines_large_pieces(level: Level) -> bool:
    """Return whether every piece with a large share of the events' weight has enough of them (V.C.2)."""
    pairs = zip(level.families, level.events, strict=True)
    return all(family.is_determined(x, level.weight) for family, x in pairs)
