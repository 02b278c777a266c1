"""The scenario pedestrian: a pedestrian crosses the lane of the vehicle under test.

The records were made by instrumented vehicles at one crossing in Michigan. They were published by the
laboratory of the paper (zhao-lab/accelerated-evaluation, MIT licence), with the model of the vehicle that
`vehicle` follows.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.protocol import FLAG, Event, Scenario, Variable, outcome


@dataclass(frozen=True)
class PedestrianOutcomes:
    """Outcomes of n simulated crossings; every array has shape (n,)."""

    crash: NDArray[np.bool_] = outcome(
        FLAG, "1 if the pedestrian came within 1 m, or 2 m in the sector of the model"
    )
    ended: NDArray[np.bool_] = outcome(FLAG, "0 if the run was stopped at its longest duration")
    min_distance: Array = outcome("m", "smallest distance of vehicle and pedestrian")
    impact_speed: Array = outcome("m/s", "speed of the vehicle at the crash; 0 without one")


def _read_records(path: Path) -> pd.DataFrame:
    from accelerated_evaluation.scenarios.pedestrian.records import read_records

    return read_records(path)


PEDESTRIAN = SCENARIOS.add("pedestrian")(
    Scenario(
        name="pedestrian",
        description="a pedestrian crosses the lane of the vehicle under test",
        variables=(
            Variable(
                "vehicle_speed_mps", "m/s", 0, 13, "modelled", "speed of the vehicle under test at the start"
            ),
            Variable(
                "pedestrian_speed_mps",
                "m/s",
                -7,
                6,
                "modelled",
                "speed of the pedestrian, constant; the sign is the direction",
            ),
            Variable(
                "distance_m",
                "m",
                5,
                60,
                "modelled",
                "distance to the pedestrian's path when the pedestrian is in the middle of the lane",
            ),
        ),
        outcome_type=PedestrianOutcomes,
        events=(Event("crash", "min_distance"),),
        vehicles=Registry("vehicle", __name__, __path__),
        default_vehicle="acc_aeb",
        read_records=_read_records,
        records=Path("data/pedestrian/records.csv.gz"),
    )
)
