"""A motorway in Eclipse SUMO, and all cut-ins on it, each with what the other car does afterwards.

Lanes of 5 km, and many kinds of drivers. A cut-in is a change of lane that makes a vehicle the leader of a
car. Vehicles may collide, so that the motorway does not prevent what is to be counted.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np
import pandas as pd
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError, StudyError
from numpy.typing import NDArray
from settings import Motorway, motorway_of

LENGTH = 5_000.0  # [m]
STEP = 0.1  # [s], of the simulation
RATE = 5  # records of all vehicles a second
FOLLOWED = 8.0  # [s], how long the other car is followed, the horizon of the study's car
AHEAD = 400.0  # [m], of road that a cut-in has ahead, so that the other car can be followed so long
SEEN = 150.0  # [m], largest range of a cut-in
WARM_UP = 900.0  # [s], until the road is full
PATIENCE = (
    60.0  # [s], after which a vehicle that finds no gap at the entry is left out; long queues take much time
)
CAR, LORRY = 4.8, 14.0  # [m], lengths
NAMES = ("lead_speed", "range", "closing_speed")


@dataclass(frozen=True)
class Part:
    """Some hours of a world.

    Attributes
    ----------
    root
        Root of all random numbers.
    world, part
        Numbers of the world and of the part of it.
    hours
        Hours of traffic after the warm-up.
    """

    root: int
    world: int
    part: int
    hours: float

    @property
    def drivers(self) -> np.random.Generator:
        """Source of the kinds of drivers, which are the same in all parts of a world."""
        return np.random.default_rng([self.root, self.world])

    @property
    def seed(self) -> int:
        """Seed of SUMO."""
        return int(np.random.default_rng([self.root, self.world, self.part]).integers(2**31))


def write_motorway(motorway: Motorway, folder: Path, drivers: np.random.Generator, end: float) -> None:
    """Write the network, the kinds of drivers and the demand for SUMO into a folder."""
    (folder / "m.nod.xml").write_text(
        f'<nodes><node id="a" x="0" y="0"/><node id="b" x="{LENGTH}" y="0"/></nodes>\n'
    )
    (folder / "m.edg.xml").write_text(
        f'<edges><edge id="m" from="a" to="b" numLanes="{motorway.lanes}" speed="{motorway.speed_limit}"/>'
        "</edges>\n"
    )
    files = ["--node-files", folder / "m.nod.xml", "--edge-files", folder / "m.edg.xml"]
    run_sumo("netconvert", *files, "--output-file", folder / "m.net.xml")
    types = "".join(_kinds(motorway, drivers))
    flow = (
        f'<flow id="f" type="drivers" begin="0" end="{end}" from="m" to="m" departLane="random" '
        f'departSpeed="desired" period="exp({motorway.flow / 3600})"/>'
    )
    (folder / "m.rou.xml").write_text(
        f'<routes><vTypeDistribution id="drivers">{types}</vTypeDistribution>{flow}</routes>\n'
    )


def _kinds(motorway: Motorway, generator: np.random.Generator) -> Iterator[str]:
    limits = {
        "tau": motorway.headway,
        "sigma": motorway.imperfection,
        "lcAssertive": motorway.assertive,
        "accel": (1.5, 3.0),
        "decel": (3.0, 5.0),
    }
    share = (1 - motorway.truck_share) / motorway.kinds
    for kind in range(motorway.kinds):
        drawn = " ".join(f'{name}="{generator.uniform(*ends):.3f}"' for name, ends in limits.items())
        yield (
            f'<vType id="car{kind}" probability="{share}" length="{CAR}" minGap="1" emergencyDecel="8" '
            f'speedFactor="normc(1,{motorway.speed_spread},0.7,1.4)" {drawn} '
            f'actionStepLength="{motorway.action_step}"/>'
        )
    yield (
        f'<vType id="lorry" vClass="truck" probability="{motorway.truck_share}" length="{LORRY}" minGap="2" '
        'tau="1.5" sigma="0.3" accel="0.8" decel="4" maxSpeed="25" '
        f'actionStepLength="{motorway.action_step}"/>'
    )


def run_sumo(program: str, *arguments: object) -> None:
    """Run a program of SUMO.

    Raises
    ------
    InputError
        If SUMO is not installed.
    StudyError
        If the program does not end as it should, for instance because it was killed.
    """
    try:
        import sumo
    except ImportError:
        raise InputError(
            "make world",
            seen="no Eclipse SUMO",
            expected="the package eclipse-sumo",
            change="Install it with: pip install -r benchmarks/motorway/environment.txt",
        ) from None
    command = [Path(sumo.SUMO_HOME) / "bin" / program, *arguments]
    run = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False)
    if run.returncode:
        said = run.stderr.strip().splitlines()
        raise StudyError(
            f"{program} of Eclipse SUMO ended with status {run.returncode}"
            f"{': ' + said[-1] if said else ''}. Nothing of this part was kept, and nothing else is lost. "
            "Run the same command again to continue."
        )


@dataclass(frozen=True)
class Trajectories:
    """All vehicles every 0.2 s, in order of vehicle and time; arrays of shape (n,).

    Attributes
    ----------
    vehicle, frame, lane
        Number of the vehicle, of the record and of the lane.
    front, speed, length
        Position of the front [m], speed [m/s] and length of the vehicle [m].
    """

    vehicle: NDArray[np.int64]
    frame: NDArray[np.int64]
    lane: NDArray[np.int64]
    front: Array
    speed: Array
    length: Array

    def during(self, begin: float, end: float) -> Self:
        """Return the records from a time until before another [s]."""
        kept = (self.frame >= begin * RATE) & (self.frame < end * RATE)
        columns = ("vehicle", "frame", "lane", "front", "speed", "length")
        return replace(self, **{name: getattr(self, name)[kept] for name in columns})

    @cached_property
    def changes(self) -> NDArray[np.bool_]:
        """Whether the vehicle was in another lane in its last record."""
        return np.append(False, (np.diff(self.vehicle) == 0) & (np.diff(self.lane) != 0))

    @cached_property
    def behind(self) -> NDArray[np.int64]:
        """Row of the nearest vehicle behind in the same lane, -1 if there is none."""
        order = np.lexsort((self.front, self.lane, self.frame))
        near, far = order[1:], order[:-1]
        same = (self.lane[near] == self.lane[far]) & (self.frame[near] == self.frame[far])
        behind = np.full(order.size, -1)
        behind[near[same]] = far[same]
        return behind

    def gaps(self) -> Array:
        """Return the gap from the vehicle behind, bumper to bumper [m]; NaN if there is none."""
        return np.where(self.behind < 0, np.nan, self.front - self.length - self.front[self.behind])

    def courses(self, rows: NDArray[np.int64]) -> Array:
        """Return the speeds after each of some rows [m/s], NaN after the vehicle has left the lane."""
        begins = np.append(True, np.diff(self.vehicle) != 0) | self.changes
        starts = np.append(np.flatnonzero(begins), begins.size)
        last = starts[np.searchsorted(starts, rows, side="right")] - 1
        index = rows[:, None] + np.arange(1, round(FOLLOWED * RATE) + 1)
        return np.where(index <= last[:, None], self.speed[np.minimum(index, begins.size - 1)], np.nan)

    def cut_ins(self) -> pd.DataFrame:
        """Return all cut-ins.

        Returns
        -------
        pandas.DataFrame
            A row for each cut-in: ``lead_speed`` [m/s], ``range`` [m], bumper to bumper, ``closing_speed``
            [m/s], ``time`` [s], ``vehicle``, ``host``, and ``speed_0.2`` ... [m/s], the speeds of the other
            car, NaN after it has left the lane. Lorries are no hosts. ``counts`` is false for ranges above
            150 m and for other cars that cannot be followed, at the end of the road or of the time.
        """
        gap, host = self.gaps(), self.behind
        rows = np.flatnonzero(self.changes & (gap > 0))
        rows = rows[self.length[host[rows]] == CAR]
        counts = (self.front < LENGTH - AHEAD) & (self.frame <= self.frame.max() - FOLLOWED * RATE)
        counts &= gap <= SEEN
        lead, behind = self.speed[rows], self.speed[host[rows]]
        table = pd.DataFrame({"lead_speed": lead, "range": gap[rows], "closing_speed": behind - lead})
        places = {"time": self.frame[rows] / RATE, "vehicle": self.vehicle[rows]}
        table = table.assign(**places, host=self.vehicle[host[rows]], counts=counts[rows])
        names = [f"speed_{index / RATE:.1f}" for index in range(1, round(FOLLOWED * RATE) + 1)]
        courses = pd.DataFrame(self.courses(rows).astype(np.float32), columns=names)
        return table.join(courses).sort_values(["time", "vehicle"], ignore_index=True)


def simulate(motorway: Motorway, part: Part) -> Trajectories:
    """Simulate a part of a world after the warm-up.

    Raises
    ------
    InputError
        If no vehicle drives on the road, or SUMO is not installed.
    StudyError
        If SUMO does not end as it should.
    """
    end = WARM_UP + part.hours * 3600 + FOLLOWED
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_motorway(motorway, folder, part.drivers, end)
        options = ["--step-length", STEP, "--seed", part.seed, "--end", end, "--precision", 4]
        options += ["--collision.action", "warn", "--collision.mingap-factor", 0, "--time-to-teleport", -1]
        options += ["--max-depart-delay", PATIENCE]
        options += [
            "--no-step-log",
            "--no-warnings",
            "--default.speeddev",
            0,
            "--extrapolate-departpos",
            "true",
        ]
        options += ["--fcd-output", folder / "m.parquet", "--device.fcd.begin", WARM_UP]
        options += ["--device.fcd.period", 1 / RATE, "--fcd-output.attributes", "id,type,lane,pos,speed"]
        run_sumo("sumo", "-n", folder / "m.net.xml", "-r", folder / "m.rou.xml", *options)
        table = pd.read_parquet(folder / "m.parquet")
    table = table.rename(columns=lambda each: each.split("_")[-1])
    if "id" not in table or table["id"].isna().all():
        raise InputError(
            "settings, flow",
            seen=f"{motorway.flow:g} vehicles an hour, none of them on the road within {part.hours:g} h",
            expected="traffic",
            change="Set a larger flow, or simulate more hours.",
        )
    table = table.dropna(subset="id").assign(time=table["time"] - WARM_UP)
    return _trajectories(table)


def _trajectories(table: pd.DataFrame) -> Trajectories:
    """Return the trajectories in the table that SUMO writes, whose time begins after the warm-up."""
    vehicle = table["id"].str.removeprefix("f.").astype(np.int64).to_numpy()
    frame = np.rint(table["time"].to_numpy(dtype=float) * RATE).astype(np.int64)
    order = np.lexsort((frame, vehicle))
    lane = table["lane"].str.removeprefix("m_").astype(np.int64).to_numpy()
    length = np.where(table["type"] == "lorry", LORRY, CAR)
    front, speed = (table[name].to_numpy(dtype=float) for name in ("pos", "speed"))
    columns = (vehicle, frame, lane, front, speed, length)
    return Trajectories(*(column[order] for column in columns))


def add_part(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that name a part of a world."""
    parser.add_argument("--settings", required=True, help="settings of the traffic, in JSON")
    parser.add_argument("--seed", type=int, required=True, help="root of all random numbers")
    parser.add_argument("--world", type=int, required=True, help="number of the world")
    parser.add_argument("--part", type=int, required=True, help="number of the part")
    parser.add_argument("--hours", type=float, required=True, help="hours of traffic after the warm-up")


def named_part(arguments: argparse.Namespace) -> tuple[Motorway, Part]:
    """Return the motorway and the part that the arguments name."""
    motorway = motorway_of(json.loads(arguments.settings), "--settings")
    return motorway, Part(arguments.seed, arguments.world, arguments.part, arguments.hours)


def run_command(main: Callable[[], None]) -> None:
    """Run a program, and end with status 2 and one message if it cannot do its work."""
    try:
        main()
    except StudyError as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(2) from None
