"""What all methods share: target, count of simulator calls, shape of the result; and who runs where."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import wraps

import numpy as np
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.methods import METHODS, Stopping, normal_reach
from accelerated_evaluation.methods.problem import Problem as CutInProblem
from accelerated_evaluation.vehicles import Outcomes, Vehicle
from fewruns.problems import Response, ScoreProblem
from problems import Problem, derived

TOOLS = ("nais", "nais_25", "cross_entropy", "subset", "form", "enkf")  # public tools
DIRECTIONS = ("directional", "line")  # along rays and lines, for smooth limit states
LEARNING = ("pystra_subset", "ak_mcs")  # active learning, in an environment of its own
HOUSE = tuple(METHODS)
SEARCHING = ("piecewise", "single", "shifted")  # by Cross-Entropy; the paper's heuristic is like piecewise
LIMITS = {"surrogate": 1000, "crude": 2_000_000}  # simulator calls; other methods: that of `Target`
CRUDE_RUN = ("weak_aeb", "no_aeb", "near_miss_1e-3")  # elsewhere crude Monte Carlo needs more than 2 million


@dataclass(frozen=True)
class Target(Stopping):
    """The stopping rule of the benchmark, with what some methods are reported in other terms."""

    maximum_simulations: int = 200_000

    @property
    def cov(self) -> float:
        """The coefficient of variation that belongs to the half-width."""
        return self.beta / self.reach

    @property
    def reach(self) -> float:
        """Half-width of the interval in standard errors."""
        return normal_reach(self.alpha)


@dataclass(frozen=True)
class Outcome:
    """An estimate with its own intervals of 80 and 95 %, and what it took.

    Numbers are NaN where the method broke down or has none.
    """

    probability: float
    ci_low: float
    ci_high: float
    ci95_low: float
    ci95_high: float
    calls: int
    converged: bool


# probability, ci_low, ci_high, ci95_low, ci95_high, converged
Estimate = tuple[float, float, float, float, float, bool]


@dataclass
class Counter:
    """Counts simulator calls, and refuses those beyond the limit."""

    limit: float
    calls: int = field(default=0)

    def count(self, size: int) -> None:
        """Count calls that are about to be made."""
        if self.calls + size > self.limit:
            raise RuntimeError(f"more than {self.limit:,.0f} simulator calls")
        self.calls += size

    def event(self, event: ScoreProblem) -> ScoreProblem:
        """Return the event with its calls counted."""

        def respond(z: Array) -> Response:
            self.count(len(z))
            return event.evaluate(z)

        return derived(event, respond)

    def cut_in(self, problem: CutInProblem) -> CutInProblem:
        """Return a problem of cut-ins with the calls of its vehicle counted."""
        return replace(problem, vehicle=_CountedVehicle(problem.vehicle, self))

    def level(self, problem: Problem, *, smooth: bool = False) -> Callable[[Array], Array]:
        """Return a function of normal scores, shape (n, d), that is at most 0 in the event and only there."""
        if smooth and problem.smooth:
            event, threshold = self.event(problem.smooth), 0.0
        else:
            event, threshold = self.event(problem.event), problem.threshold

        def level(z: Array) -> Array:
            happened, score = event.evaluate(z)
            excess = score - threshold
            return np.where(happened, np.minimum(excess, 0.0), np.maximum(excess, np.finfo(float).tiny))

        return level


@dataclass(frozen=True)
class _CountedVehicle:
    vehicle: Vehicle
    counter: Counter

    def simulate(self, lead_speed: Array, range_: Array, closing_speed: Array) -> Outcomes:
        self.counter.count(len(lead_speed))
        return self.vehicle.simulate(lead_speed, range_, closing_speed)


def adapter(
    run: Callable[[Problem, Counter, np.random.Generator, Target], Estimate],
) -> Callable[[Problem, np.random.Generator, Target], Outcome]:
    """Count the calls of a method; an exception is an outcome too, and no reason to end the comparison."""

    @wraps(run)
    def estimate(problem: Problem, generator: np.random.Generator, target: Target) -> Outcome:
        counter = Counter(target.maximum_simulations)
        try:
            result = run(problem, counter, generator, target)
        except Exception as error:  # of any kind: the tools are not ours
            print(f"{run.__name__} on {problem.name}: {type(error).__name__}: {error}", flush=True)
            result = *[math.nan] * 5, False
        *numbers, converged = result
        return Outcome(*map(float, numbers), counter.calls, bool(converged))

    return estimate


def normal_95(probability: float, low: float, high: float) -> tuple[float, float]:
    """Return the normal 95 % interval of the same error as an 80 % interval of a probability."""
    half_width = (high - low) / 2 * normal_reach(0.05) / normal_reach(0.2)
    return probability - half_width, probability + half_width


def methods_of(problem: Problem) -> list[str]:
    """Return the methods that are run on a problem."""
    if problem.ours_only:
        return ["surrogate"]
    searching = SEARCHING if problem.cut_in else ()
    crude = ("crude",) if problem.name in CRUDE_RUN else ()
    directions = () if problem.smooth or problem.cut_in else DIRECTIONS
    return ["surrogate", *TOOLS, *directions, *searching, *crude]
