"""The sampler of `fewruns` as a method of the study, for vehicles that are expensive to simulate."""

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from fewruns.certificate import Certificate
from fewruns.constants import UNSEEN_ALPHA
from fewruns.estimates import Estimate
from fewruns.problems import Predecessor, ScoreProblem
from fewruns.running import estimate_problem, sampler_for
from fewruns.sampler import Sampler

from accelerated_evaluation.base.sections import Schema, Sections, choice, integer, section
from accelerated_evaluation.methods import METHODS, Method, Stopping, configured_stopping, study_errors
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.scenarios.protocol import Scenario

CONFIDENCE = f"{1 - UNSEEN_ALPHA:.0%} confidence"

SETTINGS = section(
    replicates=integer(
        10, 1, 1000, "Independent repetitions of the surrogate-guided estimate, its learning included."
    ),
    batch_size=integer(
        5,
        1,
        500,
        "Simulations in one batch; large batches keep more workers busy, but need more in total.",
    ),
    maximum_calls=integer(
        1000,
        100,
        100_000,
        "Simulations after which a replicate stops, learning included, converged or not.",
    ),
    interval=choice(
        "usual",
        ["usual", "anytime"],
        "usual for an interval that covers the truth as often as stated if it is computed once; anytime for "
        "one that does so although it is checked after every batch, for about a sixth more simulations.",
    ),
)


def rules_for(scenario: Scenario, event: Event) -> dict[str, Any]:
    """Return the arguments of `Sampler` that follow from what a scenario states of an event.

    If the scenario states that an event is an upper set in a variable, the event is rare and of one piece,
    and the certificate may allow unobserved parts of a thousand times the estimate. Otherwise an event may be
    frequent and may consist of several parts. The estimate then converges only when a part that no run has
    observed has at most three times the estimated probability. In such a part the event happens at least in a
    share ``filled`` of the encounters, which is below 1 if rounding errors decide.
    """
    if scenario.upper_set_in is not None:
        return {"upper_set": True}
    certificate = Certificate(share=3.0, curvature=0.0, filled=event.filled)
    return {"certificate": certificate, "frequent": True}


@study_errors()
def configured_sampler(problem: ScoreProblem, generator: np.random.Generator, **settings: Any) -> Sampler:  # noqa: ANN401
    """Return a new sampler for a problem; ``settings`` are arguments of `Sampler`."""
    return sampler_for(problem, generator, **_rules_of(problem) | settings)


def _rules_of(problem: ScoreProblem) -> dict[str, Any]:
    if not isinstance(problem, Problem):
        return {}
    rules = rules_for(problem.scenario, problem.event)
    return rules | ({"upper_set": problem.upper_set} if "upper_set" in rules else {})


@METHODS.add("surrogate")
@dataclass(frozen=True)
class Surrogate(Method):
    """Estimate the probability of an event with few simulations, guided by a surrogate of the event."""

    style: ClassVar[dict[str, Any]] = {"color": "#6a3d9a", "linestyle": (0, (3, 1, 1, 1)), "marker": "D"}
    settings: ClassVar[dict[str, Schema]] = {"surrogate": SETTINGS}
    sections: ClassVar[tuple[str, ...]] = ("surrogate",)
    plan: ClassVar[tuple[str, ...]] = ("importance_sampling", "surrogate")

    batch_size: int = 5
    # File in which the state is saved after every batch. If the file exists, its runs are reused and the work
    # is resumed. Each problem needs its own file. By default nothing is saved.
    state_file: str | os.PathLike | None = None
    # Called with the estimate after every batch, for example to show progress.
    on_batch: Callable[[Estimate], None] | None = None
    predecessor: Predecessor | None = None

    @classmethod
    def configured(cls, sections: Sections) -> Self:
        """Return the method with the settings of its section."""
        return cls(sections["surrogate"]["batch_size"])

    @classmethod
    def replicates(cls, sections: Sections) -> int:
        """Return the number of independent replicates of the study."""
        return sections["surrogate"]["replicates"]

    @classmethod
    def stopping(cls, sections: Sections) -> Stopping:
        """Return the stopping rule of this method: the paper's level and precision with other limits.

        One event is enough, the number of simulations is limited by ``maximum_calls``, and the interval may
        be one that is valid at every check (``anytime``).
        """
        rule = configured_stopping(sections["importance_sampling"])
        own = sections["surrogate"]
        anytime = own["interval"] == "anytime"
        return replace(rule, minimum_events=1, maximum_simulations=own["maximum_calls"], anytime=anytime)

    @study_errors()
    def estimate(self, problem: ScoreProblem, stopping: Stopping, generator: np.random.Generator) -> Estimate:
        """Return the estimated probability of the event, from as few simulations as possible.

        A few dozen events are enough for this method, so ``minimum_events`` of the stopping rule should be 1.
        A vehicle that may fail in a few of its runs uses all simulations. If a saved state is resumed, its
        own generator is used; InputError is raised if it belongs to another problem.
        """
        own = _rules_of(problem) | {"batch_size": self.batch_size, "predecessor": self.predecessor}
        return estimate_problem(problem, generator, stopping, self.state_file, self.on_batch, **own)


def unseen_in_words(probability: float, diagnostics: Mapping[str, float]) -> str:
    """Return a sentence with two bounds on unobserved parts of an event, also relative to the estimate."""
    bounds = diagnostics["unseen_mode"], diagnostics["unseen_any"]
    relative = ""
    if probability > 0:
        mode, anything = (bound / probability for bound in bounds)
        relative = f"; these are {mode:,.2g} and {anything:,.2g} times the estimate"
        relative += ", so it is an assumption that there is no such part" if mode > 1 else ""
    return (
        f"a part of the event that no run has met: at most {bounds[0]:.1g} if a half-space, "
        f"{bounds[1]:.1g} if of any shape ({CONFIDENCE}){relative}"
    )


def weights_in_words(diagnostics: Mapping[str, float]) -> str:
    """Return a sentence about the effective number of events."""
    effective = diagnostics["effective_events"]
    return f"weights of the events: as informative as {effective:.1f} events of equal weight"


# Why no run was repeated, by what is stated about the vehicle.
NO_REPEATS = {
    True: "none, because the vehicle is stated to be deterministic",
    False: "none so far; the vehicle is stated to be random",
    None: "none so far; whether the vehicle is deterministic is not stated, and will be checked by repeats",
}


def assumption_in_words(diagnostics: Mapping[str, float]) -> list[str]:
    """Return sentences that belong to every answer of a vehicle that is not stated to be deterministic."""
    if diagnostics["counted"]:
        return [
            "the event happens often: it was counted by plain simulation. The estimate is its share in "
            f"{diagnostics['law_draws']:,.0f} draws of the law itself, because they contain more events than "
            "the other runs explain"
        ]
    if diagnostics["differed"] or not (repeats := int(diagnostics["repeats"])):
        return []
    return [
        f"{repeats} repeats without a difference exclude ({CONFIDENCE}) that more than "
        f"{1 - UNSEEN_ALPHA ** (1 / repeats):.1%} of the repeated runs end differently by chance. A "
        "vehicle with rarer lapses can pass this check, and its probability may then be much larger"
    ]


def checks_in_words(estimate: Estimate) -> list[str]:
    """Return a sentence with the number of runs that only check whether the vehicle is deterministic."""
    found = estimate.diagnostics
    checks = int(found["repeats"]) + int(found["law_draws"])
    if not found["repeats"] or found["differed"] or found["counted"]:
        return []
    return [
        f"{checks:,} of the {estimate.simulations:,} simulations checked whether the vehicle is "
        "deterministic, and all agreed; if you know that it is, `vehicle: {deterministic: true}` in the "
        "configuration saves them"
    ]


def chance_in_words(diagnostics: Mapping[str, float], deterministic: bool | None) -> str:
    """Return sentences about the repeated runs, and about the events that lapses can add to an estimate.

    ``deterministic`` is what is stated about the vehicle, None if nothing is.
    """
    repeats, differed = int(diagnostics["repeats"]), int(diagnostics["differed"])
    if not repeats:
        return f"repeats: {NO_REPEATS[deterministic]}"
    lines = [f"repeats: {repeats} runs were made a second time, and {differed} of them ended differently"]
    if draws := int(diagnostics["law_draws"]):
        events = int(diagnostics["law_events"])
        lines.append(f"draws of the law itself: {draws}, of which {events} ended in the event")
    lines += assumption_in_words(diagnostics)
    if diagnostics["drift"]:
        lines.append(
            "drift: late repetitions differ from early ones in one direction, so that the vehicle changes "
            "with the number of its runs. The estimate mixes its states and has no meaning"
        )
    if not math.isnan(bound := diagnostics.get("unseen_lapses", math.nan)):
        lines.append(
            f"rare lapses can add up to {bound:.1g} ({CONFIDENCE}, without any assumption about where they "
            "happen); the interval includes this bound, and the estimate has not converged"
        )
    if not math.isnan(runs := diagnostics.get("settling_runs", math.nan)):
        lines.append(
            f"to exclude such lapses, at least {runs:,.0f} draws of the law itself without an event would be "
            "needed"
        )
    return "\n".join(lines)
