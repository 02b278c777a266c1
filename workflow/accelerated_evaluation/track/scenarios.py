"""Write cut-ins as files of OpenSCENARIO XML 1.2, on one straight road of OpenDRIVE.

An encounter of the study begins at the moment of the cut-in, with a given range between the bumpers. The
scenario file begins `RUN_UP` seconds earlier, with the other car in the lane on the right. The other car
changes lane such that its middle crosses the marking at the moment of the cut-in. Its speed in the direction
of the road, which is the lead speed of the encounter, is constant throughout, or changes from that moment on.
The speed in the file is the speed along the path, which is higher during the lane change; a speed profile
states it. The host has an initial speed and no action.
If it keeps this speed until the cut-in, range and closing speed are those of the encounter. From that moment
at the latest, the vehicle under test drives by itself. The scenario ends with a collision, or `DURATION`
seconds after the cut-in.
"""

import datetime
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import StudyError
from accelerated_evaluation.base.files import atomic_path
from accelerated_evaluation.laws.motion import STEP
from accelerated_evaluation.scenarios import OfScenarios

if TYPE_CHECKING:  # an optional extra
    from scenariogeneration import xosc

ROAD = "straight_road.xodr"
ROAD_LENGTH, LANE_WIDTH, START = 6000.0, 3.5, 100.0  # [m]; START is the initial position of the host
LENGTH, WIDTH, HEIGHT = 4.3, 1.9, 1.5  # [m], dimensions of both cars, those of the reference drivers
RUN_UP = 5.0  # [s] before the moment of the cut-in
LANE_CHANGE = 4.0  # [s]; the middle of the car crosses the marking at half of it
LANE_CHANGE_BEGINS = RUN_UP - LANE_CHANGE / 2  # [s] after the start
HOST_LANE, NEXT_LANE = -1, -2
DURATION = 35.0  # [s] after the moment of the cut-in
FASTEST, STRONGEST = 150.0, 12.0  # [m/s], [m/s^2]: limits that the format requires and that no cut-in reaches
MINOR_VERSION = 2  # of OpenSCENARIO XML 1
# The format requires a date. It is fixed, so that equal scenarios give equal files.
DATE = datetime.datetime(2000, 1, 1)
AUTHOR = "accelerated-evaluation"
NOT_WRITTEN = "no OpenSCENARIO files, because they are written for cut-ins only; the table is complete"


@dataclass(frozen=True)
class ConcreteScenario:
    """One cut-in that is written as an OpenSCENARIO file."""

    name: str  # of the file, without its ending
    lead_speed: float  # m/s at the cut-in
    range_: float  # distance between the bumpers at the cut-in [m]
    closing_speed: float  # host speed minus lead speed at the cut-in [m/s]
    # Further properties in the header of the file, by name, such as the weight of the scenario.
    notes: Mapping[str, str]
    # Lead speeds [m/s] 0.1, 0.2, ... s after the cut-in; empty if the lead speed is constant.
    later_speeds: Sequence[float] = ()


# Functions that write encounters into a folder, for the scenarios of which there are such files.
WRITERS: OfScenarios[Callable[[str | os.PathLike, Iterable[ConcreteScenario]], list[Path]]] = OfScenarios(
    "writer of scenario files", __name__, []
)


@WRITERS.add("cut_in")
def write_scenarios(folder: str | os.PathLike, scenarios: Iterable[ConcreteScenario]) -> list[Path]:
    """Write scenarios with different names and the road that they share into a folder, each file atomically.

    The result has the paths of the scenario files. StudyError is raised if the library scenariogeneration is
    not installed.
    """
    require_scenariogeneration()
    folder = Path(folder)
    _write_road(folder / ROAD)
    paths = []
    for scenario in scenarios:
        path = folder / f"{scenario.name}.xosc"
        with atomic_path(path) as temporary:
            _scenario(scenario).write_xml(str(temporary))
        paths.append(path)
    return paths


def require_scenariogeneration() -> None:
    """Raise StudyError if the library that writes OpenSCENARIO files is not installed."""
    try:
        import scenariogeneration  # noqa: F401
    except ImportError as error:
        raise StudyError(
            "OpenSCENARIO files need the library scenariogeneration, which is not installed; "
            "install it with `pip install 'accelerated-evaluation[scenarios]'`"
        ) from error


def _write_road(path: Path) -> None:
    from scenariogeneration import xodr

    road = xodr.create_road(xodr.Line(ROAD_LENGTH), id=1, left_lanes=0, right_lanes=2, lane_width=LANE_WIDTH)
    network = xodr.OpenDrive("straight road with two lanes", revMinor="7")
    network.add_road(road)
    network.adjust_roads_and_lanes()
    with atomic_path(path) as temporary:
        network.write_xml(str(temporary))
        # The library writes the present time. It is replaced, so that equal roads give equal files.
        text = temporary.read_text(encoding="utf-8")
        head = text.partition("date=")[2].split('"')[1]
        temporary.write_text(text.replace(head, str(DATE)), encoding="utf-8")


def _scenario(scenario: ConcreteScenario) -> "xosc.Scenario":
    from scenariogeneration import xosc

    entities = xosc.Entities()
    entities.add_scenario_object("host", _car("host", xosc.Role.civil))
    entities.add_scenario_object("lead", _car("lead", xosc.Role.civil))
    notes = xosc.Properties()
    numbers = {"lead_speed": scenario.lead_speed, "range": scenario.range_}
    numbers |= {"closing_speed": scenario.closing_speed, "moment": RUN_UP}
    for name, value in {
        **{name: repr(float(number)) for name, number in numbers.items()},
        **scenario.notes,
    }.items():
        notes.add_property(name, value)
    motion = "changes its speed" if len(scenario.later_speeds) else "keeps its speed"
    return xosc.Scenario(
        f"Cut-in {scenario.name}: the lead car comes into the lane of the host and {motion}",
        AUTHOR,
        xosc.ParameterDeclarations(),
        entities=entities,
        storyboard=_storyboard(scenario),
        roadnetwork=xosc.RoadNetwork(roadfile=ROAD),
        catalog=xosc.Catalog(),
        osc_minor_version=MINOR_VERSION,
        creation_date=DATE,
        header_properties=notes,
    )


def _car(name: str, role: "xosc.Role") -> "xosc.Vehicle":
    """Return a car whose reference point, at the middle of the rear axle, is 1.4 m behind its middle."""
    from scenariogeneration import xosc

    front, rear = xosc.Axle(0.5, 0.6, 1.6, 2.8, 0.3), xosc.Axle(0.0, 0.6, 1.6, 0.0, 0.3)
    box = xosc.BoundingBox(WIDTH, LENGTH, HEIGHT, 1.4, 0.0, HEIGHT / 2)
    limits = (FASTEST, STRONGEST, STRONGEST)
    return xosc.Vehicle(name, xosc.VehicleCategory.car, box, front, rear, *limits, mass=1500.0, role=role)


def _storyboard(scenario: ConcreteScenario) -> "xosc.StoryBoard":
    from scenariogeneration import xosc

    at_once = xosc.TransitionDynamics(xosc.DynamicsShapes.step, xosc.DynamicsDimension.time, 0.0)
    gradually = xosc.TransitionDynamics(
        xosc.DynamicsShapes.sinusoidal, xosc.DynamicsDimension.time, LANE_CHANGE
    )
    # Between equal points of the two cars there are the range and the length of a car at the moment of the
    # cut-in, and before that the way that the host closes in.
    ahead = float(scenario.range_ + LENGTH + scenario.closing_speed * RUN_UP)
    starts = {"host": (START, HOST_LANE), "lead": (START + ahead, NEXT_LANE)}
    lead_speed = float(scenario.lead_speed)
    speeds = {"host": lead_speed + float(scenario.closing_speed), "lead": lead_speed}
    init = xosc.Init()
    for name, (place, lane) in starts.items():
        init.add_init_action(name, xosc.TeleportAction(xosc.LanePosition(place, 0, str(lane), "1")))
        init.add_init_action(name, xosc.AbsoluteSpeedAction(speeds[name], at_once))
    board = xosc.StoryBoard(init, _end())
    cut_in = xosc.Event("cut_in", xosc.Priority.override)
    cut_in.add_action("change_lane", xosc.AbsoluteLaneChangeAction(HOST_LANE, gradually))
    cut_in.add_trigger(_after("lane_change_begins", LANE_CHANGE_BEGINS))
    maneuver = xosc.Maneuver("lead_maneuver")
    maneuver.add_event(cut_in)
    board.add_maneuver(maneuver, "lead")
    board.add_maneuver(_motion(scenario), "lead")
    return board


def path_speeds(scenario: ConcreteScenario) -> Array:
    """Return the speeds [m/s] of the other car along its path, every 0.1 s from the start of the lane change.

    In OpenSCENARIO a car that changes lane keeps the speed along its path, so that it is slower in the
    direction of the road. With a constant speed, the range at the cut-in would be up to 0.2 m too short and
    the closing speed up to 0.2 m/s too high. The speed along the path is therefore the root of the sum of the
    squares of the lead speed and of the lateral speed, which is W pi / (2 T) sin(pi t / T) for a sinusoidal
    change of lane by the width W within T seconds.
    """
    later = scenario.later_speeds or [scenario.lead_speed]
    steps = max(len(later), round(LANE_CHANGE / 2 / STEP))
    times = STEP * np.arange(-round(LANE_CHANGE / 2 / STEP), steps + 1)
    along = np.interp(times, STEP * np.arange(len(later) + 1), [scenario.lead_speed, *later])
    phase = np.pi * np.clip(times / LANE_CHANGE + 0.5, 0.0, 1.0)
    return np.hypot(along, LANE_WIDTH * np.pi / (2 * LANE_CHANGE) * np.sin(phase))


def _motion(scenario: ConcreteScenario) -> "xosc.Maneuver":
    """Return the manoeuvre that sets the speed of the other car from the start of the lane change on.

    The time of each entry of a speed profile is relative to the preceding entry. The first entry, at 0 s, is
    the initial speed, because players differ in what they assume before the first entry. The profile is in a
    manoeuvre of its own, because an event may end other events of its manoeuvre.
    """
    from scenariogeneration import xosc

    speeds = path_speeds(scenario).tolist()
    times = [0.0] + [STEP] * (len(speeds) - 1)
    profile = xosc.SpeedProfileAction(speeds, xosc.FollowingMode.position, times)
    changes = xosc.Event("lead_motion", xosc.Priority.override)
    changes.add_action("change_speed", profile)
    changes.add_trigger(_after("speed_changes", LANE_CHANGE_BEGINS))
    maneuver = xosc.Maneuver("lead_motion_maneuver")
    maneuver.add_event(changes)
    return maneuver


def _after(name: str, time: float) -> "xosc.ValueTrigger":
    from scenariogeneration import xosc

    passed = xosc.SimulationTimeCondition(time, xosc.Rule.greaterOrEqual)
    return xosc.ValueTrigger(name, 0.0, xosc.ConditionEdge.none, passed)


def _end() -> "xosc.Trigger":
    """Return the trigger that ends a scenario: a collision of the two cars, or the end of the duration."""
    from scenariogeneration import xosc

    contact = xosc.EntityTrigger(
        "collision",
        0.0,
        xosc.ConditionEdge.none,
        xosc.CollisionCondition("lead"),
        "host",
        triggeringpoint="stop",
    )
    over = xosc.ValueTrigger(
        "time_is_over",
        0.0,
        xosc.ConditionEdge.none,
        xosc.SimulationTimeCondition(RUN_UP + DURATION, xosc.Rule.greaterThan),
        triggeringpoint="stop",
    )
    end = xosc.Trigger("stop")
    for trigger in (contact, over):
        group = xosc.ConditionGroup("stop")
        group.add_condition(trigger)
        end.add_conditiongroup(group)
    return end
