"""The scenario cut-in: another vehicle changes lane in front of the vehicle under test.

The variables lead speed, range and closing speed are specific to this module, the laws of cut-ins, the
records of lane changes and the vehicles. All other parts of the library work with any scenario.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.records.named import CutInRecords
from accelerated_evaluation.records.segments import read_encounters
from accelerated_evaluation.scenarios import SCENARIOS, Scenario
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.scenarios.outcomes import FLAG, outcome
from accelerated_evaluation.scenarios.prescribed import PrescribedTest
from accelerated_evaluation.scenarios.protocol import Fault, Panel, Recorded, ReportedRule, Rules, Simulating
from accelerated_evaluation.scenarios.variables import Variable

# The speed of light. A larger number is an overflow or another quantity. The limit is not lower, because laws
# of cut-ins without a cap on the closing speed draw extremely large speeds at very long ranges, which do no
# harm. Below this limit no square of a speed overflows in the calculations of a vehicle.
SPEED_LIMIT = 299_792_458.0  # [m/s]
ROUNDED = 0.01  # [m]; a reported range may exceed the initial range by this, because of rounding
ROOM = Path(__file__).parents[1] / "vehicles"
# Collisions with a vehicle that cuts in have to be avoided from this time to collision on when it has entered
# the lane by 0.3 m, in vehicles without standing passengers. The regulation does not name the speed of the
# vehicle that cuts in, so each closing speed is tested at several.
EU_2022_1426 = tuple(
    PrescribedTest(
        f"{closing} km/h faster, TTC {ttc:.2f} s",
        "(EU) 2022/1426, Annex III, Part 1, 1.4.2",
        np.array([(lead, ttc * closing / 3.6, closing / 3.6) for lead in (5.0, 10.0, 15.0)]),
    )
    for closing, ttc in ((10, 0.48), (20, 0.71), (30, 0.94), (40, 1.18), (50, 1.41), (60, 1.64))
)


@dataclass(frozen=True)
class Outcomes:
    """Outcomes of n simulated cut-ins; every array has shape (n,).

    The range includes the initial range. The impact speed can be negative only if lateral motion is
    simulated, and the other car moves sideways into a slower host; see `driver.ReferenceDriver`.

    Examples
    --------
    >>> import numpy as np
    >>> import accelerated_evaluation as ae
    >>> class Braking:
    ...     def simulate(self, lead_speed, range_, closing_speed):
    ...         left = range_ - closing_speed - closing_speed**2 / 12
    ...         crash = left <= 0
    ...         speed = np.where(crash, closing_speed, 0.0)
    ...         return ae.Outcomes(crash, np.maximum(left, 0), np.ones(len(left)), speed)
    >>> Braking().simulate(np.full(2, 20.0), np.array([9.0, 50.0]), np.full(2, 8.0)).crash
    array([ True, False])
    """

    crash: NDArray[np.bool_] = outcome(FLAG, "1 if the range reached 0, else 0")
    min_range: Array = outcome("m", "smallest range; 0 or less after a crash")
    min_ttc: Array = outcome("s", "smallest time to collision; inf if the host never closed in")
    impact_speed: Array = outcome("m/s", "closing speed at the crash; 0 without one")


def _input_rules(columns: Mapping[str, Array]) -> list[Fault]:
    lead_speed, range_, closing_speed = columns.values()
    light = f"at most {SPEED_LIMIT:.0f} m/s, the speed of light"
    forwards = "at least minus the lead speed: the host drives forwards"
    return [
        (lead_speed > SPEED_LIMIT, "lead_speed", light),
        (np.abs(closing_speed) > SPEED_LIMIT, "closing_speed", light),
        (lead_speed < 0, "lead_speed", "a speed of 0 m/s or more"),
        (range_ <= 0, "range", "a range above 0 m"),
        (lead_speed + closing_speed < 0, "closing_speed", forwards),
    ]


def _outcome_rules(columns: Mapping[str, NDArray]) -> list[Fault]:
    range_, crash, min_range, min_ttc, impact_speed = (
        columns[name] for name in ("range", "crash", "min_range", "min_ttc", "impact_speed")
    )
    not_a_speed = ~(np.isfinite(impact_speed) & (impact_speed >= 0))
    return [
        (~np.isfinite(min_range), "min_range", "a finite number"),
        (min_range > range_, "min_range", "at most the initial range"),
        (crash & (min_range > 0), "min_range", "0 m or less where crash is true"),
        (~crash & (min_range <= 0), "min_range", "above 0 m where crash is false"),
        (~(min_ttc > 0), "min_ttc", "above 0 s, infinity if the host never closed in"),
        (not_a_speed, "impact_speed", "a finite speed of 0 m/s or more"),
        (~crash & (impact_speed != 0), "impact_speed", "0 m/s where crash is false"),
    ]


def _reported_rules(crash: bool, encounter: Mapping[str, float]) -> dict[str, ReportedRule]:
    kind, longest = "with a crash" if crash else "without a crash", encounter["range"]
    above = (lambda x: 0 < x <= longest + ROUNDED, f"above 0 {kind}, and at most {longest:g}")
    return {
        "min_range": (lambda x: -math.inf < x <= 0, f"0 or less {kind}") if crash else above,
        "min_ttc": (lambda x: x >= 0, "0 or more"),
        "impact_speed": (lambda x: 0 <= x < math.inf, f"0 or more {kind}")
        if crash
        else (lambda x: x == 0, f"0 {kind}"),
    }


CUT_IN = SCENARIOS.add("cut_in")(
    Scenario(
        name="cut_in",
        description="another vehicle changes lane in front of the vehicle under test",
        variables=(
            Variable(
                "lead_speed",
                "m/s",
                0,
                np.inf,
                "speed of the lead vehicle, constant, 0 or more",
            ),
            Variable("range", "m", 0, np.inf, "distance to it at the start, above 0"),
            Variable(
                "closing_speed",
                "m/s",
                -np.inf,
                np.inf,
                "host speed minus lead speed at the start",
            ),
        ),
        outcome_type=Outcomes,
        events=(
            Event.flag("crash", scored_by="min_ttc"),
            Event.above("impact_speed", 5.0, scored_by="min_ttc", words="impact above {threshold:g} {unit}"),
            Event.at_most("min_range", 1.0, words="range at most {threshold:g} {unit}"),
            Event.at_most("min_ttc", 1.0, words="TTC at most {threshold:g} {unit}"),
        ),
        vehicles=Registry("vehicle", "accelerated_evaluation.vehicles", [str(ROOM)], contract=[Simulating]),
        default_vehicle="acc_aeb",
        records=Recorded(read=read_encounters, named=CutInRecords.of),
        rules=Rules(_input_rules, _outcome_rules, _reported_rules),
        noun="cut-in",
        scope="closing cut-ins whose lead keeps its speed",
        upper_set_in="closing_speed",
        scanned="closing_speed",
        # The careful human of UN R157, and the human driver from data.
        references={"": "cc_human", "human_": "human"},
        host_speed=("lead_speed", "closing_speed"),
        derived={"host_speed": lambda cut_in: cut_in["lead_speed"] + cut_in["closing_speed"]},
        panels=(
            Panel("speed [m/s]", {"host_speed_m_per_s": "host", "lead_speed_m_per_s": "lead vehicle"}),
            Panel("acceleration [m/s²]", {"host_acceleration_m_per_s2": "host"}),
            Panel("range [m]", {"range_m": "range"}, zero=True),
            Panel("time to collision [s]", {"time_to_collision_s": "TTC"}, limits=(0, 10)),
        ),
    )
)
