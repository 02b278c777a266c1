"""The scenario pedestrian: a pedestrian crosses the lane of the vehicle under test.

The records were made by instrumented vehicles at one crossing in Michigan, when each was nearest to a
pedestrian. They were published by the laboratory of the paper (zhao-lab/accelerated-evaluation, MIT licence),
with the model of the vehicle that `vehicle` follows.
"""

from pathlib import Path

import numpy as np

from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.crossing import PANELS, RULES, CrossingOutcomes
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.scenarios.protocol import Recorded, Scenario, Simulating
from accelerated_evaluation.scenarios.variables import Variable

SLOWEST = 0.3  # [m/s]; almost all crashes with slower pedestrians are artefacts of the simulation
# The car creeps behind slow pedestrians, and its unstable control decides whether it touches them. Crashes
# are then a few percent of the encounters in any neighbourhood. All of them have a smaller impact than 1 m/s.
CREEPING = 1.0  # [m/s]
FILLED = 0.02  # share of crashes in such neighbourhoods


VEHICLES: Registry[type] = Registry("vehicle", __name__, __path__, contract=[Simulating])
PEDESTRIAN = SCENARIOS.add("pedestrian")(
    Scenario(
        name="pedestrian",
        description="a pedestrian crosses the lane of the vehicle under test",
        variables=(
            Variable("vehicle_speed_mps", "m/s", 0, 13, "speed of the vehicle under test at the start"),
            Variable(
                "pedestrian_speed_mps",
                "m/s",
                -7,
                7,
                "speed of the pedestrian, constant; the sign is the direction",
                sign_matters=False,
                step=0.01,
            ),
            Variable(
                "distance_m",
                "m",
                5,
                60,
                "distance to the pedestrian's path when the pedestrian is in the middle of the lane",
            ),
        ),
        outcome_type=CrossingOutcomes,
        events=(
            Event.flag("crash", scored_by="clearance", filled=FILLED),
            Event.above("impact_speed", CREEPING, scored_by="clearance"),
            Event.at_most("post_encroachment_time", 1.0),
        ),
        vehicles=VEHICLES,
        default_vehicle="acc_aeb",
        rules=RULES,
        panels=PANELS,
        records=Recorded(
            file=Path("data/pedestrian/records.parquet"),
            verdicts=Path("data/pedestrian/verdicts.csv.gz"),
            cluster="device",
        ),
        host_speed=("vehicle_speed_mps",),
        divided_by=("pedestrian_speed_mps", (0.13, 0.2, 0.3)),
        restrictions={"pedestrian speed 0.3 m/s or more": lambda x: np.abs(x[:, 1]) >= SLOWEST},
    )
)
