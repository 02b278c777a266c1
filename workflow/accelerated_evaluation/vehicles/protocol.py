"""The protocol of a vehicle under test: its inputs and its outcomes."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array


@dataclass(frozen=True)
class Outcomes:
    """What a batch of n simulated encounters ended in; every array has shape (n,).

    Attributes
    ----------
    crash
        Whether the range reached zero.
    min_range
        Smallest range [m], the start included; not positive where it crashed.
    min_ttc
        Smallest positive time to collision seen [s]; +inf if it never closed in.
    impact_speed
        Closing speed at the crash [m/s]; 0 where there was none. It is negative only where lateral motion
        is simulated and the other car moves sideways into a slower host; see `driver.ReferenceDriver`.
    """

    crash: NDArray[np.bool_]
    min_range: Array
    min_ttc: Array
    impact_speed: Array


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
