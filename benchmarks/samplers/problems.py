"""The problems on which the samplers are compared: cut-ins before three vehicles, and textbook limit states.

Every problem is an event in the space of normal scores. Those of cut-ins whose law can be tilted are also
given as a `Problem` of the library, which the paper's methods need.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.files import read_json
from accelerated_evaluation.laws import Factors
from accelerated_evaluation.laws.distributions import (
    BoundedExponential,
    BoundedNormal,
    Empirical,
    Mixture,
    Pareto,
    PiecewiseMixture,
    from_dict,
)
from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.methods import problem as library
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.vehicles import AccAeb, Outcomes, Vehicle, load_vehicle
from fewruns.problems import Response, ScoreProblem, SystemProblem
from scipy.special import ndtr
from scipy.stats import chi2
from tabulated import tabulated

DATA = Path(__file__).resolve().parent / "data"
CLOSING_SPEED_MAX = 23.49  # [m/s], the authors' cap
LEAD_SPEEDS = 20_000  # values of v_L in a segment

# Fitted to the 75,783 real lane changes of SPMD with 5 <= v_L < 15 m/s (R^-1: to those of all segments):
# two bounded exponentials, and two normals below the 95 % quantile with an exponential tail above it.
TTC_KNOT = 0.16584979763175556  # [1/s]
INVERSE_RANGE = PiecewiseMixture(
    (0.8003511730065861, 0.1996488269934139),
    (BoundedExponential(110.00289015718049, 1 / 75, 0.0345), BoundedExponential(44.263279433807504, 0.0345)),
)
TTC_BODY = Mixture(
    (0.20430964630501555, 0.7956903536949844),
    (BoundedNormal(0.036567399002002614, 0.0, TTC_KNOT), BoundedNormal(0.08801324906495872, 0.0, TTC_KNOT)),
)
TTC_TAIL = BoundedExponential(21.084581450393657, TTC_KNOT)
INVERSE_TTC = PiecewiseMixture((0.95, 0.05), (TTC_BODY, TTC_TAIL))


@dataclass(frozen=True)
class Problem:
    """A rare event, and what some methods must be reported about it.

    Attributes
    ----------
    name
        In tables and in file names.
    event
        The event in the space of normal scores, with its score.
    threshold
        Score at which the event begins.
    smooth
        The same event with a score that is continuous, of order one, and at most 0 in the event, for methods
        that follow its slope; None where the score of ``event`` is.
    cut_in
        For the paper's methods; None where they cannot be used.
    exact
        The probability where it has a closed form or is an integral in one dimension.
    published
        The probability that a public collection gives; NaN where it gives none.
    simpler
        An event of the same probability in fewer dimensions.
    ours_only
        Whether it is too much for all methods but ours.
    """

    name: str
    event: ScoreProblem
    threshold: float = 0.0
    smooth: ScoreProblem | None = None
    cut_in: library.Problem | None = None
    exact: float | None = None
    published: float = math.nan
    simpler: ScoreProblem | None = None
    ours_only: bool = False


def below_zero(
    name: str, dimension: int, margin: Callable[[Array], Array], *, graded: bool = True
) -> SystemProblem:
    """Return the event that a margin of z, shape (n, d), is at most 0; if graded, the margin is its score."""

    def respond(z: Array) -> Response:
        score = margin(z)
        return score <= 0, score if graded else None

    return SystemProblem(respond, dimension, fingerprint=name, deterministic=True)


def derived(event: ScoreProblem, respond: Callable[[Array], Response], **changed: Any) -> SystemProblem:
    """Return an event with the properties of another one, but for its outcomes and what is ``changed``."""
    kept = {"fingerprint": event.fingerprint, "deterministic": event.deterministic}
    kept["upper_set"] = getattr(event, "upper_set", False)
    return SystemProblem(respond, event.dimension, **(kept | changed))


def scored(problem: library.Problem, score: Callable[[Outcomes, Array], Array]) -> SystemProblem:
    """Return the event "score <= 0" of the outcomes of cut-ins and of the cut-ins x, shape (n, 3)."""

    def respond(z: Array) -> Response:
        x = problem.law.from_normal_scores(z)
        scores = score(problem.simulate(x), x)
        return scores <= 0, scores

    return derived(problem, respond, fingerprint=f"{problem.fingerprint}; {score.__qualname__}")


@cache
def law() -> IndependentLaw:
    """Return the law that the benchmark keeps, with its cap on closing speeds (data/README.md)."""
    content = read_json(DATA / "model.json")
    return IndependentLaw(
        description=content["description"],
        counts=content["events"],
        inverse_range=from_dict(content["inverse_range"]["distribution"]),
        inverse_ttc={
            segment: from_dict(each) for segment, each in content["inverse_ttc"]["distributions"].items()
        },
        lead_speeds={segment: lead_speed(segment) for segment in content["events"]},
        closing_speed_max=CLOSING_SPEED_MAX,
    )


@cache
def lead_speed(segment: str) -> Empirical:
    """Return v_L [m/s] in a segment, from its quantiles."""
    table = pd.read_csv(DATA / "lead_speed_quantiles.csv").set_index("segment").loc[segment]
    middles = (np.arange(LEAD_SPEEDS) + 0.5) / LEAD_SPEEDS
    return Empirical(np.interp(middles, table["probability"], table["lead_speed [m/s]"]))


def segment_problem(segment: str, vehicle: Vehicle, factors: Factors | None = None) -> library.Problem:
    """Set up the cut-ins of a segment, by default with the distributions of the benchmark's law."""
    only = law().only(segment)
    if factors is not None:
        only = replace(only, inverse_range=factors.first, inverse_ttc={segment: factors.second})
    return library.Problem(CUT_IN, vehicle, law=only)


def range_left(outcomes: Outcomes, x: Array) -> Array:
    """Return the smallest range over the first, which is at most 0 at a crash."""
    return outcomes.min_range / x[:, 1]


def crash(name: str, problem: library.Problem, *, tiltable: bool = True) -> Problem:
    """Return a crash in one segment; its smooth score is the smallest range over the first."""
    event = tabulated(problem)
    smooth = scored(event, range_left)
    return Problem(name, event, smooth=smooth, cut_in=problem if tiltable else None)


def other_event(name: str, event: Event, nearer: Callable[[Outcomes, Array], Array]) -> Problem:
    """Return another event of the main problem, with its smooth score."""
    problem = replace(segment_problem("5-15", AccAeb(), BENCHMARK), event=event)
    quick = tabulated(problem)
    # The score of a crash is less its impact speed where that is the event.
    threshold = -event.threshold if event.quantity == "impact_speed" else event.threshold
    return Problem(name, quick, threshold, scored(quick, nearer), cut_in=problem)


def near_miss(name: str, ttc: float) -> Problem:
    """Return a time to collision of at most ``ttc`` [s]; its smooth score is the inverse of that time."""

    def nearer(outcomes: Outcomes, x: Array) -> Array:
        return 1 / ttc - 1 / outcomes.min_ttc

    return other_event(name, CUT_IN.event("min_ttc", ttc), nearer)


def short_range(metres: float) -> Problem:
    """Return a smallest range of at most so many metres; its smooth score is what is left over the first."""

    def nearer(outcomes: Outcomes, x: Array) -> Array:
        return (outcomes.min_range - metres) / x[:, 1]

    return other_event(f"range_{metres:g}", CUT_IN.event("min_range", metres), nearer)


def hard_impact(speed: float) -> Problem:
    """Return an impact above a speed [m/s]; its smooth score goes on from the range left before a crash."""

    def nearer(outcomes: Outcomes, x: Array) -> Array:
        impact = np.nan_to_num(outcomes.impact_speed)
        before = 1 + range_left(outcomes, x)
        return np.where(outcomes.crash, 1 - impact / speed, before)

    return other_event(f"impact_{speed:g}", CUT_IN.event("impact_speed", speed), nearer)


def limit_state(
    name: str, g: Callable[..., Array], exact: float | None = None, dimension: int = 2
) -> Problem:
    """Return the event g(z_1, ..., z_d) <= 0."""
    return Problem(name, below_zero(name, dimension, lambda z: g(*z.T)), exact=exact)


def whole() -> Problem:
    """Return a crash in any segment."""
    event = tabulated(library.Problem(CUT_IN, AccAeb(), law=law()))
    return Problem("all_segments", event, ours_only=True)


def two_regions(a: Array, b: Array) -> Array:
    """Two separate half-planes, at the distances 4.2 and 4.5."""
    return np.minimum(4.2 - (a + b) / np.sqrt(2), 4.5 + (a + b) / np.sqrt(2))


def circle(*z: Array) -> Array:
    """Everything outside a circle or ball of radius 5: no direction is the most likely one."""
    return 5 - np.sqrt(sum(x * x for x in z))


def plane(*z: Array) -> Array:
    """Return the margin of a half-space at the distance 4.5, in which all variables are alike."""
    return 4.5 - sum(z) / np.sqrt(len(z))


def four_branches(a: Array, b: Array) -> Array:
    """Series system of four branches, two of them curved (Waarts 2000), moved to a rarer event."""
    bow, along, across = 0.1 * (a - b) ** 2, (a + b) / np.sqrt(2), a - b
    branches = 5 + bow - along, 5 + bow + along, across + 9 / np.sqrt(2), 9 / np.sqrt(2) - across
    return np.minimum.reduce(branches)


BENCHMARK = Factors(INVERSE_RANGE, INVERSE_TTC)
SINGLE = Factors(Pareto(1.732, 1 / 75), BoundedExponential(15.81))  # like the authors' earlier work
WEAK_AEB = {"aeb_deceleration": 5.8, "aeb_jerk": 12.0, "aeb_ttc": 0.7}


@cache
def problems() -> dict[str, Problem]:
    """Return all problems by name."""
    weak = load_vehicle("acc_aeb", **WEAK_AEB)
    both = float(ndtr(-4.2) + ndtr(-4.5))
    everything = [
        crash("segment_5_15", segment_problem("5-15", AccAeb(), BENCHMARK)),
        crash("segment_15_25", segment_problem("15-25", AccAeb())),
        replace(crash("segment_25_35", segment_problem("25-35", AccAeb())), ours_only=True),
        crash("weak_aeb", segment_problem("5-15", weak, BENCHMARK)),
        crash("no_aeb", segment_problem("5-15", load_vehicle("acc_only"), BENCHMARK)),
        crash("pareto", segment_problem("5-15", AccAeb(), SINGLE), tiltable=False),
        near_miss("near_miss_1e-3", 2.491),
        near_miss("near_miss_1e-5", 0.6342),
        limit_state("two_regions", two_regions, both),
        limit_state("circle", circle, float(np.exp(-12.5))),
        limit_state("four_branches", four_branches),
        *(short_range(metres) for metres in (2.0, 1.0, 0.5)),
        *(hard_impact(speed) for speed in (5.0, 10.0)),
        *(
            crash(f"driver_{name}", segment_problem("5-15", load_vehicle(name), BENCHMARK))
            for name in ("cc_human", "reg157", "fsm", "rss")
        ),
        limit_state("ball_4", circle, float(chi2.sf(25, 4)), 4),
        *(limit_state(f"plane_{d}", plane, float(ndtr(-4.5)), d) for d in (6, 10)),
        whole(),
    ]
    return {problem.name: problem for problem in everything}
