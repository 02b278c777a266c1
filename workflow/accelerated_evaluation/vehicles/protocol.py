"""The interface of a vehicle under test: its inputs and its outcomes."""

import math
from collections.abc import Mapping
from typing import Protocol, runtime_checkable

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.scenarios.cut_in import CUT_IN, Outcomes
from accelerated_evaluation.scenarios.protocol import Event, Scenario

__all__ = ["VEHICLES", "Outcomes", "RandomVehicle", "Vehicle", "repeats_itself", "simulate_inner"]


@runtime_checkable
class Vehicle(Protocol):
    """A vehicle under test, which simulates batches of cut-ins.

    A vehicle may have an attribute ``deterministic``: True if an encounter always has the same outcomes,
    False if the outcomes are random, and None (or no such attribute) if this is unknown and has to be tested;
    see `repeats_itself`. It may also have an attribute ``striped``, which is True if the outcomes change
    between encounters that are almost equal. A sampler treats such a vehicle as random, even if it is
    deterministic.
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


def repeats_itself(vehicle: Vehicle) -> bool | None:
    """Return whether an encounter always has the same outcomes with this vehicle; None if this is unknown."""
    return getattr(vehicle, "deterministic", None)


# A new vehicle for cut-ins is a module of this package that registers its class.
VEHICLES: Registry[type[Vehicle]] = CUT_IN.vehicles


CRASH = CUT_IN.event("crash")


def event_named(text: str, scenario: Scenario = CUT_IN, where: str = "--event") -> Event:
    """Return the event that a text such as ``crash`` or ``impact_speed=5`` names.

    Parameters
    ----------
    text
        ``crash``, or a quantity and a threshold in its unit, separated by an equals sign.
    scenario
        The scenario, whose events determine the possible quantities.
    where
        Name of the option or key of the configuration, for the error.

    Raises
    ------
    InputError
        If the scenario has no such event, or the threshold is missing, negative or not a number.
    """
    quantity, _, threshold = text.partition("=")
    try:
        value = float(threshold or "nan")
    except ValueError:
        value = math.nan
    if text == CRASH.quantity:
        return scenario.event(text)
    names = [each.quantity for each in scenario.events if each.quantity != CRASH.quantity]
    if quantity in names and math.isfinite(value) and value >= 0:
        return scenario.event(quantity, value)
    others = f", or {' or '.join(names)} with a threshold, such as {names[0]}=1" if names else ""
    raise InputError(where, seen=repr(text), expected=f"crash{others}", change="Correct the event.")


def events_of(scenario: Scenario, thresholds: Mapping[str, list[float]]) -> list[Event]:
    """Return the events of a scenario in addition to the crash, with thresholds by the name of the outcome.

    Outcomes that the scenario does not have are left out.
    """
    names = [each.quantity for each in scenario.events[1:]]
    return [
        scenario.event(name, float(value))
        for name, values in thresholds.items()
        if name in names
        for value in values
    ]


def events_from(thresholds: Mapping[str, list[float]]) -> list[Event]:
    """Return the crash, followed by events with thresholds of quantities such as ``impact_speed`` [m/s]."""
    return [
        CRASH,
        *(CUT_IN.event(name, float(value)) for name, values in thresholds.items() for value in values),
    ]
