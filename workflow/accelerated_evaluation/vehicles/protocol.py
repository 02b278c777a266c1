"""The protocol of a vehicle under test: its inputs and its outcomes."""

from typing import Protocol, runtime_checkable

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.scenarios.cut_in import Outcomes

__all__ = ["Outcomes", "Vehicle", "repeats_itself"]


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


def repeats_itself(vehicle: Vehicle) -> bool | None:
    """Return whether an encounter always has the same outcomes; None if this is unknown."""
    return getattr(vehicle, "deterministic", None)
