"""The problem of every method: a vehicle in encounters that follow a law, and an event."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from types import NoneType
from typing import Any, Self

import numpy as np
import pandas as pd
from fewruns.problems import Response
from numpy.typing import NDArray

from accelerated_evaluation.base.arguments import one_of
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import without_addresses
from accelerated_evaluation.laws import Law, StratifiedLaw
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.laws.protocol import require_points
from accelerated_evaluation.records.segments import read_encounters
from accelerated_evaluation.scenarios import A_SCENARIO, SCENARIOS
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.loading import as_vehicle
from accelerated_evaluation.vehicles.named import NamedVehicle
from accelerated_evaluation.vehicles.protocol import Vehicle, event_named, repeats_itself

REACH = 8.0  # largest absolute value of a normal score
HALVINGS = 50  # after which the interval of a score is shorter than the resolution of floats
SAME = 1e-6  # relative tolerance for an encounter that its normal scores reproduce

AN_EVENT = one_of(Event, str, NoneType, words="an event, or text such as 'crash' or 'impact_speed=5'")
A_LAW = one_of(
    Law, NoneType, words="a law of the encounters", change="Fit one, or read a law file with read_law."
)


@checked(scenario=A_SCENARIO, event=AN_EVENT, law=A_LAW)
@dataclass(frozen=True)
class Problem:
    """A vehicle in the encounters of a scenario that follow a law, and an event whose probability is sought.

    Parameters
    ----------
    scenario
        The scenario, which names the d variables of an encounter; or its name.
    vehicle
        Object whose ``simulate`` takes one array of shape (n,) for each variable, a function like this
        method, or the name of a vehicle as in `load_vehicle`.
    event
        An event of the outcomes, or text such as ``impact_speed=5``; by default the first event of the
        scenario, the crash.
    law
        Law of the variables. `evaluate` needs none, because it takes the encounters from draws of the law.
    graded
        Whether samplers may use the score of the event, in addition to whether it happened.

    Raises
    ------
    InputError
        If an argument is none of these, or if the law has other variables than the scenario or exceeds its
        limits.

    Examples
    --------
    >>> import numpy as np
    >>> import accelerated_evaluation as ae
    >>> problem = ae.Problem("left_turn", "acc_aeb")
    >>> outcomes = problem.simulate(np.array([[14.0, 4.0, 5.0], [14.0, 4.0, 60.0]]))
    >>> problem.event.happens(outcomes)
    array([ True, False])
    """

    scenario: Scenario
    vehicle: Vehicle
    event: Event = None  # type: ignore[assignment]
    law: Law = None  # type: ignore[assignment]
    graded: bool = True

    def __post_init__(self) -> None:
        where, event = "Problem, argument", self.event
        if event is None:
            event = self.scenario.events[0]
        elif isinstance(event, str):
            event = event_named(event, self.scenario, f"{where} event")
        if event.scored_by not in (None, *self.scenario.outcome_names):
            outcomes = f"an outcome of {self.scenario.name}: {', '.join(self.scenario.outcome_names)}"
            seen, change = f"an event scored by {event.scored_by!r}", "Correct scored_by of the event."
            raise InputError(f"{where} event", seen=seen, expected=outcomes, change=change)
        object.__setattr__(self, "event", event)
        object.__setattr__(self, "vehicle", as_vehicle(self.vehicle, self.scenario, f"{where} vehicle"))
        if self.law is not None:
            require_law(self.scenario, self.law)

    @property
    def known_law(self) -> Law:
        """The law of the variables. InputError is raised if the problem has none."""
        if self.law is None:
            raise InputError(
                "Problem, argument law",
                seen="None",
                expected="a law of the encounters, which normal scores belong to",
                change="Write Problem(scenario, vehicle, law=law). Only `evaluate` with draws needs none.",
            )
        return self.law

    @property
    def stratified(self) -> StratifiedLaw:
        """The law, with its strata. InputError is raised if it has none."""
        if not isinstance(self.known_law, StratifiedLaw):
            raise InputError(
                "Problem, argument law",
                seen=f"a law without strata of the lead speed, {self.known_law.description}",
                expected="one of the paper's laws of cut-ins, whose strata the method tilts",
                change="Fit one with fit_paper_law, or choose a method that needs no strata.",
            )
        return self.known_law

    @property
    def dimension(self) -> int:
        """Number d of variables, and of normal scores."""
        return self.known_law.dimension

    @cached_property
    def fingerprint(self) -> str:
        """Text that identifies the problem, so that a saved state is only resumed for the same problem."""
        parts = self.scenario.name, self.known_law.digest, self.vehicle, self.event, self.graded
        return without_addresses(repr(parts))

    @property
    def upper_set(self) -> bool:
        """Whether every event also happens if the variable ``upper_set_in`` of the scenario is larger.

        No part of the event is then hidden. This is assumed of all vehicles except those with the attribute
        ``striped``.
        """
        return self.scenario.upper_set_in is not None and not getattr(self.vehicle, "striped", False)

    @property
    def deterministic(self) -> bool | None:
        """Whether the vehicle states that it repeats itself; None if it does not say.

        A vehicle whose crash set consists of many thin stripes counts as random, because a sampler that
        learns the set from few runs cannot resolve them.
        """
        return False if getattr(self.vehicle, "striped", False) else repeats_itself(self.vehicle)

    def only(self, stratum: str) -> Self:
        """Return the problem in one stratum of a stratified law, given by its name."""
        return replace(self, law=self.stratified.only(stratum))

    @checked()
    def simulate(self, x: Array, *, again: bool = False) -> Any:  # noqa: ANN401
        """Simulate the vehicle in n encounters x, shape (n, d), and return the outcomes of the scenario.

        Stored outcomes are not used if the encounters are simulated ``again``.
        """
        require_points(x, self.scenario.names, "Problem.simulate, argument x")
        repeat = getattr(self.vehicle, "repeat", self.vehicle.simulate)
        return (repeat if again else self.vehicle.simulate)(*x.T)

    @checked()
    def evaluate(self, z: Array) -> Response:
        """Simulate at normal scores z, shape (n, d); return the flags of the event and the scores."""
        require_points(z, self.scenario.names, "Problem.evaluate, argument z")
        return self.response(self.simulate(self.known_law.from_normal_scores(z)))

    def repeat(self, z: Array) -> Response:
        """Simulate again, without stored outcomes, at normal scores z, shape (n, d)."""
        return self.response(self.simulate(self.known_law.from_normal_scores(z), again=True))

    def begin(self, z: Array, again: bool) -> None:
        """Begin to simulate at normal scores z, (n, d), if the vehicle can; `simulate` or `repeat` waits."""
        if (begin := getattr(self.vehicle, "begin", None)) is not None:
            begin(*self.known_law.from_normal_scores(z).T, again=again)

    def coordinates(self, z: Array) -> dict[str, Array]:
        """Return the variables, each of shape (n,), at normal scores z, shape (n, d), by name."""
        return dict(zip(self.scenario.names, self.known_law.from_normal_scores(z).T, strict=True))

    def response(self, outcomes: Any) -> Response:  # noqa: ANN401
        """Return whether the event happened in n runs, shape (n,), and the scores, or None if not graded."""
        return self.event.happens(outcomes), self.event.score(outcomes) if self.graded else None


def require_law(scenario: Scenario, law: Law) -> None:
    """Raise InputError unless a law has the variables of a scenario, within their limits."""
    own = np.column_stack([law.box.lower, law.box.upper])
    if law.box.names != scenario.names or not _within(own, scenario.limits):
        raise InputError(
            f"the law for the scenario {scenario.name}",
            seen=_in_words(law.box.names, own),
            expected=f"limits within {_in_words(scenario.names, scenario.limits)}",
            change="Name a law of this scenario, or fit the law again within these limits.",
        )


def read_law_of(scenario: Scenario, path: str, records: pd.DataFrame | None = None) -> Law:
    """Read a law of a scenario from its file, with the encounter table that a law of cut-ins needs."""
    law = read_law(path, records)
    require_law(scenario, law)
    return law


def _within(limits: Array, others: Array) -> bool:
    return bool((limits[:, 0] >= others[:, 0]).all() and (limits[:, 1] <= others[:, 1]).all())


def _in_words(names: Sequence[str], limits: Array) -> str:
    rows = zip(names, limits.tolist(), strict=True)
    return ", ".join(f"{name} from {low:g} to {high:g}" for name, (low, high) in rows)


@contextmanager
def loaded_problem(law: str, encounters: str, vehicle: NamedVehicle) -> Iterator[Problem]:
    """Yield the problem of a vehicle in cut-ins under a law file, and close the vehicle at the end.

    ``encounters`` is the table to which the law was fitted.
    """
    with vehicle.loaded() as car:
        yield Problem(SCENARIOS["cut_in"], car, law=read_law(law, read_encounters(encounters)))


def normal_scores(from_normal_scores: Callable[[Array], Array], x: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the normal scores of encounters x, shape (n, d), by bisection of one variable after the other.

    Each variable depends on the scores up to its own, and increases or decreases with its own, as in a
    Rosenblatt transformation. The second result says whether the scores reproduce the encounter, shape (n,).
    They do not if it is outside of the law.
    """
    z = np.zeros_like(x)

    def at(value: Array | float, k: int) -> Array:
        z[:, k] = value
        return from_normal_scores(z)[:, k]

    for k in range(x.shape[1]):
        low, high = np.full(len(x), -REACH), np.full(len(x), REACH)
        increases = at(high, k) > at(low, k)
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            values = at(middle, k)
            is_below = np.where(increases, values < x[:, k], values > x[:, k])
            low, high = np.where(is_below, middle, low), np.where(is_below, high, middle)
        z[:, k] = high
    return z, np.all(np.isclose(from_normal_scores(z), x, rtol=SAME, atol=SAME), axis=1)
