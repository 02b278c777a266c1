"""A motorway in Eclipse SUMO, and all cut-ins on it, each with what the other car does afterwards.

Three lanes of 5 km, and many kinds of drivers. A cut-in is a change of lane that makes a car the leader of
another car. Vehicles may collide, so that the motorway does not prevent what is to be counted.
"""

import argparse
import itertools
import math
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import atomic_path, write_csv

LENGTH = 5_000.0  # [m]
LANES = 3
STEP = 0.1  # [s]
EVERY = 2  # steps between two records
SAMPLED = EVERY * STEP  # [s], interval of the recorded speeds
FOLLOWED = 10.0  # [s], how long the other car is followed
SEEN = 150.0  # [m], largest range of a cut-in
WARM_UP = 240.0  # [s], until the motorway is full
WINDOW = 5.0  # [s], over which changes of speed are measured, as in NGSIM
FASTER = 8.0  # [m/s], speed above which they are
NAMES = ("lead_speed", "range", "closing_speed")


@dataclass(frozen=True)
class Motorway:
    """Settings of a motorway; the defaults were calibrated to NGSIM (see benchmarks/README.md).

    Attributes
    ----------
    flow
        Vehicles that enter per hour.
    truck_share
        Share of lorries.
    kinds
        Number of kinds of car drivers.
    headway
        Limits of the uniform distribution of the desired time headway [s].
    action_step
        Interval at which drivers decide [s].
    assertive
        Largest willingness to change into a small gap; uniform from 1.
    speed_spread
        Standard deviation of the desired speed, relative to the limit.
    speed_limit
        Speed limit [m/s].
    imperfection
        Limits of the uniform distribution of the random slowing of drivers (sigma of the Krauss model).
    """

    flow: float = 6_500.0
    truck_share: float = 0.12
    kinds: int = 150
    headway: tuple[float, float] = (0.4, 1.2)
    action_step: float = 0.5
    assertive: float = 3.0
    speed_spread: float = 0.12
    speed_limit: float = 30.0
    imperfection: tuple[float, float] = (0.5, 1.0)

    def write(self, folder: Path, generator: np.random.Generator, hours: float) -> None:
        """Write the network, the kinds of drivers and the demand for SUMO into a folder."""
        (folder / "m.nod.xml").write_text(
            f'<nodes><node id="a" x="0" y="0"/><node id="b" x="{LENGTH}" y="0"/></nodes>\n'
        )
        (folder / "m.edg.xml").write_text(
            f'<edges><edge id="m" from="a" to="b" numLanes="{LANES}" speed="{self.speed_limit}"/></edges>\n'
        )
        files = ["--node-files", folder / "m.nod.xml", "--edge-files", folder / "m.edg.xml"]
        subprocess.run(
            [binary("netconvert"), *files, "--output-file", folder / "m.net.xml"],
            check=True,
            capture_output=True,
        )
        types = "".join(self._kinds(generator))
        end = WARM_UP + hours * 3600
        flow = (
            f'<flow id="f" type="drivers" begin="0" end="{end}" from="m" to="m" departLane="random" '
            f'departSpeed="desired" period="exp({self.flow / 3600})"/>'
        )
        (folder / "m.rou.xml").write_text(
            f'<routes><vTypeDistribution id="drivers">{types}</vTypeDistribution>{flow}</routes>\n'
        )

    def _kinds(self, generator: np.random.Generator) -> Iterator[str]:
        limits = {
            "tau": self.headway,
            "sigma": self.imperfection,
            "lcAssertive": (1.0, self.assertive),
            "accel": (1.5, 3.0),
            "decel": (3.0, 5.0),
        }
        share = (1 - self.truck_share) / self.kinds
        for kind in range(self.kinds):
            drawn = " ".join(f'{name}="{generator.uniform(*ends):.3f}"' for name, ends in limits.items())
            yield (
                f'<vType id="car{kind}" probability="{share}" length="4.8" minGap="1" emergencyDecel="8" '
                f'speedFactor="normc(1,{self.speed_spread},0.7,1.4)" {drawn} '
                f'actionStepLength="{self.action_step}"/>'
            )
        yield (
            f'<vType id="lorry" vClass="truck" probability="{self.truck_share}" length="14" minGap="2" '
            'tau="1.5" sigma="0.3" accel="0.8" decel="4" maxSpeed="25" '
            f'actionStepLength="{self.action_step}"/>'
        )


def binary(name: str) -> str:
    """Return the path of a program of SUMO.

    Raises
    ------
    InputError
        If SUMO is not installed.
    """
    try:
        import sumo
    except ImportError:
        raise InputError(
            "make world",
            seen="no Eclipse SUMO",
            expected="the packages eclipse-sumo and libsumo",
            change="Install them with: pip install -r benchmarks/motorway/environment.txt",
        ) from None
    return str(Path(sumo.SUMO_HOME) / "bin" / name)


@dataclass
class Followed:
    """A cut-in while the other car is followed."""

    row: tuple[float, ...]
    leader: str
    lane: int
    speeds: list[float] = field(default_factory=list)


def drive(motorway: Motorway, folder: Path, seed: int, hours: float) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Simulate a motorway and follow every cut-in.

    Returns
    -------
    cut_ins
        A row for each cut-in: ``lead_speed`` [m/s], ``range`` [m], bumper to bumper, ``closing_speed`` [m/s],
        ``seen`` [s], how long the other car stayed in its lane, and ``speed_000`` ... [m/s], its speed every
        0.2 s; after ``seen`` it keeps the last one.
    traffic
        A single row about the traffic: ``kilometres`` of all vehicles, ``collisions``, ``cut_ins``; shares of
        5-s ``windows`` above 8 m/s in which a vehicle lost more than 3 and 5 m/s, and of the cars that cut in
        and were ``followed`` for 5 s those that lost more than 1 and 2 m/s.
    """
    motorway.write(folder, np.random.default_rng(seed), hours)
    import libsumo
    from libsumo import constants

    options = ["--step-length", STEP, "--seed", seed % 2**31, "--collision.action", "warn"]
    options += ["--collision.mingap-factor", 0, "--no-step-log", "--no-warnings", "--time-to-teleport", -1]
    options += ["--default.speeddev", 0, "--extrapolate-departpos", "true"]
    start = [binary("sumo"), "-n", folder / "m.net.xml", "-r", folder / "m.rou.xml", *options]
    libsumo.start([str(word) for word in start])
    watched = [constants.VAR_LANE_INDEX, constants.VAR_LANEPOSITION, constants.VAR_SPEED]
    record = Record()
    try:
        lengths: dict[str, float] = {}
        for step in itertools.count():
            time = step * STEP
            if time >= WARM_UP + hours * 3600:
                break
            libsumo.simulationStep()
            for vehicle in libsumo.simulation.getDepartedIDList():
                libsumo.vehicle.subscribe(vehicle, watched)
                lengths[vehicle] = libsumo.vehicle.getLength(vehicle)
            if time >= WARM_UP - WINDOW and step % EVERY == 0:
                states = libsumo.vehicle.getAllSubscriptionResults()
                collided = libsumo.simulation.getCollidingVehiclesNumber()
                record.step(step, {v: tuple(s[key] for key in watched) for v, s in states.items()}, lengths)
                record.collided += collided // 2
    finally:
        libsumo.close()
    return record.cut_ins(), record.traffic()


class Record:
    """What is recorded of a motorway, step by step."""

    def __init__(self) -> None:
        self.lanes: dict[str, int] = {}
        self.before: dict[str, float] = {}
        self.followed: list[Followed] = []
        self.finished: list[Followed] = []
        self.kilometres = 0.0
        self.drops: list[float] = []
        self.collided = 0

    def step(self, step: int, states: dict[str, tuple[int, float, float]], lengths: dict[str, float]) -> None:
        """Record a step: lane, position of the front [m] and speed [m/s] of every vehicle."""
        self._follow(states)
        changed = [v for v, (lane, *_) in states.items() if self.lanes.get(v, lane) != lane]
        if changed:
            self._find(changed, states, lengths)
        self.lanes = {vehicle: lane for vehicle, (lane, *_) in states.items()}
        self.kilometres += SAMPLED / 1000 * sum(state[2] for vehicle, state in states.items())
        if step % round(WINDOW / STEP) == 0:
            now = {vehicle: state[2] for vehicle, state in states.items()}
            self.drops += [v - now[x] for x, v in self.before.items() if v > FASTER and x in now]
            self.before = now

    def _follow(self, states: dict[str, tuple[int, float, float]]) -> None:
        """Record the speeds of the cars that cut in, and end the records that are complete."""
        most = round(FOLLOWED / SAMPLED)
        going = []
        for one in self.followed:
            state = states.get(one.leader)
            is_gone = state is None or state[0] != one.lane
            if not is_gone:
                one.speeds.append(state[2])
            (self.finished if is_gone or len(one.speeds) > most else going).append(one)
        self.followed = going

    def _find(
        self,
        changed: list[str],
        states: dict[str, tuple[int, float, float]],
        lengths: dict[str, float],
    ) -> None:
        """Find the car behind each vehicle that changed its lane; lorries are no hosts."""
        for leader in changed:
            lane, front, speed = states[leader]
            behind = [
                (place, v, vehicle)
                for vehicle, (own, place, v) in states.items()
                if own == lane and place < front and vehicle != leader
            ]
            if not behind:
                continue
            place, own, host = max(behind)
            gap = front - lengths[leader] - place
            if 0 < gap <= SEEN and lengths[host] < 6:
                self.followed.append(Followed((speed, gap, own - speed), leader, lane))

    def cut_ins(self) -> pd.DataFrame:
        """Return the cut-ins whose records are complete; see `drive`."""
        most = round(FOLLOWED / SAMPLED) + 1
        rows = [one for one in self.finished if one.speeds]
        speeds = np.array(
            [one.speeds[:most] + [one.speeds[-1]] * (most - len(one.speeds)) for one in rows]
        ).reshape(-1, most)
        table = pd.DataFrame([one.row for one in rows], columns=list(NAMES), dtype=float)
        table["seen"] = [min(len(one.speeds) - 1, most - 1) * SAMPLED for one in rows]
        # The recorded course begins at the moment of the change, with the speed of that moment.
        speeds[:, 0] = table["lead_speed"]
        names = [f"speed_{index:03d}" for index in range(most)]
        return table.join(pd.DataFrame(speeds.astype(np.float32), columns=names))

    def traffic(self) -> pd.DataFrame:
        """Return the row about the traffic; see `drive`."""
        drops, after = np.array(self.drops), round(WINDOW / SAMPLED)
        lost = np.array([one.row[0] - one.speeds[after] for one in self.finished if len(one.speeds) > after])
        row = {"kilometres": self.kilometres, "collisions": self.collided, "cut_ins": len(self.finished)}
        row |= {"windows": drops.size} | {f"drops_above_{by}": np.mean(drops > by) for by in (3, 5)}
        row |= {"followed": lost.size} | {f"lost_above_{by}": np.mean(lost > by) for by in (1, 2)}
        return pd.DataFrame([row])


def settings(path: str | None) -> Motorway:
    """Return the settings of a YAML file, or the defaults.

    Raises
    ------
    InputError
        If the file cannot be read, or has a key or value that no motorway has.
    """
    if path is None:
        return Motorway()
    try:
        given = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(path, seen=str(error), expected="a file in YAML", change="Correct it.") from None
    known = {each.name: each.default for each in fields(Motorway)}
    if not isinstance(given, dict):
        expected = "a mapping, such as flow: 5000"
        raise InputError(path, seen=repr(given), expected=expected, change="Correct it.")
    for name, value in given.items():
        if name not in known:
            expected = f"settings of a motorway: {', '.join(known)}"
            raise InputError(path, seen=repr(name), expected=expected, change="Correct the key.")
        numbers = value if isinstance(known[name], tuple) else [value]
        size = len(known[name]) if isinstance(known[name], tuple) else 1
        if not isinstance(numbers, list) or len(numbers) != size or not all(map(_is_positive, numbers)):
            expected = f"{size} positive number{'s' if size > 1 else ''}, such as {known[name]}"
            raise InputError(f"{path}, {name}", seen=repr(value), expected=expected, change="Correct it.")
    return Motorway(**{name: tuple(v) if isinstance(v, list) else v for name, v in given.items()})


def _is_positive(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 < value < math.inf


def run_command(main: Callable[[], None]) -> None:
    """Run a program, and end with status 2 and one message if its input is wrong."""
    try:
        main()
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(2) from None


def main() -> None:
    """Write the cut-ins of some hours of a world, and the row about its traffic."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, required=True, help="seed of SUMO and of the drivers")
    parser.add_argument("--hours", type=float, required=True, help="hours of traffic after the warm-up")
    parser.add_argument("--settings", help="YAML file of settings that differ from the defaults")
    parser.add_argument("--output", required=True, help="Parquet file of the cut-ins")
    parser.add_argument("--traffic", required=True, help="CSV file of the row about the traffic")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        cut_ins, traffic = drive(settings(arguments.settings), Path(folder), arguments.seed, arguments.hours)
    with atomic_path(arguments.output) as temporary:
        cut_ins.to_parquet(temporary)
    write_csv(arguments.traffic, traffic)


if __name__ == "__main__":
    run_command(main)
