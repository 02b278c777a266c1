"""The protocol of a vehicle under test: its inputs and its outcomes."""

from typing import Protocol, runtime_checkable

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.scenarios.cut_in import Outcomes

__all__ = ["Outcomes", "RandomVehicle", "Vehicle", "repeats_itself", "simulate_inner"]


@runtime_checkable
class Vehicle(Protocol):
    """A car under test, simulated in batches.

    A vehicle may have an attribute ``deterministic``: True if an encounter always has the same outcomes,
    False if the outcomes are random, and None (or no such attribute) if this is unknown and has to be tested;
    see `repeats_itself`. An attribute ``striped`` that is True says that the outcomes change between
    encounters that nobody could distinguish. Such a vehicle may be deterministic, but a sampler treats it as
    random.
    """

    def simulate(self, lead_speed: Array, range_: Array, closing_speed: Array) -> Outcomes:
        """Simulate n cut-ins: lead speed [m/s], range [m], closing speed [m/s], each of shape (n,)."""


@runtime_checkable
class RandomVehicle(Vehicle, Protocol):
    """A vehicle whose randomness is known: given its inner variables, its outcomes are deterministic.

    The inner variables are an array with one row for each encounter, for example the traits of a driver. Such
    a vehicle has a crash map, each of whose lines has inner variables of its own.
    """

    def draw_inner(self, size: int, generator: np.random.Generator) -> Array:
        """Draw inner variables, shape (size, variables)."""

    def simulate_given(
        self, lead_speed: Array, range_: Array, closing_speed: Array, inner: Array
    ) -> Outcomes:
        """Simulate n cut-ins with given inner variables, shape (n, variables)."""

    def inner_weights(self, inner: Array, draws: int, generator: np.random.Generator) -> Array:
        """Return the weights of inner variables under draws of the parameters of their distribution.

        The parameters are those that are not known exactly. The result has the shape (draws, n); the mean
        over the draws is 1 for each row of ``inner``, because `draw_inner` draws with all values of the
        parameters.
        """


@runtime_checkable
class MovingVehicle(Protocol):
    """A vehicle that can be given the speeds of the lead vehicle over time.

    A `RandomVehicle` of this kind has a method ``simulate_moving_given``, with the inner variables as a fifth
    argument.
    """

    def simulate_moving(
        self, lead_speed: Array, range_: Array, closing_speed: Array, lead_speeds: Array
    ) -> Outcomes:
        """Simulate n cut-ins with lead speeds [m/s] at 0, 0.1, ..., at least 8 s, shape (n, states)."""


def simulate_inner(vehicle: Vehicle, cut_ins: tuple[Array, Array, Array], inner: Array | None) -> Outcomes:
    """Simulate lead speeds, ranges and closing speeds, with inner variables unless they are None."""
    if inner is None or not isinstance(vehicle, RandomVehicle):
        return vehicle.simulate(*cut_ins)
    return vehicle.simulate_given(*cut_ins, inner)


def repeats_itself(vehicle: Vehicle) -> bool | None:
    """Return whether an encounter always has the same outcomes; None if this is unknown."""
    return getattr(vehicle, "deterministic", None)
