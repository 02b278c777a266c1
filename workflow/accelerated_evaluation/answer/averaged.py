"""The answer from few simulations: runs sampled under a mean law, and reweighted for every draw of the law.

The posterior of the law of cut-ins is represented by K draws. The surrogate-guided sampler chooses runs under
the mean of these draws. The runs are then reweighted, which gives a crash probability under each draw. The
answer therefore includes the uncertainty in the data, in the choice of law and in the sampling, as an answer
from a crash map does. More runs reduce only the last of the three.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
import pandas as pd
from fewruns.crossfit import Control, cross_fitted
from fewruns.emphasis import Emphasis
from fewruns.problems import Response
from fewruns.running import run_batches
from fewruns.sampler import Sampler
from fewruns.several_laws import LawEstimates, SeveralLaws
from numpy.typing import NDArray

from accelerated_evaluation.answer.impacts import impact_share
from accelerated_evaluation.answer.posterior import LEVELS, budget
from accelerated_evaluation.answer.reweighting import SampledPosterior, draws_of
from accelerated_evaluation.answer.study import event_name
from accelerated_evaluation.answer.summary import SUMMARY, summarise
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.mean import MeanLaw
from accelerated_evaluation.methods.estimate import Estimate, Stopping
from accelerated_evaluation.methods.surrogate import Surrogate
from accelerated_evaluation.problem import Problem
from accelerated_evaluation.scenarios.protocol import Event
from accelerated_evaluation.vehicles.events import CRASH
from accelerated_evaluation.vehicles.protocol import Outcomes

SHARE = 0.05  # allowed relative increase of the width of the interval by the sampling
NAMES = ("crash", "min_range", "min_ttc", "impact_speed")
# Columns of the tables that have no rows if no crash has been observed.
EMPTY = {
    "budget": ("source", "factor", "variance_share"),
    "draws": ("draw", "law", "probability", "error", "shared_error", "own_error", "batches", "unseen_lapses"),
    "crashes": ("z_1", "z_2", "z_3", "lead_speed", "range", "closing_speed", *NAMES, "share"),
}

Shown = Callable[[Estimate, SampledPosterior | None], None]


@dataclass(frozen=True)
class AveragedSurrogate(Surrogate):
    """The surrogate-guided method under a mean law, whose runs are reweighted for every draw of the law.

    Attributes
    ----------
    events
        Events whose probabilities are estimated from the same runs, in addition to the event of the problem.
    cut_ins_per_km
        Distinct closing cut-ins per kilometre [1/km]; None if the distance is not known.
    share
        Allowed relative increase of the width of the 80 % interval by the sampling; with 0, only the paper's
        stopping rule is used.
    on_answer
        Function that is called after every batch with the estimate and the posterior, which is None until an
        estimate is possible.
    """

    tables: ClassVar[tuple[str, ...]] = ("runs", "answer", "budget", "draws", "crashes")

    events: tuple[Event, ...] = ()
    cut_ins_per_km: float | None = None
    share: float = SHARE
    on_answer: Shown | None = None

    def estimate(self, problem: Problem, stopping: Stopping, generator: np.random.Generator) -> Estimate:
        """Estimate the probability of the event under the mean law, and under every draw of the law.

        The runs end when `has_enough` is true and the certificate of the sampler is met. The certificate is a
        bound on the probability of the parts of the event that no run has observed. The runs also end if the
        vehicle may lapse (rarely behave differently than in most runs of the same encounter) and more runs
        would not improve the result. The tables of the estimate are ``runs`` and those of `Course.tables`.

        Parameters
        ----------
        problem
            The vehicle, the event, and a law that is a `MeanLaw`.
        stopping
            The stopping rule.
        generator
            Source of all randomness.

        Returns
        -------
        Estimate
            The probability under the mean law, with the interval of the sampling alone. Its tables contain
            the answer, which includes the uncertainty in the law.
        """
        course = Course.of(problem, self.sampler(problem, generator))
        sampler = course.sampler
        for _ in run_batches(sampler, course, stopping, partial(self.has_enough, course, stopping)):
            sampler.emphasis = course.emphasis()
            if self.on_answer is not None:
                self.on_answer(sampler.estimate(stopping), course.posterior())
        found = sampler.estimate(stopping)
        return replace(
            found,
            converged=self.has_enough(course, stopping) and sampler.is_settled(),
            tables={"runs": found.tables["runs"]}
            | course.tables(problem.event, self.events, self.cut_ins_per_km),
        )

    def has_enough(self, course: "Course", stopping: Stopping) -> bool:
        """Return whether the sampling is precise enough.

        This is the case if the interval of the sampling alone satisfies the stopping rule, or if the sampling
        increases the width of the 80 % interval of the answer by at most ``share``.

        Parameters
        ----------
        course
            The runs so far, with their outcomes and density ratios.
        stopping
            The stopping rule: the required width of an interval relative to the estimate, and its confidence
            level.
        """
        if course.sampler.is_narrow(stopping):
            return True
        posterior = course.posterior() if self.share else None
        return posterior is not None and posterior.share_of_sampling <= self.share


@dataclass
class Course:
    """The course of an estimate under a mean law: its runs, their outcomes and their density ratios.

    It is also the problem whose batches are run, because it keeps their outcomes.
    """

    law: MeanLaw
    sampler: Sampler
    draws: SeveralLaws  # the draws of the law
    problem: Problem | None = None  # None if the runs were made elsewhere
    # The outcomes of all batches, in their order, without repetitions and draws of the law.
    outcomes: list[Outcomes] = field(default_factory=list)

    @classmethod
    def of(cls, problem: Problem, sampler: Sampler) -> "Course":
        """Return the course of an estimate that has no runs yet, under the mean law of the problem."""
        return cls(problem.law, sampler, draws_of(problem.law), problem)

    @property
    def member(self) -> NDArray[np.int_]:
        """Index of the law of each draw among the members of the family, shape (K,)."""
        return np.unique(self.law.draws.names, return_inverse=True)[1]

    def evaluate(self, z: Array) -> Response:
        """Simulate the batch that the sampler has requested, shape (n, d), and keep the outcomes."""
        outcomes = self.problem.simulate(self.problem.law.from_normal_scores(z))
        if not self.sampler.draws_next:
            self.outcomes.append(outcomes)
        return self.problem.event.happens(outcomes), self.problem.event.score(outcomes)

    def repeat(self, z: Array) -> Response:
        """Simulate runs again, although their outcomes may be stored; the outcomes are not kept."""
        return self.problem.repeat(z)

    def posterior(self) -> SampledPosterior | None:
        """Return the probability of the sampled event under each draw; None if there is no estimate yet."""
        return self._sampled(self.draws.estimate(self.sampler))

    def refined(self) -> SampledPosterior | None:
        """Return the more precise posterior of `SeveralLaws.refined`; None if there is no estimate yet."""
        return self._sampled(self.draws.refined(self.sampler))

    def emphasis(self) -> Emphasis | None:
        """Return the factor with which the estimates of all draws become equally precise, if it is known."""
        found = self.draws.estimate(self.sampler)
        return self.sampler.emphasis if found is None else self.draws.emphasis(found)

    def _sampled(self, found: LawEstimates | None) -> SampledPosterior | None:
        return None if found is None else SampledPosterior.of(found, self.member)

    def tables(
        self, sampled: Event, events: Sequence[Event], cut_ins_per_km: float | None
    ) -> dict[str, pd.DataFrame]:
        """Return the results of the runs as tables.

        Parameters
        ----------
        sampled
            The event for which the runs were chosen.
        events
            Further events, whose probabilities are estimated from the same runs.
        cut_ins_per_km
            Distinct closing cut-ins per kilometre [1/km]; None if the distance is not known.

        Returns
        -------
        dict
            ``answer``: one row for each event, with the columns ``event``, ``per_km`` (rate [1/km]) and
            ``simulations``, and with the mean ``probability``, the ``median``, and the ends ``low50`` to
            ``high95`` of the 50, 80 and 95 % credible intervals; if the vehicle may lapse, the upper ends
            include `unseen_lapses`. ``budget``: the variance of the logarithm of the probability of the
            sampled event by source (data, choice of law, sampling). ``draws``: one row for each draw of the
            law, with its number ``draw``, ``law``, ``probability`` of the sampled event, relative ``error``,
            the parts of this error ``shared_error`` and ``own_error`` (see `SampledPosterior`), number of
            ``batches``, and bound `unseen_lapses`. ``crashes``: the runs that ended in the sampled event,
            from `crashes`.
        """
        controls = self._controls()
        posteriors = {event: self._of(event, sampled, controls) for event in (sampled, *events)}
        per_km = np.nan if cut_ins_per_km is None else cut_ins_per_km
        rows, unseen = [], self.unseen_lapses()
        for event, posterior in posteriors.items():
            summary = answer_row(posterior, unseen)
            rows.append({"event": event_name(event)} | summary | {"per_km": summary["probability"] * per_km})
        answer = pd.DataFrame(rows).assign(simulations=self.sampler.simulations)
        if (own := posteriors[sampled]) is None:
            return {name: pd.DataFrame(columns=columns) for name, columns in EMPTY.items()} | {
                "answer": answer
            }
        draws = {
            "draw": np.arange(own.probabilities.size) + 1,
            "law": self.law.draws.names,
            "probability": own.probabilities,
            "error": own.errors,
            "shared_error": own.shared,
            "own_error": own.own,
            "batches": own.batches,
            "unseen_lapses": unseen,
        }
        of_draws = {"budget": budget(own.alone, own.deviation), "draws": pd.DataFrame(draws)}
        return {"answer": answer, "crashes": self.crashes(sampled)} | of_draws

    def unseen_lapses(self) -> float:
        """Return a bound on the probability that unobserved lapses add to the mean of the posterior.

        A lapse is a rare run in which the vehicle behaves differently from most other runs of the same
        encounter. The bound is 0 if the vehicle does not lapse, or if there is no posterior yet.
        """
        return unseen_lapses(self.sampler, self.posterior())

    def crashes(self, sampled: Event) -> pd.DataFrame:
        """Return a table of the runs that ended in the sampled event.

        The columns are the normal scores ``z_1`` to ``z_3`` (coordinates in which the mean law is standard
        normal); ``lead_speed`` [m/s], ``range`` [m], ``closing_speed`` [m/s]; the outcomes ``crash``,
        ``min_range`` [m] and so on, as in `Outcomes`; and ``share``. The share of a run is its weight in the
        estimate under the mean law without control variate, divided by the sum of all weights. It is 0 for
        runs that were only used for learning.

        Parameters
        ----------
        sampled
            The event for which the runs were chosen.
        """
        progress, outcomes = self.sampler.progress, joined(self.outcomes)
        counted = self.draws.counted(progress)
        weights = [
            estimate.importance * batch.weight / batch.inclusion
            for estimate, batch in zip(counted, progress.batches[-len(counted) :], strict=True)
        ]
        share = np.zeros(len(progress.z))
        share[len(share) - sum(map(len, weights)) :] = np.concatenate(weights)
        happened = np.flatnonzero(sampled.happens(outcomes))
        cut_ins, z = self.law.from_normal_scores(progress.z[happened]), progress.z[happened]
        place = {"lead_speed": cut_ins.lead_speed, "range": cut_ins.range_}
        place |= {"closing_speed": self.law.capped(cut_ins.closing_speed)}
        scores = {f"z_{k + 1}": z[:, k] for k in range(z.shape[1])}
        ended = {name: values[happened] for name, values in vars(outcomes).items()}
        return pd.DataFrame(scores | place | ended | {"share": share[happened] / share[happened].sum()})

    def _controls(self) -> list[Control] | None:
        """Return the cross-fitted control variates of the batches of the estimate; None if there are < 2."""
        counted = len(self.draws.counted(self.sampler.progress))
        return cross_fitted(self.sampler, counted) if counted >= 2 else None

    def _of(self, event: Event, sampled: Event, controls: list[Control] | None) -> SampledPosterior | None:
        """Return the probability of an event under each draw; None if it cannot be estimated.

        It can be estimated if the event happened in a run and is a part of the sampled event. The sampler
        does not search for other events. For example, an estimate of the probability of near misses from runs
        that were chosen for crashes would be several times too low.
        """
        if controls is None or not self.outcomes or not is_part(event, sampled):
            return None
        outcomes, progress = joined(self.outcomes), self.sampler.progress
        happened = event.happens(outcomes)
        if sampled == CRASH and event.quantity == "impact_speed":
            share = impact_share(progress.z, outcomes, event.threshold)
            batches = progress.batches[-len(controls) :]
            controls = [
                Control(control.runs * share(batch.z), control.kept * share(batch.kept))
                for control, batch in zip(controls, batches, strict=True)
            ]
        return self._sampled(self.draws.estimate(self.sampler, happened.astype(float), controls))


def is_part(event: Event, sampled: Event) -> bool:
    """Return whether every encounter that ends in an event also ends in the sampled event.

    Parameters
    ----------
    event
        The event that may be a part, such as a crash.
    sampled
        The event for which the runs were chosen, such as a near miss.
    """
    if event == sampled:
        return True
    if event.quantity == sampled.quantity:
        is_impact = event.quantity == "impact_speed"
        return (event.threshold > sampled.threshold) == is_impact
    return event.quantity in ("crash", "impact_speed") and sampled.quantity != "impact_speed"


def unseen_lapses(sampler: Sampler, posterior: SampledPosterior | None) -> float:
    """Return a bound on the probability that unobserved lapses add to the mean of a posterior.

    A lapse is a rare run in which the vehicle behaves differently from most other runs of the same encounter.

    Parameters
    ----------
    sampler
        The sampler, with its runs.
    posterior
        The probability of the sampled event under each draw of the law; None if there is no estimate yet.

    Returns
    -------
    float
        The bound; 0 if the vehicle does not lapse, or if there is no posterior.
    """
    if posterior is None:
        return 0.0
    return sampler.unseen_lapses(float(posterior.probabilities.mean()), SHARE)


def answer_row(posterior: SampledPosterior | None, unseen_lapses: float = 0.0) -> dict[str, float]:
    """Return mean, median and intervals of the probability of an event.

    The errors of the sampling are included in the median and the intervals; ``probability`` is the mean of
    the estimates, which is the probability under the mean law.

    Parameters
    ----------
    posterior
        The posterior; None if there is none, in which case all values are NaN.
    unseen_lapses
        Bound on the probability of unobserved lapses (rare runs in which the vehicle behaves differently),
        which is added to the upper ends of the intervals.

    Returns
    -------
    dict
        The mean ``probability``, the ``median``, and the ends ``low50`` to ``high95`` of the 50, 80 and 95 %
        credible intervals.
    """
    if posterior is None:
        return dict.fromkeys(SUMMARY, np.nan)
    row = summarise(posterior.whole) | {"probability": float(posterior.probabilities.mean())}
    raised = {name: min(end + unseen_lapses, 1.0) for name, end in row.items() if name.startswith("high")}
    return row | raised


def joined(outcomes: Sequence[Outcomes]) -> Outcomes:
    """Concatenate the outcomes of several batches of simulations, in their order."""
    return Outcomes(**{name: np.concatenate([getattr(part, name) for part in outcomes]) for name in NAMES})


def posterior_of(draws: pd.DataFrame) -> SampledPosterior:
    """Return the posterior of one replicate from its table ``draws``.

    The table has one row for each draw of the law, with the estimated probability and its errors; see
    `Course.tables`.
    """
    member = np.unique(draws["law"], return_inverse=True)[1]
    probability, error, own = (draws[name].to_numpy(float) for name in ("probability", "error", "own_error"))
    batches, shared = int(draws["batches"].iloc[0]), float(draws["shared_error"].iloc[0])
    unseen = float(draws["unseen_lapses"].iloc[0])
    return SampledPosterior(probability, error, member, batches, shared, own, unseen)


def answer_in_words(row: Mapping[str, Any], encounter: str = "a cut-in") -> list[str]:
    """Return the lines of text that describe a row of the table ``answer``.

    Parameters
    ----------
    row
        One row of the table ``answer`` of `Course.tables`: the values by the name of the column.
    encounter
        Name of an encounter in the text.
    """
    if np.isnan(row["median"]):
        return [f"{row['event']}: not known from these runs"]
    intervals = (f"{100 * level:.0f}%: {_ends(row, level)}" for level in LEVELS)
    per_km = "" if np.isnan(row["per_km"]) else f"; mean per kilometre {row['per_km']:.2g}"
    return [
        f"{row['event']}: probability in {encounter} {row['median']:.3g} (median), {row['probability']:.3g} "
        f"(mean){per_km}",
        f"  intervals with data, laws and sampling: {'; '.join(intervals)}",
    ]


def _ends(row: Mapping[str, Any], level: float) -> str:
    return f"{row[f'low{100 * level:.0f}']:.3g} to {row[f'high{100 * level:.0f}']:.3g}"


def budget_in_words(budget: pd.DataFrame) -> list[str]:
    """Return a line of text with the share of each source in the variance of the log probability.

    The list is empty if there is no estimate, or if the shares are not known.

    Parameters
    ----------
    budget
        Table with the columns ``source`` (data, choice of law, sampling) and ``variance_share``, as from
        `posterior.budget`.
    """
    shares = budget.set_index("source")["variance_share"]
    if shares.empty or shares.isna().any():
        return []
    parts = ", ".join(f"{source} {shares[source]:.0%}" for source in ("data", "choice of law", "sampling"))
    return [f"variance of the logarithm: {parts}; only the last becomes smaller with more simulations"]
