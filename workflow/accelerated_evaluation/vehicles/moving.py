"""Cut-ins in which the lead vehicle changes its speed: checks and functions for all vehicles."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws.motion import STATES, STEP
from accelerated_evaluation.scenarios.cut_in import CUT_IN, SPEED_LIMIT
from accelerated_evaluation.scenarios.parameters import simulate_in_slices
from accelerated_evaluation.vehicles.protocol import MovingVehicle, Outcomes, RandomVehicle, Vehicle

if TYPE_CHECKING:
    import pandas as pd

START = "the lead speed of the encounter"
TOLERANCE = 1e-9  # [m/s], largest difference of the lead speed and the first of the lead speeds over time


class CompiledVehicle:
    """Base class of deterministic vehicles that are simulated by compiled code, with changing lead speeds."""

    # Compiled function ``(encounters, begin, end, numbers, lead_speeds, outcomes)``. It takes encounters of
    # shape (3, n), the result of `compiled`, and lead speeds over time of shape (n, states), or of shape (n,
    # 1) for lead vehicles that keep their speeds. It writes the outcomes of the encounters from ``begin`` to
    # ``end``, shape (4, n).
    kernel: ClassVar[Callable[..., None]]
    tracer: ClassVar[Callable[..., "pd.DataFrame"]]  # ``(numbers, encounter, lead_speeds)`` returns a trace

    def compiled(self) -> Any:  # noqa: ANN401
        """Return the parameters of the vehicle as numbers for the compiled simulation."""
        raise NotImplementedError

    def simulate(self, lead_speed: ArrayLike, range_: ArrayLike, closing_speed: ArrayLike) -> Outcomes:
        """Simulate n cut-ins behind a lead vehicle that keeps its speed.

        The closing speed [m/s] may be 0 or negative (the gap opens), but the host speed, its sum with the
        lead speed, must not be negative. The outcomes do not depend on the batch or on the number of threads,
        not even in the last bit. InputError names the first row, counted from 0, whose value is outside its
        limits.
        """
        return self.outcomes(CUT_IN.checked(lead_speed, range_, closing_speed))

    def outcomes(
        self, encounters: Array, lead_speeds: Array | None = None, threads: int | None = None
    ) -> Outcomes:
        """Return the outcomes of checked encounters, shape (3, n), on at most ``threads`` threads."""
        speeds = kept_speeds(encounters) if lead_speeds is None else lead_speeds
        return simulate_in_slices(CUT_IN, self.kernel, encounters, self.compiled(), speeds, threads=threads)

    def simulate_moving(
        self, lead_speed: ArrayLike, range_: ArrayLike, closing_speed: ArrayLike, lead_speeds: ArrayLike
    ) -> Outcomes:
        """Simulate n cut-ins with lead speeds [m/s] at 0, 0.1, ... s, shape (n, at least 81).

        The first column is ``lead_speed``. InputError is raised if the encounters are not valid, or if lead
        speeds are negative, not finite, or end before 8 s.
        """
        encounters = CUT_IN.checked(lead_speed, range_, closing_speed)
        return self.outcomes(encounters, checked_lead_speeds(lead_speeds, encounters[0]))

    def trace(
        self, lead_speed: float, range_: float, closing_speed: float, lead_speeds: ArrayLike | None = None
    ) -> "pd.DataFrame":
        """Simulate one encounter, and return its states, one row for each step of 0.1 s.

        If the lead vehicle changes its speed, ``lead_speeds`` [m/s] are those every 0.1 s.
        """
        encounter = CUT_IN.checked([lead_speed], [range_], [closing_speed])
        return self.tracer(self.compiled(), encounter, checked_motion(lead_speeds, encounter))


def kept_speeds(encounters: Array) -> Array:
    """Return lead speeds [m/s] that do not change, as a motion with a single state, shape (n, 1)."""
    return encounters[0].reshape(-1, 1)


def takes_motion(vehicle: Vehicle) -> bool:
    """Return whether a vehicle can be simulated with given lead speeds over time."""
    return getattr(vehicle, "takes_motion", isinstance(vehicle, MovingVehicle))


def require_motion(vehicle: Vehicle, name: str) -> None:
    """Raise InputError if a vehicle cannot be simulated with given lead speeds over time.

    ``name`` is the name of the vehicle, for the error.
    """
    if not takes_motion(vehicle):
        raise motion_error(name)


def motion_error(name: str) -> InputError:
    """Return the error for a vehicle that cannot be simulated with given lead speeds over time."""
    return InputError(
        f"vehicle {name}, lead speeds over time",
        seen="a vehicle for lead vehicles that keep their speed",
        expected="a method simulate_moving of a class, or a command with the parameter lead_motion: true",
        change="Leave the lead motion out, or extend the vehicle as in docs/vehicle_reference.md.",
    )


def simulate_motion(
    vehicle: MovingVehicle, cut_ins: tuple[Array, Array, Array], lead_speeds: Array, inner: Array | None
) -> Outcomes:
    """Return the outcomes of n cut-ins with given lead speeds, and inner variables if there are any.

    With ``inner`` None, a `RandomVehicle` draws them itself.
    """
    if inner is None or not isinstance(vehicle, RandomVehicle):
        return vehicle.simulate_moving(*cut_ins, lead_speeds)
    return vehicle.simulate_moving_given(*cut_ins, lead_speeds, inner)


def checked_lead_speeds(lead_speeds: ArrayLike, lead_speed: Array) -> Array:
    """Check lead speeds [m/s] at 0, 0.1, ... s, shape (n, at least 81), and return them as floats.

    InputError is raised if the shape is wrong, if a speed is negative or not finite, or if the first column
    differs from the lead speeds of the encounters. The message names the first such encounter, counted from
    0.
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
        (speeds > SPEED_LIMIT, "a speed below that of light"),
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
    """Return the checked lead speeds over time [m/s] of one encounter, shape (states,).

    ``encounter`` contains lead speed [m/s], range [m] and closing speed [m/s], shape (3, 1). The result
    is None if ``lead_speeds`` is None, that is, if the lead vehicle keeps its speed.
    """
    return None if lead_speeds is None else checked_lead_speeds([lead_speeds], encounter[0])[0]


def speeds_in(columns: Mapping[str, Sequence[float]], rows: Sequence[object], where: str) -> Array:
    """Return the lead speeds [m/s] of n encounters of a table at 0, 0.1, ..., 8 s, shape (n, 81).

    A column such as ``speed_0.1`` contains the lead speed [m/s] 0.1 s after the start. The columns reach 8 s
    or more, and speeds in between are interpolated. InputError is raised if a speed is negative, not finite
    or impossible, or if the columns do not cover 8 s.
    """
    import pandas as pd  # imported here, because this and the next import take long

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
    return recorded_courses(table, where, [f"row {row}" for row in rows])
