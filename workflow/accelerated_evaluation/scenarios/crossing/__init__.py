"""What the scenarios share in which something crosses the path of the vehicle under test: car and outcomes.

The authors of the paper published both scenarios with the model of the car
(https://github.com/zhao-lab/accelerated-evaluation, folder joint-dist, MIT licence). `car` has the parameters
of the car, `kernel` the simulation. A scenario adds where host and target start, and when they touch.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.scenarios.protocol import FLAG, outcome


@dataclass(frozen=True)
class CrossingOutcomes:
    """Outcomes of n simulated encounters with a target that crosses; every array has shape (n,).

    A run continues after a crash as if the two could pass through each other, so that ``min_distance`` and
    ``clearance`` say how deep the crash was. A run that neither crashed nor ended has no verdict.
    """

    crash: NDArray[np.bool_] = outcome(FLAG, "1 if host and target touched, else 0")
    ended: NDArray[np.bool_] = outcome(FLAG, "0 if the run was stopped at its longest duration, else 1")
    min_distance: Array = outcome("m", "smallest distance of the centres")
    clearance: Array = outcome("m", "smallest distance minus the distance at contact; below 0 after a crash")
    impact_speed: Array = outcome("m/s", "relative speed at the first contact; 0 without a crash")
    run_time: Array = outcome("s", "time until the run ended, or was stopped")
