"""Encounters in which the lead vehicle changes its speed: what the built-in vehicles share."""

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws.motion import STATES, STEP
from accelerated_evaluation.vehicles.protocol import Outcomes

START = "the lead speed of the encounter"
TOLERANCE = 1e-9  # [m/s], between the lead speed and the first of the lead speeds over time


@runtime_checkable
class MovingVehicle(Protocol):
    """A vehicle that can be given the speeds of the lead vehicle over time."""

    def simulate_moving(
        self, lead_speed: ArrayLike, range_: ArrayLike, closing_speed: ArrayLike, lead_speeds: ArrayLike
    ) -> Outcomes:
        """Simulate n cut-ins with lead speeds at 0, 0.1, ... s, shape (n, at least STATES)."""


def checked_lead_speeds(lead_speeds: ArrayLike, lead_speed: Array) -> Array:
    """Return lead speeds over time after checking them.

    Parameters
    ----------
    lead_speeds
        Lead speeds [m/s] at 0, 0.1, ... s, shape (n, at least STATES).
    lead_speed
        Lead speeds of the encounters [m/s], shape (n,).

    Raises
    ------
    InputError
        If the shape is another one, a speed is not finite or negative, or the first speeds are not those of
        the encounters. The message names the first such encounter, counted from 0.
    """
    speeds = np.ascontiguousarray(lead_speeds, dtype=np.float64)
    if speeds.ndim != 2 or len(speeds) != len(lead_speed) or speeds.shape[1] < STATES:
        raise InputError(
            "lead speeds over time",
            seen=f"an array of shape {speeds.shape}",
            expected=f"{len(lead_speed)} rows of {STATES} speeds or more ({(STATES - 1) * STEP:g} s)",
            change="Pass a row of lead speeds, 0.1 s apart, for each encounter.",
        )
    for wrong, expected in (
        (~np.isfinite(speeds), "a finite speed"),
        (speeds < 0, "a speed of 0 m/s or more"),
        (np.abs(speeds - lead_speed[:, None]) * (np.arange(speeds.shape[1]) == 0) > TOLERANCE, START),
    ):
        if wrong.any():
            row, state = (int(index) for index in np.argwhere(wrong)[0])
            raise InputError(
                f"lead speeds over time, encounter {row}, at {state * STEP:g} s",
                seen=repr(speeds[row, state].item()),
                expected=expected,
                change="Correct the lead motion of this encounter.",
            )
    return speeds
