"""The parameters of a reference driver that are passed from its class to the compiled code."""

from typing import NamedTuple

import numpy as np

# Rule that detects danger: 0 for the time to collision (CC and Reg157), then RSS, then FSM.
TTC_RULE, RSS_RULE, FSM_RULE = range(3)


class Driver(NamedTuple):
    """The parameters of a reference driver for the compiled code, in SI units.

    A driver uses the parameters of its own rule, and the others keep their defaults. The classes of the
    drivers explain the parameters and state their sources.
    """

    rule: int
    reaction_steps: float
    deceleration: float
    ramp_step: float  # increase of the deceleration in one step [m/s^2]; infinite without a limit
    lateral_speed: float
    start_offset: float
    entry_offset: float
    length: float
    width: float
    coasting: float = 0.0  # deceleration during the reaction
    forgets_ramp: bool = False  # whether the deceleration starts from 0 again after a release
    dropped_ttc: float = np.inf  # an encounter ends without a crash if the cars overlap at a larger TTC
    lateral_gap: float = 0.0
    critical_ttc: float = 0.0
    ttc_slope: float = 0.0  # increase of the critical TTC with the closing speed [s^2/m]
    response_time: float = 0.0
    response_acceleration: float = 0.0
    lateral_acceleration: float = 0.0
    lateral_path: float = 0.0  # braking paths for a speed of 1 m/s, 1 / (2 deceleration) [s^2/m]
    host_path: float = 0.0
    comfort_path: float = 0.0
    lead_path: float = 0.0
    comfort: float = 0.0
    comfort_to_full: float = 0.0
    margin: float = 0.0
    safe_margin: float = 0.0
