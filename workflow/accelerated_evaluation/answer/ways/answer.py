"""The answer: the probability of an event over all laws that the records support, however it was computed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from accelerated_evaluation.answer.candidates.calibration import mid_p
from accelerated_evaluation.answer.ways.posterior import Posterior, SampledPosterior, answer_row, budget
from accelerated_evaluation.answer.ways.words import answer_in_words, budget_in_words
from accelerated_evaluation.base.arguments import Argument, a_number, if_it, one_of
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.randomness import A_GENERATOR
from accelerated_evaluation.laws import Law
from accelerated_evaluation.laws.draws import Draws, as_draws
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.vehicles.loading import checked_vehicle
from accelerated_evaluation.vehicles.protocol import CRASH, EVENTS, event_named

# An answer is rejected unless the mid-p value of the number of events among replayed records exceeds this
# value.
MISSED = 1e-4
QUANTILES = (0.1, 0.25, 0.5, 0.75, 0.9)  # levels of the quantiles of the impact speed


@checked()
@dataclass(frozen=True)
class Crashes:
    """Crashes with their probabilities under each draw of the law.

    For a crash map these are parts of intervals of the closing speed, otherwise simulated encounters.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> draws = ae.choose_draws("independent_variables", ae.read_records("left_turn"))
    >>> found = ae.evaluate(ae.Problem("left_turn", "acc_aeb"), draws, ae.Simulations(20_000), generator=1)
    >>> found.crashes.x.shape[1], bool(found.crashes.shares.max() <= 1)
    (3, True)
    """

    x: Array  # the encounters, shape (m, d)
    impact_speed: (
        Array  # [m/s], of some simulations of each crash, NaN where there was none, shape (m, points)
    )
    weights: Array  # probability of each crash under each draw, shape (K, m); a row sums to about P_k

    @property
    def shares(self) -> Array:
        """Share of each crash in the probability, averaged over the draws by their probabilities, (m,)."""
        weights = self.weights.mean(axis=0)
        return weights / weights.sum() if len(weights) else weights

    @checked(size=a_number(1, whole=True), generator=A_GENERATOR)
    def drawn(self, size: int, generator: np.random.Generator) -> Array:
        """Draw crashes from the mean of the draws, shape (size, d)."""
        return self.x[generator.choice(len(self.x), size, p=self.shares)]


@checked()
@dataclass(frozen=True)
class Replayed:
    """Records in which the event happened when the vehicle replayed them: a check that needs no law.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> turns = ae.read_records("left_turn")
    >>> replayed = ae.Replayed.of(ae.Problem("left_turn", "acc_aeb"), turns.x)
    >>> replayed.records, replayed.events < replayed.records
    (1028, True)
    """

    happened: NDArray[np.bool_]  # shape (n,)

    @classmethod
    @checked()
    def of(cls, problem: Problem, x: Array) -> Self:
        """Replay records x, shape (n, d)."""
        return cls(problem.event.happens(problem.simulate(x)))

    @property
    def events(self) -> int:
        """Number of records that end in the event."""
        return int(self.happened.sum())

    @property
    def records(self) -> int:
        """Number of records."""
        return len(self.happened)

    @checked(probability=a_number(0, 1))
    def supports(self, probability: float) -> bool:
        """Return whether the count is possible for a probability of the event in an encounter."""
        return bool(mid_p(self.events, self.records * probability) > MISSED)


@dataclass(frozen=True, repr=False)
class Answer:
    """The probability of the events of a problem under K draws of the law, and what it was computed from.

    Attributes
    ----------
    problem
        Scenario, vehicle and main event.
    draws
        The K draws of the law.
    posteriors
        The probability of each event under each draw, the main event first; None where the simulations give
        no estimate.
    crashes
        The crashes of which the probability consists; None if there was none.
    replayed
        The main event among replayed records; None if they were not replayed.
    simulations
        Number of simulations, if they were counted.
    converged
        Whether further simulations are expected to leave the answer as it is.
    tables
        Additional tables by name, such as ``runs``, the simulations of an answer from few runs.
    fixed
        The probability of the main event without sampling errors, if a part of the parameters of the draws is
        fixed at posterior means, by the name of the part.
    limits
        Upper ends of the intervals of the events (``high50`` and so on), which are used if their simulations
        give no estimate; without limits, those of an event that contains the event.

    See Also
    --------
    evaluate : compute an answer.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> draws = ae.choose_draws("independent_variables", ae.read_records("left_turn"))
    >>> found = ae.evaluate(ae.Problem("left_turn", "acc_aeb"), draws, ae.Simulations(20_000), generator=1)
    >>> found.in_words().splitlines()[-1]
    '20,000 simulations, converged; 1 draw of the law of encounters'
    """

    problem: Problem
    draws: Draws
    posteriors: Mapping[Event, Posterior | None]
    crashes: Crashes | None = None
    replayed: Replayed | None = None
    simulations: int | None = None
    converged: bool = True
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    fixed: Mapping[str, Posterior] = field(default_factory=dict)
    limits: Mapping[Event, Mapping[str, float]] = field(default_factory=dict)
    notes: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Limit the probability of each event by that of an event which contains it, in every draw."""
        coherent = dict(self.posteriors)
        for event in sorted(coherent, key=lambda each: len(self._containing(each))):
            own, containing = coherent[event], self._containing(event)
            within = coherent[containing[-1]] if containing else None
            if within is not None and isinstance(own, SampledPosterior):
                known = np.minimum(own.probabilities, within.probabilities)
                coherent[event] = replace(own, probabilities=known, within=within)
        object.__setattr__(self, "posteriors", coherent)

    def _containing(self, event: Event) -> list[Event]:
        """Return the events with a posterior that contain an event, the smallest one last."""
        others = [each for each, own in self.posteriors.items() if each != event and own is not None]
        found = [each for each in others if is_part(event, each)]
        return sorted(found, key=lambda each: sum(is_part(each, other) for other in found))

    def _limits(self, event: Event) -> Mapping[str, float]:
        """Return the known upper ends of the intervals of an event without a posterior."""
        if event in self.limits:
            return self.limits[event]
        rows = [answer_row(self.posteriors[each]) for each in self._containing(event)[-1:]]
        return {name: end for row in rows for name, end in row.items() if name.startswith("high")}

    @property
    def sampled(self) -> bool:
        """Whether the answer has a sampling error."""
        return self.posterior is None or self.posterior.is_sampled

    @property
    def posterior(self) -> Posterior | None:
        """The probability of the main event under each draw."""
        return self.posteriors[self.problem.event]

    @property
    def sources(self) -> tuple[str, ...]:
        """Sources of uncertainty that the intervals of the main event contain; none if it has no estimate."""
        return () if self.posterior is None else self.posterior.sources

    @property
    def crash_weights(self) -> Array:
        """Probability of each crash under each draw, shape (K, m); a row sums to that of the draw."""
        if self.crashes is None or self.posterior is None:
            return np.empty((self.draws.size, 0))
        weights = self.crashes.weights
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = self.posterior.probabilities / weights.sum(axis=1)  # sampled: without control variates
        scale = np.nan_to_num(scale, nan=1.0, posinf=1.0)
        # The weights of a crash map may need a GB, and already add up to the probability.
        return weights if (scale == 1).all() else weights * scale[:, None]

    @checked(events_per_km=a_number(0))
    def table(self, events_per_km: float | None = None) -> pd.DataFrame:
        """Return one row for each event: mean, median, 50, 80 and 95 % interval, and rate per kilometre.

        ``contains`` names the sources of uncertainty that the intervals contain (`Posterior.sources`).
        """
        rows = []
        for event, posterior in self.posteriors.items():
            row: dict[str, Any] = {"event": self.problem.scenario.event_in_words(event)}
            row |= answer_row(posterior, self._limits(event))
            rate = np.nan if events_per_km is None else row["probability"] * events_per_km
            contains = "" if posterior is None else ", ".join(posterior.sources)
            rows.append(row | {"per_km": rate, "contains": contains})
        return pd.DataFrame(rows)

    def impact_speeds(self) -> pd.DataFrame:
        """Return the mean and quantiles of the impact speed of the crashes of the main event, in m/s.

        A row is the ``mean`` or a quantile (`QUANTILES`). ``impact_speed_m_s`` is its value under the mean of
        the draws, and ``low95`` and ``high95`` are the ends of the 95 % interval of its values under the
        draws. InputError is raised if there is no crash, or if the scenario has no impact speed.
        """
        speeds = np.empty((0, 0)) if self.crashes is None else self.crashes.impact_speed
        known = ~np.isnan(speeds)
        if not known.any():
            raise InputError(
                "Answer.impact_speeds",
                seen="no crash" if not known.size else "crashes without an impact speed",
                expected=f"crashes of {self.problem.scenario.name} with the outcome impact_speed",
                change="Simulate more encounters, or use a scenario with this outcome.",
            )
        order = np.argsort(speeds[known], kind="stable")
        crash, speed = np.nonzero(known)[0][order], speeds[known][order]
        weights = self.crash_weights / np.maximum(known.sum(axis=1), 1)  # of each simulation of a crash
        values = []
        for shares in (weights.mean(axis=0), *weights):
            below = np.cumsum(shares[crash])
            if below[-1] > 0:
                at = np.searchsorted(below, np.multiply(QUANTILES, below[-1]))
                values.append((shares[crash] @ speed / below[-1], *speed[at]))
        low, high = np.quantile(values[1:], (0.025, 0.975), axis=0)
        names = ["mean", *(f"q{100 * level:.0f}" for level in QUANTILES)]
        columns = {"impact_speed_m_s": values[0], "low95": low, "high95": high}
        return pd.DataFrame(columns, index=pd.Index(names, name="of")).reset_index()

    def in_words(self) -> str:
        """Return the answer in words: probability, intervals, what they rest on, and simulations."""
        scenario = self.problem.scenario
        lines = answer_in_words(self.table().iloc[0].to_dict(), self.sources, scenario.noun)
        lines += budget_in_words(self.budget())
        counted = "" if self.simulations is None else f"{self.simulations:,} simulations, "
        ended = "converged" if self.converged else "NOT CONVERGED: more simulations may change it"
        drawn = f"{self.draws.size:,} draw{'s' * (self.draws.size > 1)}"
        lines.append(f"{counted}{ended}; {drawn} of the law of {scenario.noun}s")
        return "\n".join(lines)

    def __repr__(self) -> str:
        """Return the answer in words."""
        return self.in_words()

    @checked(sampling_deviation=a_number(0))
    def budget(self, sampling_deviation: float | None = None) -> pd.DataFrame:
        """Return the variance of the logarithm of the main event by source (`posterior.budget`).

        A relative deviation of the sampling can be stated for an answer that was not sampled.
        """
        if self.posterior is None:
            return pd.DataFrame(columns=["source", "factor", "variance_share"])
        deviation = self.posterior.deviation if sampling_deviation is None else sampling_deviation
        return budget(self.posterior.alone, deviation, self.fixed)


def is_part(event: Event, sampled: Event) -> bool:
    """Return whether an event happens only if the sampled event happens."""
    if event == sampled:
        return True
    if event.quantity == sampled.quantity:
        return (event.threshold > sampled.threshold) == event.is_above
    needs_crash = event.is_above or event == CRASH
    return needs_crash and not sampled.is_above and (sampled == CRASH or sampled.at is not None)


@runtime_checkable
class Way(Protocol):
    """A way to compute an answer: `Map`, `Scan`, `Simulations` or `FewRuns`."""

    def answer(
        self, problem: Problem, draws: Draws, events: Sequence[Event], generator: np.random.Generator
    ) -> Answer:
        """Compute the answer for the event of a problem, and for further events."""


def _draws(value: object) -> Draws:
    if not isinstance(value, Draws | Law):
        raise TypeError
    return as_draws(value)


@checked(
    problem=one_of(Problem, words="a problem", change="Make one with Problem(scenario, vehicle, event)."),
    draws=Argument(
        "draws of the law of the encounters, or a law", _draws, "LawStudy and as_draws make draws."
    ),
    by=Argument(
        "a way: Map, Simulations or FewRuns, with its settings",
        if_it(lambda value: isinstance(value, Way) and not isinstance(value, type)),
        "Write, for example, FewRuns().",
    ),
    events=EVENTS,
    generator=A_GENERATOR,
)
def evaluate(
    problem: Problem,
    draws: Draws,
    by: Way,
    events: Sequence[Event | str] = (),
    *,
    generator: np.random.Generator,
) -> Answer:
    """Return the probability of an event under all draws of the law.

    Parameters
    ----------
    problem
        Scenario, vehicle and event. A law of the problem is not used; the encounters come from the draws. The
        outcomes of a vehicle that is a user's object or function are checked.
    draws
        Draws of the law of the encounters, or one law.
    by
        The way: `Map` for a fast vehicle in cut-ins, `Scan` for one there or in the left turn, `Simulations`
        for any other fast vehicle, `FewRuns` for a slow vehicle.
    events
        Further events, or texts such as ``impact_speed=5``, whose probability is given, if the way allows it.
    generator
        Source of all randomness, or a seed.

    Returns
    -------
    Answer
        Posterior of the probability of each event, with tables and a text.

    Raises
    ------
    InputError
        If an argument is none of these, if the draws are of another scenario, or if the vehicle fails.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> records = ae.read_records("left_turn")
    >>> draws = ae.choose_draws("independent_variables", records)
    >>> found = ae.evaluate(ae.Problem("left_turn", "acc_aeb"), draws, ae.Simulations(20_000), generator=1)
    >>> found.converged, found.simulations
    (True, 20000)
    """
    scenario = problem.scenario
    others = [event_named(each, scenario, "events") if isinstance(each, str) else each for each in events]
    vehicle = checked_vehicle(problem.vehicle, scenario)
    return by.answer(replace(problem, vehicle=vehicle, law=draws.proposal), draws, others, generator)
