"""The Cross-Entropy search for f* (section V, appendix C).

The crash is too rare to be observed in the first samples. The search therefore begins with relaxed events,
such as a short time to collision, and makes them stricter until the event is the crash itself.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws import Factors
from accelerated_evaluation.methods.cross_entropy.families import PiecewiseFamily, ProposalFamily
from accelerated_evaluation.methods.cross_entropy.sample import Sample
from accelerated_evaluation.problem import Problem


@dataclass(frozen=True)
class SearchSettings:
    """Settings of the Cross-Entropy search.

    Attributes
    ----------
    sample_size
        Number N of simulations in an iteration.
    event_quantile
        Share of a sample that belongs to the next relaxed event, as long as the crash is too rare.
    range_per_ttc
        Ratio of the threshold t_R of the range [m] to the threshold t_TTC of the time to collision [s], hence
        [m/s]. It is small, because encounters that merely begin at a short range are not dangerous and would
        mislead the search.
    minimum_events
        Smallest number of events in an iteration. More batches of N are simulated to find them (section
        V.C.2).
    maximum_batches
        Largest number of batches of N simulations in one iteration.
    crash_iterations
        The search ends after this number of consecutive updates in which the event was the crash itself.
    maximum_iterations
        Largest number of iterations.
    """

    sample_size: int = 1000
    event_quantile: float = 0.1
    range_per_ttc: float = 0.1
    minimum_events: int = 50
    maximum_batches: int = 5
    crash_iterations: int = 2
    maximum_iterations: int = 60


COORDINATES = ("inverse_range", "inverse_ttc")  # names of the two coordinates in the trace


@dataclass(frozen=True)
class Search:
    """The state of a search in one stratum.

    Attributes
    ----------
    first, second
        The families of both coordinates, 1 / range and 1 / TTC, with their current parameters.
    trace
        A row for each iteration.
    unfinished
        Reason if the search ended before the crash itself was used for the updates; otherwise empty.
    """

    first: ProposalFamily
    second: ProposalFamily
    trace: list[dict[str, float]] = field(default_factory=list)
    unfinished: str = ""

    @property
    def proposal(self) -> Factors:
        """The accelerated distribution f*."""
        return Factors(self.first.distribution, self.second.distribution)

    @property
    def simulations(self) -> int:
        """Number of simulations so far."""
        return int(self.trace[-1]["simulations_total"]) if self.trace else 0

    def advance(self, first: ProposalFamily, second: ProposalFamily, row: dict[str, float]) -> "Search":
        """Return the next state of the search.

        Parameters
        ----------
        first, second
            The families of both coordinates with their new parameters.
        row
            Numbers of this iteration. They are added to the trace, with the parameters of both families.
        """
        parameters = {
            f"{coordinate}_{name}": value
            for coordinate, family in zip(COORDINATES, (first, second), strict=True)
            for name, value in family.parameters().items()
        }
        row = {"iteration": len(self.trace) + 1, **row, **parameters}
        return Search(first, second, [*self.trace, row])


@dataclass(frozen=True)
class Shift:
    """Steps by which the heuristic moves truncation points up (section V.C.5).

    Attributes
    ----------
    inverse_range, inverse_ttc
        Steps for 1 / range [1/m] and for 1 / TTC [1/s].
    """

    inverse_range: float = 0.0
    inverse_ttc: float = 0.0


def search(
    problem: Problem,
    stratum: str,
    start: tuple[ProposalFamily, ProposalFamily],
    settings: SearchSettings,
    generator: np.random.Generator,
    *,
    shift: Shift | None = None,
    on_iteration: Callable[[dict[str, float]], None] = lambda _: None,
) -> Search:
    """Search for the accelerated distribution f* of one stratum by the Cross-Entropy method.

    Every iteration simulates N cut-ins drawn from the current f*. A cut-in belongs to the relaxed event if
    its range falls to t_R or its time to collision falls to t_TTC. The thresholds are chosen such that a
    given share of the sample belongs to this event, and they never rise (section V.C.1). The new f* maximises
    the weighted likelihood of the events. A search that does not reach the crash still returns its last f*,
    with the reason. Estimates with this f* are valid, and if they contain no event they give an upper limit.

    Parameters
    ----------
    problem, stratum
        The law, the vehicle and the event; and the name of the stratum.
    start
        Families of both coordinates with the initial parameters: `SingleFamily` for the method single,
        `PiecewiseFamily` for piecewise and heuristic.
    settings
        Sample size, thresholds and limits.
    generator
        Source of all randomness.
    shift
        Steps by which the heuristic moves truncation points; None if the truncation points are fixed.
    on_iteration
        Function that is called with every row of the trace.

    Returns
    -------
    Search
        The last f*, and the trace: thresholds, events, effective sample size, parameters and simulations of
        each iteration. The search is unfinished if the crash itself was not the event of the last
        ``crash_iterations`` updates, or if no simulation of an iteration ended in the relaxed event.
    """
    row = {"threshold_ttc_s": math.nan, "threshold_range_m": math.nan, "simulations_total": 0}
    state = Search(*start).advance(*start, row)
    on_iteration(state.trace[-1])
    threshold, at_event, steps = math.inf, 0, shift or Shift()
    while len(state.trace) <= settings.maximum_iterations:
        sample, threshold = _draw_level(problem, stratum, state.proposal, settings, threshold, generator)
        chosen = event_score(sample, settings.range_per_ttc) <= threshold
        if not chosen.any():
            return _unfinished(
                state, settings, f"no event down to {threshold:.3g} s in {chosen.size} simulations"
            )
        log_ratio = sample.log_ratio[chosen]
        # Only the ratios of weights matter, and the largest log ratio may be too large for exp.
        weight = np.exp(log_ratio - log_ratio.max())
        first, second = sample.first[chosen], sample.second[chosen]
        families = state.first.update(first, weight), state.second.update(second, weight)
        moved = (
            _shifted(families[0], steps.inverse_range, first),
            _shifted(families[1], steps.inverse_ttc, second),
        )
        at_event = at_event + 1 if threshold == 0 and moved == families else 0
        row = {
            "threshold_ttc_s": threshold,
            "threshold_range_m": threshold * settings.range_per_ttc,
            "simulations": chosen.size,
            "simulations_total": state.simulations + chosen.size,
            "events": int(chosen.sum()),
            "crashes": int(sample.happened.sum()),
            "effective_sample_size": weight.sum() ** 2 / np.square(weight).sum(),
        }
        state = state.advance(*moved, row)
        on_iteration(state.trace[-1])
        if at_event == settings.crash_iterations:
            return state
    return _unfinished(state, settings, f"events down to a time to collision of {threshold:.3g} s")


def _unfinished(state: Search, settings: SearchSettings, reached: str) -> Search:
    limit = f"{settings.maximum_iterations} iterations of {settings.sample_size} simulations"
    reason = f"the search did not come to the event: it reached {reached}, within {limit}"
    return replace(state, unfinished=reason)


def event_score(sample: Sample, range_per_ttc: float) -> Array:
    """Return for each simulation the smallest threshold t_TTC [s] of a relaxed event to which it belongs.

    This is min(TTC, R / range_per_ttc), with the smallest time to collision and the smallest range of the
    simulation, and 0 if the event itself happened; shape (n,).

    Parameters
    ----------
    sample
        Simulated cut-ins.
    range_per_ttc
        Ratio of the threshold of the range to that of the time to collision [m/s].
    """
    outcomes = sample.outcomes
    near = np.minimum(outcomes.min_ttc, outcomes.min_range / range_per_ttc)
    return np.where(sample.happened, 0.0, near)


def _draw_level(
    problem: Problem,
    stratum: str,
    proposal: Factors,
    settings: SearchSettings,
    threshold: float,
    generator: np.random.Generator,
) -> tuple[Sample, float]:
    """Draw the sample of an iteration, and return it with its threshold [s], which never rises.

    The threshold is the event quantile of the scores of the sample. If this is not below the previous
    threshold, the relaxed events no longer improve f*. More batches are then drawn until the event itself has
    happened ``minimum_events`` times, or ``maximum_batches`` is reached, and the threshold is the score of
    rank ``minimum_events``.
    """
    sample = Sample.of(problem, stratum, proposal, generator, settings.sample_size)
    rank = max(int(settings.event_quantile * settings.sample_size), 1)
    quantile = np.partition(event_score(sample, settings.range_per_ttc), rank - 1)[rank - 1]
    if quantile < threshold:
        return sample, float(quantile)
    for _ in range(settings.maximum_batches - 1):
        if np.count_nonzero(sample.happened) >= settings.minimum_events:
            break
        sample = sample.join(Sample.of(problem, stratum, proposal, generator, settings.sample_size))
    scores = event_score(sample, settings.range_per_ttc)
    rank = min(settings.minimum_events, scores.size)
    return sample, min(threshold, float(np.partition(scores, rank - 1)[rank - 1]))


def _shifted(family: ProposalFamily, step: float, events: Array) -> ProposalFamily:
    """Move the truncation points up by one step if the tail has its largest weight.

    They are moved only if the last one then still lies at least one step below all events.
    """
    if not (step > 0 and isinstance(family, PiecewiseFamily) and family.tail_is_full):
        return family
    return family.shifted(step) if family.model.knots[-1] + 2 * step <= events.min() else family
