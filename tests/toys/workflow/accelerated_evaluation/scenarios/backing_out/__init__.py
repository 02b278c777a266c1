"""A toy scenario: a parked car backs out in front of the vehicle under test."""

from dataclasses import dataclass

import numpy as np
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.protocol import FLAG, Event, Scenario, Variable, outcome
from numpy.typing import NDArray


@dataclass(frozen=True)
class BackingOutOutcomes:
    """Outcomes of n simulated encounters; every array has shape (n,)."""

    crash: NDArray[np.bool_] = outcome(FLAG, "1 if the vehicle stopped behind the parked car, else 0")
    gap_left: Array = outcome("m", "distance that was left; 0 or less after a crash")


BACKING_OUT = SCENARIOS.add("backing_out")(
    Scenario(
        name="backing_out",
        description="a parked car backs out in front of the vehicle under test",
        variables=(
            Variable("speed_mps", "m/s", 0, 20, "modelled", "speed of the vehicle under test"),
            Variable("gap_m", "m", 0, 100, "modelled", "distance to the parked car when it begins to move"),
        ),
        outcome_type=BackingOutOutcomes,
        events=(Event("crash", scored_by="gap_left"),),
        vehicles=Registry("vehicle", __name__, __path__),
        default_vehicle="braking_car",
    )
)
