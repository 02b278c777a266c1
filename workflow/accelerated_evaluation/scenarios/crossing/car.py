"""The car under test in the left turn and the pedestrian crossing: parameters of ACC and AEB, simulation."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.scenarios.crossing import CrossingOutcomes
from accelerated_evaluation.scenarios.crossing.kernel import (
    TICK,
    TRACED,
    CarParameters,
    simulate_crossings,
    trace_run,
)
from accelerated_evaluation.scenarios.parameters import AccAebParameters, simulate_in_slices
from accelerated_evaluation.scenarios.protocol import Scenario

KMH = 0.2777777777778  # [m/s], rounded as in the authors' model
# Time to collision at which the AEB brakes: a linear function of the speed below 40 km/h, and then constant.
THRESHOLD_SPEED, THRESHOLD_BASE, THRESHOLD_SLOPE = 4.16667, 0.49, 0.03456  # [m/s], [s], [s^2/m]
TOP_SPEED, TOP_THRESHOLD = 40 * KMH, 0.955  # [m/s], [s]
STANDING_THRESHOLD = round(THRESHOLD_BASE - THRESHOLD_SLOPE * THRESHOLD_SPEED, 3)  # [s], at the speed 0
TRACE = ("time_s", "ahead_m", "aside_m", "host_speed_m_per_s", "host_acceleration_m_per_s2", "emergency")


@dataclass(frozen=True)
class CrossingCar(AccAebParameters):
    """A car with ACC, and with AEB unless ``aeb`` is false; the defaults are the authors' published car.

    The car has a proportional-integral ACC on the time headway, an AEB triggered by the time to collision
    (TTC), and an actuator limited in friction and jerk. All of them act at the ticks of a clock of 0.1 s. The
    structure is that of the car in the cut-in, but the numbers differ. Subclasses define the start of an
    encounter. The other defaults are those of the authors' car. If ``aeb_ttc`` is None, the AEB has the
    published threshold, which is 0.955 s at 40 km/h and above. InputError is raised if a parameter is not a
    finite number in its range.
    """

    scenario: ClassVar[Scenario]
    contact: ClassVar[float]  # [m], distance of the centres at contact
    published_ttc: ClassVar[tuple[float, float]] = STANDING_THRESHOLD, TOP_THRESHOLD
    published_line: ClassVar[tuple[float, float, float]] = THRESHOLD_BASE, THRESHOLD_SPEED, THRESHOLD_SLOPE
    side_contact: ClassVar[float] = 0.0  # [m], distance at contact in a sector to the side; 0 without one
    aeb_deceleration: float = 5.8
    aeb_jerk: float = 12.0
    headway: float = 1.0
    acc_limit: float = 3.5
    friction_limit: float = 0.8 * 9.8
    longest_run: float = 200_000.0  # time after which a run that has not ended is stopped [s]

    def start(self, encounters: Array) -> Array:
        """Return the initial state of each encounter, shape (7, n), with the rows that `kernel` lists."""
        raise NotImplementedError

    def simulate(self, *columns: ArrayLike) -> CrossingOutcomes:
        """Simulate n encounters of the car with a crossing target, and return their outcomes.

        They do not depend on the batch or on the number of threads, not even in the last bit. InputError
        names the first row, counted from 0, whose value is outside its limits.
        """
        starts = self.start(self.scenario.checked(*columns))
        return simulate_in_slices(self.scenario, simulate_crossings, starts, self.compiled())

    def trace(self, *encounter: float) -> pd.DataFrame:
        """Simulate one encounter, and return its states (`TRACE`), one for each tick and the end.

        ``ahead_m`` and ``aside_m`` are the position of the target relative to the host, along the path of the
        host and across it. The acceleration is constant until the next row. ``emergency`` is 1 while the AEB
        is on.
        """
        start = self.start(self.scenario.checked(*([value] for value in encounter)))
        run_time = self.simulate(*([value] for value in encounter)).run_time[0]
        states = np.empty((math.ceil(run_time / TICK - 1e-9) + 1, TRACED))
        trace_run(start[:, 0].copy(), self.compiled(), states)
        return pd.DataFrame(states, columns=TRACE).astype({"emergency": int})

    def compiled(self) -> CarParameters:
        """Return the parameters of the vehicle as numbers for the compiled simulation."""
        return self.numbers(
            CarParameters,
            TICK,
            TICK,
            threshold_top_speed=TOP_SPEED,
            side_slope=math.tan(math.pi / 8),
            most_ticks=math.ceil(self.longest_run / TICK),
        )
