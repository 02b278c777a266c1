"""Closing speeds from which on vehicles crash, next to those that the law makes probable."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.mean import MeanLaw
from accelerated_evaluation.vehicles.protocol import RandomVehicle, Vehicle

QUANTILES = (0.1, 0.5, 0.9)  # levels of the recorded lead speeds that are shown
RANGES = np.linspace(1, 75, 149)  # [m]
CLOSING_SPEEDS = np.linspace(0.1, 40, 400)  # [m/s]
DRAWN = 15  # number of draws of a random vehicle; odd, so that there is always a majority
FORESEEN = (1e-3, 1e-5)  # shares of the cut-ins with a given range that have a larger closing speed


def preventable(vehicles: Mapping[str, Vehicle], law: MeanLaw, lead_speeds: Array) -> pd.DataFrame:
    """Compute the closing speeds at which vehicles crash, and quantiles of the law, by range.

    For a vehicle, ``first`` is the smallest closing speed [m/s] at which it crashes, and ``always`` the
    smallest one from which on it always crashes; both are NaN if there is none. They differ if the crash set
    has holes. For the law, both are the closing speed that the share ``name`` of the cut-ins with this range
    exceeds.
    """
    parts = []
    for lead_speed in np.round(np.quantile(lead_speeds, QUANTILES)).tolist():
        for name, vehicle in vehicles.items():
            first, always = _boundaries(vehicle, lead_speed)
            parts.append(_part(lead_speed, name, "vehicle", first, always))
        places = Places.of(np.full(RANGES.size, lead_speed), RANGES, law.support)
        for share in FORESEEN:
            speed = law.typical.given(places).inverse(np.full(RANGES.size, -np.log(share)))
            parts.append(_part(lead_speed, f"{share:g}", "law", speed, speed))
    return pd.concat(parts, ignore_index=True)


def _boundaries(vehicle: Vehicle, lead_speed: float) -> tuple[Array, Array]:
    """Return the smallest closing speeds [m/s] with a crash, and those from which on there is always one."""
    range_, closing_speed = np.meshgrid(RANGES, CLOSING_SPEEDS, indexing="ij")
    speeds = np.full(range_.size, lead_speed)
    crash = _crashes(vehicle, speeds, range_.ravel(), closing_speed.ravel()).reshape(range_.shape)
    first = np.where(crash.any(axis=1), CLOSING_SPEEDS[np.argmax(crash, axis=1)], np.nan)
    safe_above = np.cumsum(~crash[:, ::-1], axis=1)[:, ::-1] > 0  # safe at this or a larger closing speed
    count = safe_above.sum(axis=1)
    always = np.append(CLOSING_SPEEDS, np.nan)[count]
    return first, always


def _crashes(vehicle: Vehicle, *cut_ins: Array) -> NDArray[np.bool_]:
    """Return whether cut-ins end in a crash; for a random vehicle, whether most of its draws crash."""
    if not isinstance(vehicle, RandomVehicle):
        return vehicle.simulate(*cut_ins).crash
    drawn = vehicle.draw_inner(DRAWN, child_generator(0, "preventable"))
    each = (np.tile(inner, (cut_ins[0].size, 1)) for inner in drawn)
    return np.mean([vehicle.simulate_given(*cut_ins, inner).crash for inner in each], axis=0) > 0.5


def _part(lead_speed: float, name: str, kind: str, first: Array, always: Array) -> pd.DataFrame:
    columns = {"lead_speed": lead_speed, "name": name, "kind": kind}
    return pd.DataFrame({**columns, "range": RANGES, "first": first, "always": always})
