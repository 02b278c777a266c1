"""The problems on which the samplers are compared: cut-ins before three vehicles, and textbook limit states.

Every problem is an event in the space of normal scores, a `RareEvent`. Those of cut-ins are also given as a
`CutIn`, which the paper's methods need.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from accelerated_evaluation.distributions import (
    BoundedExponential,
    BoundedNormal,
    Distribution,
    Empirical,
    Mixture,
    Pareto,
    PiecewiseMixture,
)
from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.laws.lane_change_model import LaneChangeModel, read_model
from accelerated_evaluation.problem import CutIn, Proposal
from accelerated_evaluation.rare_event import RareEvent, cut_in_event
from accelerated_evaluation.vehicles import AccAeb, Outcomes, Vehicle, load_vehicle
from accelerated_evaluation.vehicles.events import Event
from scipy.special import ndtr

DATA = Path(__file__).resolve().parent / "data"
CLOSING_SPEED_MAX = 23.49  # [m/s], the authors' cap
LEAD_SPEEDS = 20_000  # values of v_L in a segment

# Fitted to the 75,783 real lane changes of SPMD with 5 <= v_L < 15 m/s (R^-1: to those of all segments):
# two bounded exponentials, and two normals below the 95 % quantile with an exponential tail above it.
TTC_KNOT = 0.16584979763175556  # [1/s]
INVERSE_RANGE = PiecewiseMixture(
    (0.8003511730065861, 0.1996488269934139),
    (
        BoundedExponential(110.00289015718049, 1 / 75, 0.0345),
        BoundedExponential(44.263279433807504, 0.0345),
    ),
)
TTC_BODY = Mixture(
    (0.20430964630501555, 0.7956903536949844),
    (
        BoundedNormal(0.036567399002002614, 0.0, TTC_KNOT),
        BoundedNormal(0.08801324906495872, 0.0, TTC_KNOT),
    ),
)
TTC_TAIL = BoundedExponential(21.084581450393657, TTC_KNOT)
INVERSE_TTC = PiecewiseMixture((0.95, 0.05), (TTC_BODY, TTC_TAIL))


@dataclass(frozen=True)
class Problem:
    """A rare event, and what some methods must be told about it.

    Attributes
    ----------
    name, label
        In file names and in figures.
    event
        The event with its score.
    threshold
        Score at which the event begins.
    smooth
        The same event with a score that is continuous, of order one, and at most 0 in the event, for methods
        that follow its slope; None where the score of ``event`` is.
    cut_in
        For the paper's methods; None where they cannot be used.
    exact
        The probability where it is known.
    ours_only
        Whether it is too much for all methods but ours.
    """

    name: str
    label: str
    event: RareEvent
    threshold: float = 0.0
    smooth: RareEvent | None = None
    cut_in: CutIn | None = None
    exact: float | None = None
    ours_only: bool = False


@dataclass(frozen=True)
class NearMiss:
    """A vehicle whose near misses are told as crashes, so that the paper's methods estimate them."""

    vehicle: Vehicle
    event: Event

    def simulate(self, lead_speed: Array, range_: Array, closing_speed: Array) -> Outcomes:
        """Simulate n cut-ins; see `Vehicle`."""
        outcomes = self.vehicle.simulate(lead_speed, range_, closing_speed)
        return replace(outcomes, crash=self.event.happens(outcomes))


class Tabulated:
    """A bounded law whose quantiles come from a table of its cdf: a mixture's own have no closed form.

    Between 20,001 points they are straight lines. A thousand times faster, which a benchmark of 10^9
    simulations needs; probabilities of the events here change by less than 10^-6 of themselves.
    """

    def __init__(self, law: Distribution) -> None:
        self.lower, self.upper = law.lower, law.upper
        self.x = np.linspace(law.lower, law.upper, 20_001)
        self.probability = law.cdf(self.x)

    def ppf(self, q: Array) -> Array:
        """Inverse of the cdf."""
        return np.interp(q, self.probability, self.x)

    def isf(self, q: Array) -> Array:
        """Inverse of the survival function."""
        return self.ppf(1 - q)


def tabulated(cut_in: CutIn) -> CutIn:
    """Return the cut-in with tables in place of the mixtures inside the laws of its model."""

    def quick(law: Distribution) -> Distribution:
        if not isinstance(law, PiecewiseMixture):
            return law
        pieces = [Tabulated(piece) if isinstance(piece, Mixture) else piece for piece in law.components]
        return PiecewiseMixture(law.weights, pieces)

    law = cut_in.model
    return replace(cut_in, model=Proposal(quick(law.inverse_range), quick(law.inverse_ttc)))


@cache
def model() -> LaneChangeModel:
    """Return the lane-change model that the benchmark keeps (data/README.md)."""
    return read_model(DATA / "model.json")


@cache
def lead_speed(segment: str) -> Empirical:
    """Return v_L [m/s] in a segment, from its quantiles."""
    table = pd.read_csv(DATA / "lead_speed_quantiles.csv").set_index("segment").loc[segment]
    middles = (np.arange(LEAD_SPEEDS) + 0.5) / LEAD_SPEEDS
    return Empirical(np.interp(middles, table["probability"], table["lead_speed [m/s]"]))


def segment_cut_in(segment: str, vehicle: Vehicle, law: Proposal | None = None) -> CutIn:
    """Set up the cut-ins of a segment, by default with the laws of the model."""
    law = law or Proposal(model().inverse_range, model().inverse_ttc[segment])
    return CutIn(lead_speed(segment), law, vehicle, CLOSING_SPEED_MAX)


def scored(event: RareEvent, cut_in: CutIn, score: Callable[[Outcomes, Array], Array]) -> RareEvent:
    """Return the event "score <= 0" of outcomes and inputs, shape (n, 3)."""

    def respond(x: Array) -> tuple[Array, Array]:
        scores = score(cut_in.simulate(*x.T), x)
        return scores <= 0, scores

    return replace(event, respond=respond)


def crash(name: str, label: str, cut_in: CutIn, *, tiltable: bool = True) -> Problem:
    """Return a crash in one segment; its smooth score is the smallest range over the first."""
    event = cut_in_event({"segment": tabulated(cut_in)}, {"segment": 1.0})
    smooth = scored(event, cut_in, lambda outcomes, x: outcomes.min_range * x[:, 1])
    return Problem(name, label, event, smooth=smooth, cut_in=cut_in if tiltable else None)


def near_miss(name: str, label: str, ttc: float) -> Problem:
    """Return a time to collision of at most ``ttc`` [s]; its smooth score is the inverse of that time."""
    kind, cut_in = Event("min_ttc", ttc), segment_cut_in("5-15", AccAeb(), BENCHMARK)
    event = cut_in_event({"segment": tabulated(cut_in)}, {"segment": 1.0}, kind)
    smooth = scored(event, cut_in, lambda outcomes, _: 1 / ttc - 1 / outcomes.min_ttc)
    wrapped = replace(cut_in, vehicle=NearMiss(cut_in.vehicle, kind))
    return Problem(name, label, event, ttc, smooth, wrapped)


def limit_state(
    name: str, label: str, g: Callable[[Array, Array], Array], exact: float | None = None
) -> Problem:
    """Return the event g(z_1, z_2) <= 0."""

    def respond(z: Array) -> tuple[Array, Array]:
        score = g(*z.T)
        return score <= 0, score

    return Problem(name, label, RareEvent(2, lambda z: z, respond), exact=exact)


def whole() -> Problem:
    """Return a crash in any segment of the model."""
    cut_ins = {segment: tabulated(segment_cut_in(segment, AccAeb())) for segment in model().segments}
    shares = {segment: model().share(segment) for segment in model().segments}
    return Problem("all_segments", "all segments", cut_in_event(cut_ins, shares), ours_only=True)


def two_regions(a: Array, b: Array) -> Array:
    """Two separate half-planes, at the distances 4.2 and 4.5."""
    return np.minimum(4.2 - (a + b) / np.sqrt(2), 4.5 + (a + b) / np.sqrt(2))


def circle(a: Array, b: Array) -> Array:
    """Everything outside a circle of radius 5: no direction is the most likely one."""
    return 5 - np.hypot(a, b)


def four_branches(a: Array, b: Array) -> Array:
    """Series system of four branches, two of them curved (Waarts 2000), moved to a rarer event."""
    bow, along, across = 0.1 * (a - b) ** 2, (a + b) / np.sqrt(2), a - b
    branches = 5 + bow - along, 5 + bow + along, across + 9 / np.sqrt(2), 9 / np.sqrt(2) - across
    return np.minimum.reduce(branches)


BENCHMARK = Proposal(INVERSE_RANGE, INVERSE_TTC)
SINGLE = Proposal(Pareto(1.732, 1 / 75), BoundedExponential(15.81))  # like the authors' earlier work
WEAK_AEB = {"aeb_deceleration": 5.8, "aeb_jerk": 12.0, "aeb_ttc": 0.7}


@cache
def problems() -> dict[str, Problem]:
    """Return all problems by name."""
    weak = load_vehicle("acc_aeb", **WEAK_AEB)
    both = float(ndtr(-4.2) + ndtr(-4.5))
    everything = [
        crash("segment_5_15", "5–15 m/s", segment_cut_in("5-15", AccAeb(), BENCHMARK)),
        crash("segment_15_25", "15–25 m/s", segment_cut_in("15-25", AccAeb())),
        replace(crash("segment_25_35", "25–35 m/s", segment_cut_in("25-35", AccAeb())), ours_only=True),
        crash("weak_aeb", "weak AEB", segment_cut_in("5-15", weak, BENCHMARK)),
        crash("no_aeb", "no AEB", segment_cut_in("5-15", load_vehicle("acc_only"), BENCHMARK)),
        crash("pareto", "Pareto", segment_cut_in("5-15", AccAeb(), SINGLE), tiltable=False),
        near_miss("near_miss_1e-3", "TTC ≤ 2.49 s", 2.491),
        near_miss("near_miss_1e-5", "TTC ≤ 0.63 s", 0.6342),
        limit_state("two_regions", "two regions", two_regions, both),
        limit_state("circle", "circle", circle, float(np.exp(-12.5))),
        limit_state("four_branches", "four branches", four_branches),
        whole(),
    ]
    return {problem.name: problem for problem in everything}
