"""The Cross-Entropy search for f* through relaxed events that shrink to the crash (section V, appendix C)."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws import Factors
from accelerated_evaluation.methods.cross_entropy.families import PiecewiseFamily, ProposalFamily
from accelerated_evaluation.problem import Problem, Sample


@dataclass(frozen=True)
class SearchSettings:
    """Settings of the search.

    Attributes
    ----------
    sample_size
        Number N of simulations of an iteration.
    event_quantile
        Share of a sample that belongs to the next relaxed event, while the crash is too rare.
    range_per_ttc
        Ratio of the range threshold t_R [m] to the threshold t_TTC [s]. It is small, because encounters that
        only begin at a short range are not dangerous and would mislead the search.
    minimum_events
        Least number of events in an iteration; N is increased to find them (section V.C.2).
    maximum_batches
        Largest number of batches of N in one iteration.
    crash_iterations
        The search ends after this number of consecutive updates with the crash itself.
    maximum_iterations
        Limit of the number of iterations.
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
    """The state of a search.

    Attributes
    ----------
    first, second
        The families of both coordinates with their current parameters.
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
        """Return the next state, with its parameters added to the row of the trace."""
        parameters = {
            f"{coordinate}_{name}": value
            for coordinate, family in zip(COORDINATES, (first, second), strict=True)
            for name, value in family.parameters().items()
        }
        row = {"iteration": len(self.trace) + 1, **row, **parameters}
        return Search(first, second, [*self.trace, row])


@dataclass(frozen=True)
class Shift:
    """Steps by which the heuristic moves truncation points up (section V.C.5), in the coordinates' units."""

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
    """Search f* of one stratum by the Cross-Entropy method.

    Every iteration draws N cut-ins from f*. Its event is the widest relaxed event "R reaches t_R or TTC
    reaches t_TTC" that is rare enough (section V.C.1), and the weighted likelihood of the events is
    maximized. A search that does not reach the crash still returns its last f*, and reports this. Estimates
    with this f* are valid, and without an event they give a bound.

    Parameters
    ----------
    problem, stratum
        The law, the vehicle and the event; and the name of the stratum.
    start
        Families of both coordinates with the initial parameters; their kind distinguishes the methods single
        and piecewise.
    settings
        Sample size, thresholds and limits.
    generator
        Source of all randomness.
    shift
        Steps by which the heuristic moves truncation points; None for the plain method.
    on_iteration
        Function that is called with every row of the trace.

    Returns
    -------
    Search
        The last f*, and the trace: thresholds, events, effective sample size, parameters, simulations. It is
        unfinished if the crash itself was not the event of the last ``crash_iterations`` updates, or if no
        simulation of an iteration ended in the relaxed event.
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
    """Return the smallest t such that R reaches t range_per_ttc or TTC reaches t, shape (n,).

    It is 0 if the event happened.
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
    """Draw an iteration's sample and its threshold, which never rises.

    The threshold is the event quantile of the sample. Where that is no longer below the last one, f* is
    as good as this event can teach it: N is adjusted until the event itself is seen often enough, or at least
    until there are enough relaxed events under a smaller threshold.
    """
    sample = problem.sample(stratum, proposal, generator, settings.sample_size)
    rank = max(int(settings.event_quantile * settings.sample_size), 1)
    quantile = np.partition(event_score(sample, settings.range_per_ttc), rank - 1)[rank - 1]
    if quantile < threshold:
        return sample, float(quantile)
    for _ in range(settings.maximum_batches - 1):
        if np.count_nonzero(sample.happened) >= settings.minimum_events:
            break
        sample = sample.join(problem.sample(stratum, proposal, generator, settings.sample_size))
    scores = event_score(sample, settings.range_per_ttc)
    rank = min(settings.minimum_events, scores.size)
    return sample, min(threshold, float(np.partition(scores, rank - 1)[rank - 1]))


def _shifted(family: ProposalFamily, step: float, events: Array) -> ProposalFamily:
    """Shift truncation points up by one step where the tail is full and keeps a step below all events."""
    if not (step > 0 and isinstance(family, PiecewiseFamily) and family.tail_is_full):
        return family
    return family.shifted(step) if family.model.knots[-1] + 2 * step <= events.min() else family
