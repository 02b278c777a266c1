"""Car and outcomes for the scenarios in which a target crosses the path of the vehicle under test (the host).

The scenarios are the left turn, whose target is a turning car, and the pedestrian crossing. The authors of
the paper published both with the model of the car (https://github.com/zhao-lab/accelerated-evaluation, folder
joint-dist, MIT licence). The module `car` defines the parameters of the car, and `kernel` the simulation.
Each scenario defines the initial positions of host and target, and the distance at which they touch.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.scenarios.outcomes import FLAG, outcome
from accelerated_evaluation.scenarios.protocol import Fault, Panel, ReportedRule, Rules

PANELS = (
    Panel("speed [m/s]", {"host_speed_m_per_s": "host"}),
    Panel("acceleration [m/s²]", {"host_acceleration_m_per_s2": "host"}),
    Panel("position of the target [m]", {"ahead_m": "ahead", "aside_m": "aside"}, zero=True),
)


@dataclass(frozen=True)
class CrossingOutcomes:
    """Outcomes of n simulated encounters with a target that crosses; every array has shape (n,).

    A run continues after a crash as if host and target could pass through each other, so that
    ``min_distance`` and ``clearance`` measure the depth of the crash. For a run that neither crashed nor
    ended, it is unknown whether it would have crashed.
    """

    crash: NDArray[np.bool_] = outcome(FLAG, "1 if host and target touched, else 0")
    ended: NDArray[np.bool_] = outcome(FLAG, "0 if the run was stopped at its longest duration, else 1")
    min_distance: Array = outcome("m", "smallest distance of the centres")
    clearance: Array = outcome("m", "smallest distance minus the distance at contact; below 0 after a crash")
    impact_speed: Array = outcome("m/s", "relative speed at the first contact; 0 without a crash")
    run_time: Array = outcome("s", "time until the run ended, or was stopped")
    post_encroachment_time: Array = outcome(
        "s",
        "time between host and target at the point where their paths cross, from centre to centre, if both "
        "keep the speeds of the end of the run; 0 after a crash, inf if one of them never reaches the point",
        optional=True,
    )


def _outcome_rules(columns: Mapping[str, NDArray]) -> list[Fault]:
    """Return the faults of simulated outcomes, from the columns of encounters and outcomes by name."""
    names = ("crash", "min_distance", "clearance", "impact_speed", "run_time")
    crash, min_distance, clearance, impact_speed, run_time = (columns[name] for name in names)
    not_a_speed = ~(np.isfinite(impact_speed) & (impact_speed >= 0))
    return [
        (~(min_distance >= 0), "min_distance", "0 m or more"),
        (crash & ~(clearance <= 0), "clearance", "0 m or less where crash is true"),
        (~crash & ~(clearance >= 0), "clearance", "0 m or more where crash is false"),
        (not_a_speed, "impact_speed", "a finite speed of 0 m/s or more"),
        (~crash & (impact_speed != 0), "impact_speed", "0 m/s where crash is false"),
        (~(run_time >= 0), "run_time", "0 s or more"),
        (columns["post_encroachment_time"] < 0, "post_encroachment_time", "0 s or more"),
    ]


def _reported_rules(crash: bool, encounter: Mapping[str, float]) -> dict[str, ReportedRule]:
    """Return the rules with which reported outcomes of a run on a proving ground are checked.

    For each outcome, there is a function that returns whether a number is possible, and a text that says
    which numbers are expected. They do not depend on the variables of the run.
    """
    kind = "with a crash" if crash else "without a crash"
    touched = (lambda x: -math.inf < x <= 0, f"0 or less {kind}")
    apart = (lambda x: x >= 0, f"0 or more {kind}")
    still = (lambda x: x == 0, f"0 {kind}")
    return {
        "min_distance": (lambda x: x >= 0, "0 or more"),
        "clearance": touched if crash else apart,
        "impact_speed": apart if crash else still,
        "run_time": (lambda x: x >= 0, "0 or more"),
        "post_encroachment_time": (lambda x: x >= 0, "0 or more"),
    }


RULES = Rules(outcomes=_outcome_rules, reported=_reported_rules)
