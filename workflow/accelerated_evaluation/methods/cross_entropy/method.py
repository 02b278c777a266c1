"""The paper's methods and their base: a Cross-Entropy search of f*, then importance sampling from it."""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from accelerated_evaluation.base.sections import Schema, Sections, integer, section
from accelerated_evaluation.laws import Factors
from accelerated_evaluation.methods import METHODS, Estimate, Method, Stopping
from accelerated_evaluation.methods.cross_entropy.families import (
    PiecewiseFamily,
    ProposalFamily,
    SingleFamily,
)
from accelerated_evaluation.methods.cross_entropy.levels import SearchSettings, Shift
from accelerated_evaluation.methods.cross_entropy.search import Proposals, Search, search
from accelerated_evaluation.methods.importance_sampling import (
    course_table,
    estimate_from_weights,
    run_to_convergence,
)
from accelerated_evaluation.methods.problem import Problem

CONSTANTS = {  # of the paper's method
    "crash_iterations": 2,  # updates in a row by the crash itself, after which a search ends (section V.C.1)
    "minimum_piece_events": 5,  # a piece with fewer events keeps its parameter theta (section V.C.4)
    "event_quantile": 0.1,  # share of a sample that the next relaxed event contains (section V.C.1)
    "range_per_ttc": 0.1,  # ratio of the thresholds of range and TTC, t_R / t_TTC [m/s] (section VI.B)
    "minimum_weight": 0.01,  # lower bound of the weight of a piece (section V.C.3)
    # Steps [1/m, 1/s] by which heuristic and shifted move the truncation points (section V.C.5).
    "truncation_shift": {"inverse_range": 0.01, "inverse_ttc": 0.05},
}
SETTINGS = section(
    seeds=integer(
        5,
        1,
        1000,
        "Independent repetitions of each search; the replicates of the estimate take their f* in turn.",
    ),
    sample_size=integer(1000, 10, 10_000_000, "Simulations N of an iteration (section VI.B)."),
    maximum_iterations=integer(60, 1, 1000, "Limit of a search (section V.A)."),
    maximum_batches=integer(
        5, 1, 1000, "Batches of N that one iteration may take to find its events (section V.C.2)."
    ),
    minimum_events=integer(50, 1, 10_000_000, "Events that an iteration needs (section V.C.2)."),
)


@dataclass(frozen=True)
class CrossEntropyMethod(Method):
    """Importance sampling from a distribution f* that the Cross-Entropy method has found."""

    settings: ClassVar[dict[str, Schema]] = {"cross_entropy": SETTINGS}
    sections: ClassVar[tuple[str, ...]] = ("cross_entropy", "importance_sampling")
    tables: ClassVar[tuple[str, ...]] = ("course",)
    learns_apart: ClassVar[bool] = True

    cross_entropy: Mapping[str, Any]
    batch: int  # number of cut-ins that are drawn at once for the estimate
    course_step: int  # number of simulations between two rows of the course of an estimate

    @classmethod
    def configured(cls, sections: Sections) -> Self:
        """Return the method with the settings of its sections."""
        settings = sections["importance_sampling"]
        search = {**CONSTANTS, **sections["cross_entropy"]}
        return cls(search, settings["simulations"], settings["course_step"])

    @classmethod
    def stream(cls, scope: str, replicate: int) -> tuple[str | int, ...]:
        """Return the name of the random stream of one replicate; streams with other names are independent."""
        return "importance_sampling", cls.name, scope, replicate

    @abstractmethod
    def start(self, f: Factors) -> tuple[ProposalFamily, ProposalFamily]:
        """Return the families of f* for 1 / range and 1 / TTC at the start, for f in one stratum."""

    def shift(self) -> Shift:
        """Return the steps by which truncation points move, and when; here they are fixed."""
        return Shift()

    def search(
        self,
        problem: Problem,
        stratum: str,
        generator: np.random.Generator,
        on_iteration: Callable[[dict[str, float]], None] = lambda _: None,
    ) -> Search:
        """Return the search for f* of one stratum, with this method's settings.

        ``on_iteration`` is called after each iteration with its row of the trace, for example to show
        progress.
        """
        settings = SearchSettings(
            **{name: self.cross_entropy[name] for name in SearchSettings.__dataclass_fields__}
        )
        start = self.start(problem.stratified.strata[stratum].pieces)
        return search(
            problem, stratum, start, settings, generator, shift=self.shift(), on_iteration=on_iteration
        )

    def estimate(
        self,
        problem: Problem,
        stopping: Stopping,
        generator: np.random.Generator,
        proposals: Proposals | None = None,
    ) -> Estimate:
        """Return the estimated probability of the event, with new simulations from f*.

        Without ``proposals`` of earlier searches every stratum, which is accelerated separately, is searched
        here, and the simulations of the search count towards the limit of the stopping rule.
        """
        limit = stopping.maximum_simulations
        if proposals is None:
            searches = {name: self.search(problem, name, generator) for name in problem.stratified.strata}
            proposals = Proposals.of(searches)
            limit = max(limit - proposals.total, 0)
        weights, converged_at = run_to_convergence(
            problem,
            proposals.factors,
            replace(stopping, maximum_simulations=limit),
            generator,
            self.batch,
        )
        # The rule is checked after every simulation. The rest of the last batch is not part of the estimate.
        estimate = estimate_from_weights(
            weights[:converged_at],
            stopping.alpha,
            converged=converged_at is not None,
            learning=proposals.total,
        )
        return replace(estimate, tables={"course": course_table(weights, stopping.alpha, self.course_step)})


@METHODS.add("single")
class Single(CrossEntropyMethod):
    """The authors' earlier method: f* is one exponential for each coordinate (paper, sections II and VI)."""

    style: ClassVar[dict[str, Any]] = {"color": "#b2182b", "linestyle": "--", "marker": "s"}

    def start(self, f: Factors) -> tuple[ProposalFamily, ProposalFamily]:
        """Return families of f* that begin at the exponential distributions with the means of f.

        ``f`` contains the fitted distributions of both coordinates in one stratum.
        """
        return SingleFamily.start(f.first), SingleFamily.start(f.second)


@METHODS.add("piecewise")
class Piecewise(CrossEntropyMethod):
    """The paper's method: each piece of f is tilted by its own theta and gets a new weight (section V)."""

    style: ClassVar[dict[str, Any]] = {"color": "#08306b", "linestyle": "-", "marker": "o"}

    def start(self, f: Factors) -> tuple[ProposalFamily, ProposalFamily]:
        """Return families of f* that begin at f, except that small weights are raised to the lower bound.

        ``f`` contains the fitted distributions of both coordinates in one stratum.
        """
        limits = self.cross_entropy["minimum_weight"], self.cross_entropy["minimum_piece_events"]
        return PiecewiseFamily.start(f.first, *limits), PiecewiseFamily.start(f.second, *limits)


@METHODS.add("heuristic")
class Heuristic(Piecewise):
    """The method `Piecewise` whose truncation points move if an iteration has too few events.

    The truncation points of a variable move up by one step if its tail has the largest allowed weight. The
    iteration then draws again, until it has enough events (section V.C.5).
    """

    style: ClassVar[dict[str, Any]] = {"color": "#41ab5d", "linestyle": "-.", "marker": "^"}

    def shift(self) -> Shift:
        """Return the steps by which the truncation points of both coordinates move up."""
        return Shift(**self.cross_entropy["truncation_shift"])


@METHODS.add("shifted")
class Shifted(Piecewise):
    """The method `Piecewise` whose truncation points move up towards the events.

    The paper's `Heuristic` moves them only if an iteration has too few events. Here they move by one step
    after every update that leaves the tail of a variable with the largest allowed weight, as long as the last
    truncation point stays at least one step below all events.
    """

    style: ClassVar[dict[str, Any]] = {"color": "#e6842a", "linestyle": (0, (5, 1)), "marker": "<"}

    def shift(self) -> Shift:
        """Return the steps by which the truncation points of both coordinates move up."""
        return Shift(**self.cross_entropy["truncation_shift"], every_iteration=True)
