"""The scenario left turn: a car turns left across the path of the oncoming vehicle under test.

The records were made by instrumented cars in Michigan. They were published by the laboratory of the paper
(zhao-lab/accelerated-evaluation, MIT licence), with the model of the vehicle that `vehicle` follows.
Some left turns are in the file twice, with different times, and are counted once.
"""

from pathlib import Path

from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.crossing import PANELS, RULES, CrossingOutcomes
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.scenarios.protocol import Recorded, Scenario, Simulating
from accelerated_evaluation.scenarios.variables import Variable

FASTEST = 30.0  # [m/s]; faster recorded turns are certainly wrong (data/left_turn/README.md)
SLOWEST = 0.2  # [m/s]; for a slower turning car the host waits, and rounding decides the outcome


VEHICLES: Registry[type] = Registry("vehicle", __name__, __path__, contract=[Simulating])
LEFT_TURN = SCENARIOS.add("left_turn")(
    Scenario(
        name="left_turn",
        description="a car turns left across the path of the oncoming vehicle under test",
        variables=(
            Variable("sdv_speed_mps", "m/s", 0, 35, "speed of the vehicle under test at the start"),
            Variable(
                "turning_speed_mps",
                "m/s",
                0,
                60,
                "speed of the turning car, constant",
                step=0.01,
            ),
            Variable(
                "distance_to_conflict_m",
                "m",
                0,
                150,
                "distance of the vehicle under test to the conflict point when the car begins to turn",
            ),
        ),
        outcome_type=CrossingOutcomes,
        events=(
            Event.flag("crash", scored_by="clearance"),
            Event.above("impact_speed", 5.0, scored_by="clearance"),
            Event.at_most("post_encroachment_time", 1.0),
        ),
        vehicles=VEHICLES,
        default_vehicle="acc_aeb",
        rules=RULES,
        panels=PANELS,
        records=Recorded(
            file=Path("data/left_turn/records.parquet"), verdicts=Path("data/left_turn/verdicts.csv.gz")
        ),
        scanned="distance_to_conflict_m",
        host_speed=("sdv_speed_mps",),
        divided_by=("turning_speed_mps", (0.2, 1.0, 5.0)),
        restrictions={
            "turning speed 0.2 m/s or more": lambda x: x[:, 1] >= SLOWEST,
            "turning speed 30 m/s or less": lambda x: x[:, 1] <= FASTEST,
        },
    )
)
