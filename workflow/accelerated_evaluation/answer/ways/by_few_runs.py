"""The answer from a few hundred chosen runs: simulated under the proposal, and reweighted for each draw."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from fewruns import Estimate, LawEstimates, Predecessor, Sampler, SeveralLaws, run_batches
from fewruns.crossfit import Control, cross_fitted
from fewruns.problems import PartialResponse
from fewruns.two_phase import TwoPhaseBatch
from fewruns.weights import effective_number
from numpy.typing import NDArray
from scipy.special import ndtri

from accelerated_evaluation.answer.ways.answer import Answer, Crashes, is_part
from accelerated_evaluation.answer.ways.impact_share import impact_share
from accelerated_evaluation.answer.ways.posterior import FEWEST, Posterior, SampledPosterior
from accelerated_evaluation.answer.ways.request import SHARE
from accelerated_evaluation.base.arguments import a_number, one_of
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.laws.draws import Draws
from accelerated_evaluation.methods import Stopping
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.methods.study import with_encounters
from accelerated_evaluation.methods.surrogate import configured_sampler
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.scenarios.outcomes import ENDED, have_failed, of_known, without_failed
from accelerated_evaluation.vehicles.protocol import CRASH

GOAL = Stopping(minimum_events=1, maximum_simulations=1000)
TRIED = 20  # number of encounters with the event, and without it, that show whether two vehicles are similar
# The vehicles are not similar if one has the event in this share of the encounters without it of the other.
CHANGED = 1 / 3

Shown = Callable[[Estimate, Posterior | None], None]


@checked(
    stopping=one_of(Stopping, words="a stopping rule", change="Write, for example, Stopping(beta=0.2)."),
    batch_size=a_number(1, 10**5, whole=True),
    pending=a_number(1, 10**6, whole=True),
    share=a_number(0),
)
@dataclass(frozen=True)
class FewRuns:
    """The way to an answer by a few hundred chosen runs, for slow vehicles in any scenario.

    Parameters
    ----------
    stopping
        Rule for the interval of the sampling alone, and the largest number of runs.
    batch_size
        Number of runs that are designed at once.
    pending
        Number of runs that may be pending at a time, for many workers; see `fewruns.run_batches`.
    share
        The runs also end when the sampling increases the width of the 80 % interval by at most this share.
    predecessor
        Runs of a similar vehicle under the same proposal, which save about two fifths of the runs.
    on_batch
        Function that receives the estimate of the sampling and the posterior after each batch.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> draws = ae.choose_draws("independent_variables", ae.read_records("left_turn"))
    >>> problem = ae.Problem("left_turn", "acc_aeb")
    >>> ae.evaluate(problem, draws, ae.FewRuns(), generator=1).converged
    True
    """

    stopping: Stopping = GOAL
    batch_size: int = 5
    pending: int = 1
    share: float = SHARE
    predecessor: Predecessor | None = None
    on_batch: Shown | None = None

    def answer(
        self, problem: Problem, draws: Draws, events: Sequence[Event], generator: np.random.Generator
    ) -> Answer:
        """Return the probability of the event under each draw, and of further events that are parts of it."""
        own = {"batch_size": self.batch_size, "predecessor": self.predecessor}
        runs = Runs.of(problem, draws, configured_sampler(problem, generator, **own))
        is_enough = partial(self._is_enough, runs)
        for _ in run_batches(runs.sampler, runs, self.stopping, is_enough, self.pending):
            runs.emphasise()
            if self.on_batch is not None:
                self.on_batch(runs.sampler.estimate(self.stopping), runs.posterior())
        settled = is_enough() and runs.sampler.is_settled()
        return runs.answer(events, replace(runs.sampler.estimate(self.stopping), converged=settled))

    def _is_enough(self, runs: "Runs") -> bool:
        if runs.failed[1].mean() > self.stopping.beta * runs.probability:
            return False
        if runs.is_narrow(self.stopping):
            return True
        posterior = runs.posterior() if self.share else None
        return posterior is not None and posterior.share_of_sampling <= self.share


@dataclass
class Runs:
    """The runs of a sampler, with their outcomes and with their density ratios under each draw of the law."""

    problem: Problem
    draws: Draws
    sampler: Sampler
    laws: SeveralLaws
    # The outcomes of all batches, in their order, without repetitions, and those of the draws of the law.
    outcomes: list[Any] = field(default_factory=list)
    drawn: list[Any] = field(default_factory=list)
    not_ended: int = 0  # runs that were stopped at their longest duration
    # The failed runs of the draws of the law, and by the number of the batch those of the estimate.
    failed_draws: list[Array] = field(default_factory=list)
    failed_runs: dict[int, Array] = field(default_factory=dict)

    @classmethod
    def of(cls, problem: Problem, draws: Draws, sampler: Sampler) -> "Runs":
        """Begin to collect the runs of a sampler."""
        return cls(problem, draws, sampler, laws_of(draws, problem.law.from_normal_scores))

    def begin(self, z: Array, again: bool) -> None:
        """Begin to simulate at normal scores z, shape (n, d); see `Problem.begin`."""
        self.problem.begin(z, again)

    def evaluate(self, z: Array) -> PartialResponse:
        """Simulate at normal scores z, (n, d), and keep the outcomes; return flags, scores and failures."""
        outcomes = self.problem.simulate(self.problem.law.from_normal_scores(z))
        known = without_failed(outcomes)
        self._note(z, have_failed(outcomes))
        self.not_ended += int(np.count_nonzero(~getattr(known, ENDED, np.array([], bool))))
        (self.drawn if self.sampler.draws_next else self.outcomes).append(known)
        return self._response(outcomes)

    def repeat(self, z: Array) -> PartialResponse:
        """Simulate again, without stored outcomes, at normal scores z, shape (n, d)."""
        return self._response(self.problem.simulate(self.problem.law.from_normal_scores(z), again=True))

    def _note(self, z: Array, failed: NDArray[np.bool_]) -> None:
        """Note by how much the failed runs of a batch change the estimates under each draw."""
        batch = self.sampler.progress.pending
        if failed.any() and self.sampler.draws_next:
            self.failed_draws.append(self.laws.ratios(z[failed]).sum(axis=1))
        elif failed.any() and isinstance(batch, TwoPhaseBatch):
            weights = self.laws.ratios(z[failed]) * (batch.weight / batch.inclusion)[failed]
            number = len(self.sampler.progress.estimates)
            self.failed_runs[number] = np.array([weights @ batch.control[failed], weights.sum(axis=1)])

    def _response(self, outcomes: Any) -> PartialResponse:  # noqa: ANN401
        event, failed = self.problem.event, have_failed(outcomes)
        score = of_known(event.score, outcomes, 0.0) if self.problem.graded else None
        return of_known(event.happens, outcomes, False), score, failed

    @property
    def probability(self) -> float:
        """The estimated probability under the law that is sampled; 0 if there is no estimate."""
        progress = self.sampler.progress
        return progress.law_draws.share if self.sampler.is_counted else progress.mean

    @property
    def failed(self) -> Array:
        """What failed runs add under each draw, shape (2, K): as predicted, and at most.

        In the estimates, predictions stand for the failed runs. At most, all of them have the event.
        """
        progress, nothing = self.sampler.progress, np.zeros((2, self.draws.size))
        if self.sampler.is_counted:
            drawn = len(progress.law_draws) + progress.failed_draws
            return np.array([nothing[0], nothing[0] + sum(self.failed_draws) / drawn])
        first = len(progress.estimates) - len(progress.consistent)
        importance = [each.importance for each in progress.estimates]
        total = sum(importance[first:]) or 1.0
        parts = [importance[k] / total * part for k, part in self.failed_runs.items() if k >= first]
        return sum(parts, nothing)

    def is_narrow(self, stopping: Stopping) -> bool:
        """Return whether the interval of the sampling alone is as narrow as a stopping rule requires.

        If some encounters of the proposal cannot happen, the interval of the others must be narrow as well.
        """
        if not self.sampler.is_narrow(stopping):
            return False
        if self.draws.unlimited is self.draws:
            return True
        found = self.posterior()
        return found is not None and found.deviation * ndtri(1 - stopping.alpha / 2) <= stopping.beta

    def posterior(self) -> SampledPosterior | None:
        """Return the probability under each draw, with the control variates of the batches."""
        return self._posterior(self.laws.estimate(self.sampler))

    def refined(self) -> SampledPosterior | None:
        """Return the probability under each draw, with cross-fitted control variates, in some seconds."""
        return self._posterior(self.laws.refined(self.sampler))

    def emphasise(self) -> None:
        """Let the sampler choose further runs that make the estimates under all draws of the law precise."""
        if (found := self.laws.estimate(self.sampler)) is not None:
            self.sampler.emphasis = self.laws.emphasis(found)

    def answer(self, events: Sequence[Event], estimate: Estimate) -> Answer:
        """Return the answer from all runs, with an estimate of the sampling."""
        batches, counted = len(self.sampler.progress.stored), self.sampler.is_counted
        controls = cross_fitted(self.sampler, batches) if batches >= 2 and not counted else None
        main = self.problem.event
        others = [event for event in events if event != main]
        return Answer(
            self.problem,
            self.draws,
            {event: self._of(event, controls) for event in (main, *others)},
            self._crashes() if counted or controls else None,
            simulations=self.sampler.simulations,
            converged=estimate.converged,
            tables={"runs": with_encounters(pd.DataFrame(estimate.tables["runs"]), self.problem)},
            fixed=self._fixed(controls),
            notes={
                "estimate": estimate,
                "not_ended": self.not_ended,
                "failed": (len(self.sampler.progress.failed), float(self.failed[1].mean())),
            },
        )

    def _posterior(self, found: LawEstimates | None) -> SampledPosterior | None:
        """Return the posterior in which failed runs are without the event, and may add what they can."""
        if found is None:
            return None
        predicted, most = self.failed
        unseen = self.sampler.progress.unseen_lapses
        if most.any() and (main := self.laws.estimate(self.sampler)) is not None:
            share = predicted / np.maximum(main.probabilities, predicted + np.finfo(float).tiny)
            found, unseen = replace(found, probabilities=found.probabilities * (1 - share)), unseen + most
        return SampledPosterior.of(found, self.draws.member, unseen)

    def _fixed(self, controls: list[Control] | None) -> dict[str, Posterior]:
        """Return the posteriors if a part of the parameters of the draws is fixed (`Draws.fixed`)."""
        posteriors = {}
        for name, draws in self.draws.fixed().items():
            laws = SeveralLaws(partial(self._log_ratios_of, draws), self.problem.law.from_normal_scores)
            if (found := laws.estimate(self.sampler, controls=controls)) is not None:
                posteriors[name] = SampledPosterior.of(found, self.draws.member).alone
        return posteriors

    def _log_ratios_of(self, draws: Draws, x: Array) -> Array:
        return draws.log_densities(x) - self.problem.law.log_density(x)

    def _of(self, event: Event, controls: list[Control] | None) -> SampledPosterior | None:
        """Return the posterior of an event; None if the runs were not chosen for it or hardly had it."""
        is_counted = self.sampler.is_counted
        if not is_counted and (controls is None or not is_part(event, self.problem.event)):
            return None
        outcomes, progress = joined(self.drawn if is_counted else self.outcomes), self.sampler.progress
        happened = event.happens(outcomes)
        if event != self.problem.event and self._effective(happened) < FEWEST:
            return None
        if is_counted:
            return self._posterior(self.laws.estimate(self.sampler, happened))
        if self.problem.event == CRASH and event.is_above:
            share = impact_share(progress.z, outcomes, event.threshold)
            batches = progress.batches[-len(controls) :]
            controls = [
                Control(control.runs * share(batch.z), control.kept * share(batch.kept))
                for control, batch in zip(controls, batches, strict=True)
            ]
        return self._posterior(self.laws.estimate(self.sampler, happened.astype(float), controls))

    def _effective(self, happened: NDArray[np.bool_]) -> float:
        """Return the effective number of events in the runs under the mean of all drawn laws."""
        if self.sampler.is_counted:
            return float(happened.sum())
        runs, weights = self.laws.weights(self.sampler.progress)
        return float(effective_number(weights.mean(axis=0) * happened[runs]))

    def _crashes(self) -> Crashes | None:
        """Return the runs in which the event happened, with their weights under each draw."""
        progress, outcomes = self.sampler.progress, self.outcomes
        if self.sampler.is_counted:
            draws, outcomes = progress.law_draws, self.drawn
            z, chosen = draws.z, np.flatnonzero(draws.happened)
            weights = self.laws.ratios(z[chosen]) / len(z)
        else:
            z, (runs, weights) = progress.z, self.laws.weights(progress)
            happened = progress.happened[runs]
            chosen, weights = runs[happened], weights[:, happened]
        if not len(chosen):
            return None
        impact = getattr(joined(outcomes), "impact_speed", np.full(len(z), np.nan))
        return Crashes(self.problem.law.from_normal_scores(z[chosen]), impact[chosen, None], weights)


def laws_of(draws: Draws, to_points: Callable[[Array], Array]) -> SeveralLaws:
    """Return the draws in the form that the sampler needs, with the map from normal scores to points."""

    def only(chosen: NDArray[np.intp]) -> SeveralLaws:
        few = draws.subset(chosen)  # faster; the proposal may be another one, for which the map is also right
        return laws_of(few, few.proposal.from_normal_scores)

    return SeveralLaws(draws.log_ratios, to_points, only)


def joined(outcomes: Sequence[Any]) -> Any:  # noqa: ANN401
    """Return the outcomes of several batches as one."""
    names = [each.name for each in fields(outcomes[0])]
    return type(outcomes[0])(**{n: np.concatenate([getattr(part, n) for part in outcomes]) for n in names})


def runs_to_begin_with(other: Answer, problem: Problem) -> Predecessor | None:
    """Return the runs of another vehicle under the same law, if the vehicle of a problem is similar to it.

    It is similar if it has the event in most of `TRIED` encounters in which the other vehicle had it, and in
    less than `CHANGED` of `TRIED` encounters in which the other vehicle did not have it. The runs of a
    vehicle that has the event elsewhere would mislead the sampler. So would those of a vehicle with a much
    rarer event: the sampler would stay near its events, and miss most of the others.
    """
    runs, names = other.tables["runs"].query("phase != 'failed'"), problem.scenario.names
    happened = runs["event"].to_numpy(bool)
    places = [np.flatnonzero(happened), np.flatnonzero(~happened)]
    if not all(map(len, places)):
        return None
    tried = [np.unique(each[np.linspace(0, len(each) - 1, TRIED).astype(int)]) for each in places]
    x = runs[list(names)].to_numpy()[np.concatenate(tried)]
    with_event, without = np.split(
        of_known(problem.event.happens, problem.simulate(x), False), [len(tried[0])]
    )
    if with_event.mean() <= 0.5 or without.mean() >= CHANGED:
        return None
    return Predecessor(runs[[f"z_{name}" for name in names]].to_numpy(), happened)


def crashes_table(answer: Answer) -> pd.DataFrame:
    """Return the crashes among the runs, with their shares of the probability, one row each."""
    names = answer.problem.scenario.names
    if answer.crashes is None:
        return pd.DataFrame(columns=[*names, "impact_speed", "share"])
    table = pd.DataFrame(answer.crashes.x, columns=list(names))
    return table.assign(impact_speed=answer.crashes.impact_speed[:, 0], share=answer.crashes.shares)
