"""Encounters in which the lead vehicle changes its speed: what all vehicles share."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws.motion import STATES, STEP
from accelerated_evaluation.vehicles.checks import checked_encounters
from accelerated_evaluation.vehicles.protocol import MovingVehicle, Outcomes, RandomVehicle, Vehicle

START = "the lead speed of the encounter"
TOLERANCE = 1e-9  # [m/s], between the lead speed and the first of the lead speeds over time


class CompiledVehicle:
    """A vehicle that repeats itself, and that compiled code simulates behind lead vehicles that change speed.

    Attributes
    ----------
    moving_kernel
        Compiled code that fills outcomes of shape (4, n) from encounters of shape (3, n), lead speeds over
        time of shape (n, states), and the numbers of the vehicle.
    """

    moving_kernel: ClassVar[Callable[[Array, Array, Any, Array], None]]

    def compiled(self) -> Any:  # noqa: ANN401
        """Return the numbers that the compiled code needs."""
        raise NotImplementedError

    def simulate_moving(
        self, lead_speed: ArrayLike, range_: ArrayLike, closing_speed: ArrayLike, lead_speeds: ArrayLike
    ) -> Outcomes:
        """Simulate n cut-ins behind lead vehicles that change their speeds.

        Parameters
        ----------
        lead_speed, range_, closing_speed
            As in `simulate`.
        lead_speeds
            Lead speeds [m/s] at 0, 0.1, ... s, shape (n, at least 81). The first ones are ``lead_speed``.

        Raises
        ------
        InputError
            As in `simulate`, and if lead speeds are not finite, negative, or too short in time.
        """
        encounters = checked_encounters(lead_speed, range_, closing_speed)
        outcomes = np.empty((4, encounters.shape[1]))
        speeds = checked_lead_speeds(lead_speeds, encounters[0])
        self.moving_kernel(encounters, speeds, self.compiled(), outcomes)
        return Outcomes(outcomes[0] > 0, *outcomes[1:])


def takes_motion(vehicle: Vehicle) -> bool:
    """Return whether a vehicle can be given lead speeds over time."""
    return getattr(vehicle, "takes_motion", isinstance(vehicle, MovingVehicle))


def require_motion(vehicle: Vehicle, name: str) -> None:
    """Raise InputError if a vehicle cannot be given lead speeds over time."""
    if not takes_motion(vehicle):
        raise motion_error(name)


def motion_error(name: str) -> InputError:
    """Return the error for a vehicle that cannot be given lead speeds over time."""
    return InputError(
        f"vehicle {name}, lead speeds over time",
        seen="a vehicle for lead vehicles that keep their speed",
        expected="a method simulate_moving of a class, or a command with the parameter lead_motion: true",
        change="Leave the lead motion out, or extend the vehicle as in docs/your_vehicle.md.",
    )


def simulate_motion(
    vehicle: MovingVehicle, cut_ins: tuple[Array, Array, Array], lead_speeds: Array, inner: Array | None
) -> Outcomes:
    """Simulate n cut-ins with lead speeds over time, and with inner variables unless they are None."""
    if inner is None or not isinstance(vehicle, RandomVehicle):
        return vehicle.simulate_moving(*cut_ins, lead_speeds)
    return vehicle.simulate_moving_given(*cut_ins, lead_speeds, inner)


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
    starts_elsewhere = np.zeros(speeds.shape, dtype=bool)
    starts_elsewhere[:, 0] = np.abs(speeds[:, 0] - lead_speed) > TOLERANCE
    for wrong, expected in (
        (~np.isfinite(speeds), "a finite speed"),
        (speeds < 0, "a speed of 0 m/s or more"),
        (starts_elsewhere, START),
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


def checked_motion(lead_speeds: ArrayLike | None, encounter: Array) -> Array | None:
    """Return the lead speeds of one encounter, shape (3, 1), after checking them; None stays None."""
    return None if lead_speeds is None else checked_lead_speeds([lead_speeds], encounter[0])[0]


def speeds_in(columns: Mapping[str, Sequence[float]], rows: Sequence[object], where: str) -> Array:
    """Return the lead speeds in a table of encounters, every 0.1 s, shape (n, STATES).

    Parameters
    ----------
    columns
        ``lead_speed`` [m/s], and columns such as ``speed_0.1``: the lead speed [m/s] so many seconds after
        the start, up to 8 s or more. Speeds in between are interpolated.
    rows, where
        Names of the n rows and of the table, for the error.

    Raises
    ------
    InputError
        If a speed is not finite or negative, or the columns do not reach 8 s.
    """
    import pandas as pd  # slow to import, as the next one

    from accelerated_evaluation.laws.motion.recorded import recorded_courses

    table = pd.DataFrame(columns)
    values = table.to_numpy(dtype=float)
    wrong = ~(np.isfinite(values) & (values >= 0))
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        raise InputError(
            f"{where}, row {rows[row]}, column {table.columns[column]}",
            seen=repr(values[row, column].item()),
            expected="a finite speed of 0 m/s or more",
            change="Correct the lead motion of this encounter.",
        )
    return recorded_courses(table, where)
