"""The answer from a few hundred chosen runs: simulated under the proposal, and reweighted for each draw."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from fewruns import Estimate, Predecessor, Sampler, SeveralLaws, Stopping, run_batches
from fewruns.crossfit import Control, cross_fitted
from fewruns.problems import Response
from fewruns.weights import effective_number
from numpy.typing import NDArray

from accelerated_evaluation.answer.answer import Answer, Crashes, is_part
from accelerated_evaluation.answer.impact_share import impact_share
from accelerated_evaluation.answer.posterior import FEWEST, Posterior, SampledPosterior
from accelerated_evaluation.base.arguments import a_number, one_of
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.laws.draws import Draws
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.methods.study import with_encounters
from accelerated_evaluation.methods.surrogate import configured_sampler
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.scenarios.outcomes import ENDED
from accelerated_evaluation.vehicles.protocol import CRASH

SHARE = 0.05  # allowed relative increase of the width of the interval by the sampling
GOAL = Stopping(minimum_events=1, maximum_simulations=1000)

Shown = Callable[[Estimate, Posterior | None], None]


@checked(
    stopping=one_of(Stopping, words="a stopping rule", change="Write, for example, Stopping(beta=0.2)."),
    batch_size=a_number(1, 10**5, whole=True),
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
        Number of runs that are simulated at once.
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
    share: float = SHARE
    predecessor: Predecessor | None = None
    on_batch: Shown | None = None

    def answer(
        self, problem: Problem, draws: Draws, events: Sequence[Event], generator: np.random.Generator
    ) -> Answer:
        """Return the probability of the event under each draw, and of further events that are parts of it."""
        own = {"batch_size": self.batch_size, "predecessor": self.predecessor}
        runs = Runs.of(problem, draws, configured_sampler(problem, generator, **own))
        for _ in run_batches(runs.sampler, runs, self.stopping, lambda: self._is_enough(runs)):
            runs.emphasise()
            if self.on_batch is not None:
                self.on_batch(runs.sampler.estimate(self.stopping), runs.posterior())
        settled = self._is_enough(runs) and runs.sampler.is_settled()
        return runs.answer(events, replace(runs.sampler.estimate(self.stopping), converged=settled))

    def _is_enough(self, runs: "Runs") -> bool:
        if runs.sampler.is_narrow(self.stopping):
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

    @classmethod
    def of(cls, problem: Problem, draws: Draws, sampler: Sampler) -> "Runs":
        """Begin to collect the runs of a sampler."""
        return cls(problem, draws, sampler, laws_of(draws, problem.law.from_normal_scores))

    def evaluate(self, z: Array) -> Response:
        """Simulate at normal scores z, shape (n, d), keep the outcomes, and return flags and scores."""
        outcomes = self.problem.simulate(self.problem.law.from_normal_scores(z))
        self.not_ended += int(np.count_nonzero(~getattr(outcomes, ENDED, np.array([], bool))))
        (self.drawn if self.sampler.draws_next else self.outcomes).append(outcomes)
        return self.problem.response(outcomes)

    def repeat(self, z: Array) -> Response:
        """Simulate again, without stored outcomes, at normal scores z, shape (n, d)."""
        return self.problem.repeat(z)

    def posterior(self) -> SampledPosterior | None:
        """Return the probability under each draw, with the control variates of the batches."""
        return self._with_lapses(self.laws.estimate(self.sampler))

    def refined(self) -> SampledPosterior | None:
        """Return the probability under each draw, with cross-fitted control variates, in some seconds."""
        return self._with_lapses(self.laws.refined(self.sampler))

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
            notes={"estimate": estimate, "not_ended": self.not_ended},
        )

    def _with_lapses(self, found: Any) -> SampledPosterior | None:  # noqa: ANN401
        if found is None:
            return None
        return SampledPosterior.of(found, self.draws.member, self.sampler.unseen_lapses)

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
            return self._with_lapses(self.laws.estimate(self.sampler, happened))
        if self.problem.event == CRASH and event.is_above:
            share = impact_share(progress.z, outcomes, event.threshold)
            batches = progress.batches[-len(controls) :]
            controls = [
                Control(control.runs * share(batch.z), control.kept * share(batch.kept))
                for control, batch in zip(controls, batches, strict=True)
            ]
        return self._with_lapses(self.laws.estimate(self.sampler, happened.astype(float), controls))

    def _effective(self, happened: NDArray[np.bool_]) -> float:
        """Return the effective number of events in the runs for the mean of the draws."""
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


def crashes_table(answer: Answer) -> pd.DataFrame:
    """Return the crashes among the runs, with their shares of the probability, one row each."""
    names = answer.problem.scenario.names
    if answer.crashes is None:
        return pd.DataFrame(columns=[*names, "impact_speed", "share"])
    table = pd.DataFrame(answer.crashes.x, columns=list(names))
    return table.assign(impact_speed=answer.crashes.impact_speed[:, 0], share=answer.crashes.shares)
