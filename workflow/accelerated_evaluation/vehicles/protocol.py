"""The interface of a vehicle under test, the checks of its inputs and outcomes, and its events."""

import math
from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arguments import Argument
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.numerals import number_in
from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.scenarios import A_SCENARIO, DEFAULT, SCENARIOS
from accelerated_evaluation.scenarios.cut_in import CUT_IN, Outcomes
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.scenarios.outcomes import Outcome
from accelerated_evaluation.scenarios.protocol import Scenario

__all__ = ["VEHICLES", "Outcomes", "RandomVehicle", "Vehicle", "repeats_itself", "simulate_inner"]

# A new vehicle for cut-ins is a module of this package that registers its class.
VEHICLES: Registry[type["Vehicle"]] = CUT_IN.vehicles
CRASH = CUT_IN.event("crash")
OUTCOMES_GUIDE = "See accelerated_evaluation.vehicles.protocol for the outcomes that are expected."


@runtime_checkable
class Vehicle(Protocol):
    """A vehicle under test, which simulates batches of cut-ins.

    A vehicle may have an attribute ``deterministic``: True if an encounter always has the same outcomes,
    False if the outcomes are random, and None (or no such attribute) if this is unknown and has to be tested;
    see `repeats_itself`. It may also have an attribute ``striped``, which is True if the outcomes change
    between encounters that are almost equal. A sampler treats such a vehicle as random, even if it is
    deterministic.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> isinstance(ae.load_vehicle("acc_aeb"), ae.Vehicle)
    True
    """

    def simulate(self, lead_speed: Array, range_: Array, closing_speed: Array) -> Outcomes:
        """Simulate n cut-ins, and return their outcomes.

        Parameters
        ----------
        lead_speed, range_, closing_speed
            Lead speed [m/s], range [m] and closing speed [m/s] at the start, each of shape (n,).
        """


@runtime_checkable
class RandomVehicle(Vehicle, Protocol):
    """A vehicle with random outcomes, which are deterministic given the values of its inner variables.

    Inner variables are random variables of the vehicle itself, for example the traits of a driver. They form
    an array with one row for each encounter. Such a vehicle has a crash map, in which each line has its own
    inner variables.
    """

    def draw_inner(self, size: int, generator: np.random.Generator) -> Array:
        """Draw the random inner variables of the vehicle for ``size`` encounters, shape (size, variables)."""

    def simulate_given(
        self, lead_speed: Array, range_: Array, closing_speed: Array, inner: Array
    ) -> Outcomes:
        """Return the outcomes of n cut-ins with given inner variables, shape (n, variables).

        Lead speed [m/s], range [m] and closing speed [m/s] at the start have shape (n,).
        """

    def inner_weights(self, inner: Array, draws: int, generator: np.random.Generator) -> Array:
        """Return importance weights of inner variables for random parameters of their distribution.

        The distribution of the inner variables has parameters that are known only within ranges. `draw_inner`
        draws from the mixture over all values of the parameters. The weights are the ratios of the density
        for one value of the parameters to the density of this mixture. The weights have the shape (draws, n),
        and their mean over the draws is 1 for each encounter.
        """


@runtime_checkable
class MovingVehicle(Protocol):
    """A vehicle that can be simulated behind a lead vehicle that changes its speed.

    A `RandomVehicle` of this kind also has a method ``simulate_moving_given``, with the inner variables as
    the fifth argument.
    """

    def simulate_moving(
        self, lead_speed: Array, range_: Array, closing_speed: Array, lead_speeds: Array
    ) -> Outcomes:
        """Simulate n cut-ins with lead speeds [m/s] at 0, 0.1, ... s, up to 8 s or more, (n, states)."""


def simulate_inner(vehicle: Vehicle, cut_ins: tuple[Array, Array, Array], inner: Array | None) -> Outcomes:
    """Return the outcomes of n cut-ins, simulated with given inner variables if the vehicle has any.

    With ``inner`` None, a `RandomVehicle` draws them itself.
    """
    if inner is None or not isinstance(vehicle, RandomVehicle):
        return vehicle.simulate(*cut_ins)
    return vehicle.simulate_given(*cut_ins, inner)


def inner_of(vehicle: Vehicle, size: int, generator: np.random.Generator) -> Array | None:
    """Draw the inner variables of a `RandomVehicle` for so many encounters; None if the vehicle has none."""
    return vehicle.draw_inner(size, generator) if isinstance(vehicle, RandomVehicle) else None


def repeats_itself(vehicle: Vehicle) -> bool | None:
    """Return whether an encounter always has the same outcomes with this vehicle; None if this is unknown."""
    return getattr(vehicle, "deterministic", None)


def _events(value: Any) -> tuple[Event | str, ...]:  # noqa: ANN401
    events = (value,) if isinstance(value, Event | str) else tuple(value)
    if not all(isinstance(each, Event | str) for each in events):
        raise TypeError
    return events


EVENTS = Argument(
    "events, or texts such as 'impact_speed=5'", _events, "Write, for example, ['impact_speed=5']."
)


@checked(scenario=A_SCENARIO)
def event_named(text: str, scenario: Scenario = SCENARIOS[DEFAULT], where: str = "--event") -> Event:
    """Return the event that a text such as ``crash`` or ``impact_speed=5`` names.

    Parameters
    ----------
    text
        ``crash`` or another event without a threshold; or a quantity and a threshold in its unit, separated
        by an equals sign.
    scenario
        The scenario, whose events determine the possible quantities; or its name.
    where
        Name of the option or key of the configuration, for the error.

    Raises
    ------
    InputError
        If the scenario has no such event, or the threshold is missing, negative or not a number.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> event = ae.event_named("impact_speed=5", "left_turn")
    >>> ae.SCENARIOS["left_turn"].event_in_words(event)
    'impact speed above 5 m/s'
    """
    quantity, _, threshold = text.partition("=")
    try:
        value = number_in(threshold or "nan")
    except ValueError:
        value = math.nan
    plain = [each.quantity for each in scenario.events if each.at is None]
    if text in plain:
        return scenario.event(text)
    names = [each.quantity for each in scenario.events if each.at is not None]
    if quantity in names and math.isfinite(value) and value >= 0:
        return scenario.event(quantity, value)
    others = f", or {' or '.join(names)} with a threshold, such as {names[0]}=1" if names else ""
    expected = f"{' or '.join(plain)}{others}"
    raise InputError(where, seen=repr(text), expected=expected, change="Correct the event.")


def events_of(scenario: Scenario, thresholds: Mapping[str, list[float]]) -> list[Event]:
    """Return the events of a scenario in addition to the crash, with thresholds by the name of the event.

    Events without a threshold are always included. Events that the scenario does not have are left out.
    """
    names = [each.quantity for each in scenario.events[1:]]
    named = [each for each in scenario.events[1:] if each.at is None]
    named += [
        scenario.event(name, float(value))
        for name, values in thresholds.items()
        if name in names
        for value in values
    ]
    return list(dict.fromkeys(named))


def checked_outcomes(outcomes: object, encounters: Array, *, vehicle: str, scenario: Scenario) -> Any:  # noqa: ANN401
    """Check what ``simulate`` of a user's vehicle returned, and return it as the scenario's outcome type.

    InputError names the first encounter for which an outcome is missing, has a wrong shape or type, or breaks
    a rule of the scenario.
    """
    columns = {
        each.name: _checked_column(outcomes, each, encounters.shape[1], vehicle, scenario)
        for each in scenario.outcomes
    }
    rules = scenario.rules.outcomes(dict(zip(scenario.names, encounters, strict=True)) | columns)
    required = [each.name for each in scenario.outcomes if not each.optional]
    rules += [(np.isnan(columns[name]), name, "a number") for name in required]
    for wrong, name, expected in rules:
        if wrong.any():
            row = int(np.argmax(wrong))
            what = f"{name}[{row}] of {scenario.described(encounters[:, row])}"
            raise outcome_error(vehicle, what, repr(columns[name][row].item()), expected)
    return scenario.outcome_type(**columns)


def outcome_error(
    vehicle: str, what: str, seen: str, expected: str, change: str = "Correct the vehicle."
) -> InputError:
    """Return the error for a user's vehicle whose outcomes (``what`` names the part) are not as expected."""
    advice = f"{change} {OUTCOMES_GUIDE}"
    return InputError(f"vehicle {vehicle}, {what}", seen=seen, expected=expected, change=advice)


def _checked_column(
    outcomes: object, outcome: Outcome, count: int, vehicle: str, scenario: Scenario
) -> NDArray:
    """Return one outcome of a user's vehicle as an array of booleans or floats, shape (count,)."""
    name = outcome.name
    if outcome.optional and getattr(outcomes, name, None) is None:
        return np.full(count, np.nan)
    try:
        column = np.asarray(getattr(outcomes, name))
    except AttributeError as error:
        seen = type(outcomes).__name__
        required = [each.name for each in scenario.outcomes if not each.optional]
        expected = f"Outcomes with {', '.join(required)}"
        raise outcome_error(vehicle, "simulate", seen, expected) from error
    except Exception as error:  # for example a property of the user's class that raises an error
        seen = f"{type(error).__name__}: {' '.join(str(error).split())}"
        raise outcome_error(vehicle, name, seen, f"an array of shape ({count},)") from error
    if column.shape != (count,):
        raise outcome_error(vehicle, name, f"shape {column.shape}", f"shape ({count},)")
    kinds, meaning = ("b", "booleans") if outcome.is_flag else ("fiu", "real numbers")
    if column.dtype.kind not in kinds:
        raise outcome_error(vehicle, name, f"an array of {column.dtype}", f"an array of {meaning}")
    # A copy, because a vehicle may use the same arrays for its next batch.
    return np.array(column, dtype=bool if outcome.is_flag else np.float64)
