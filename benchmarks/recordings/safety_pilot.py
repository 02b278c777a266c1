"""Made-up recordings in the format of the Safety Pilot tables, with cut-ins that are known.

A trip is a row of slots of 20 s. In each slot something happens that is a cut-in, or only looks like one,
while three other cars drive in the lanes beside. Nothing here shares code with the extraction that it tests.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pandas as pd
import pyarrow as pa
from pyarrow import csv

FRAMES = 200  # of a slot, 0.1 s each
SLOTS = 30  # of a trip
DEVICES = 98
BATCH = 1200  # slots that are made at once, whole trips
ROWS_OF_A_SLOT = 600  # targets, on average; the length of a file follows from it
SIDE = 3.5  # [m], offset of a car in the lane beside
CUT_INS = ("plain", "flickers", "changes_id", "has_gap", "is_repeated", "lacks_a_cell")
OTHERS = (
    "touches_the_path",
    "is_uncovered",
    "is_uncovered_in_a_bend",
    "was_ahead_all_the_time",
    "is_a_truck",
    "host_signals",
    "is_oncoming",
    "has_no_host_speed",
    "id_is_used_again",
    "leaves_and_returns",
    "is_found_in_the_path",
    "stays_beside",
)


@dataclass
class Car:
    """A target in n slots: what the sensor says of it in each frame, all arrays of shape (n, FRAMES)."""

    obstacle: np.ndarray
    range: np.ndarray
    range_rate: np.ndarray
    offset: np.ndarray
    in_path: np.ndarray
    seen: np.ndarray
    type: int = 0
    twice: np.ndarray | None = None


@dataclass
class Slots:
    """n slots in which the same happens: the frame of the moment, the host, the cars, and what is true."""

    number: np.ndarray
    moment: np.ndarray
    host_speed: np.ndarray
    host_recorded: np.ndarray
    signal: np.ndarray
    cars: list[Car] = field(default_factory=list)
    is_cut_in: bool = False


def frames() -> np.ndarray:
    """Return the frames of a slot as a row."""
    return np.arange(FRAMES)[None, :]


def drive(slots: Slots, generator: np.random.Generator, at: np.ndarray | None = None) -> Car:
    """Return a car beside the host, seen in the middle 16 s of its slot, with a smooth range."""
    n = len(slots.number)
    at = np.exp(generator.uniform(np.log(5), np.log(100), n)) if at is None else at
    rate = generator.uniform(-0.25, 0.4, n) * np.minimum(at, 25)
    seconds = (frames() - slots.moment[:, None]) / 10
    after = np.maximum(seconds, 0)
    range_ = at[:, None] + rate[:, None] * (np.minimum(seconds, 0) + 2 * (1 - np.exp(-after / 2)))
    side = np.where(generator.random(n) < 0.5, -SIDE, SIDE)[:, None]
    return Car(
        obstacle=np.zeros((n, FRAMES), int),
        range=range_,
        range_rate=rate[:, None] * np.exp(-after / 2),
        offset=np.broadcast_to(side, (n, FRAMES)).copy(),
        in_path=np.zeros((n, FRAMES), bool),
        seen=np.broadcast_to((frames() >= 20) & (frames() < 180), (n, FRAMES)) & (range_ > 0.5),
    )


def cut_in(slots: Slots, generator: np.random.Generator) -> Car:
    """Return a car that comes over within 4 s, and is in the path from the moment on."""
    car, later = drive(slots, generator), frames() - slots.moment[:, None]
    car.offset *= np.clip((20 - later) / 40, 0, 1)
    car.in_path = later >= 0
    return car


def happen(what: str, slots: Slots, generator: np.random.Generator) -> None:
    """Put into the slots the cars of one kind of event."""
    later = frames() - slots.moment[:, None]
    car = cut_in(slots, generator)
    slots.cars.append(car)
    slots.is_cut_in = what in CUT_INS
    if what == "flickers":
        car.in_path &= ~((later >= 2) & (later < 5))
    elif what == "changes_id":
        car.seen &= ~((later >= -2) & (later < 0))
        car.obstacle += later >= 0
    elif what == "has_gap":
        car.seen &= ~((later >= -3) & (later < 0))
    elif what == "is_repeated":
        car.twice = np.abs(later) < 10
    elif what == "lacks_a_cell":
        car.range[later == 6] = np.nan
    else:
        seem(what, slots, car, generator)


def seem(what: str, slots: Slots, car: Car, generator: np.random.Generator) -> None:
    """Change a cut-in, the first car of the slots, into what only looks like one."""
    later = frames() - slots.moment[:, None]
    if what == "touches_the_path":
        car.in_path &= later < 4
        car.offset = np.sign(car.offset + 1e-9) * np.maximum(np.abs(car.offset), 2.5)
    elif what in ("is_uncovered", "is_uncovered_in_a_bend"):
        car.offset[:] = 1.5 if what.endswith("bend") else 0.1
        nearer = drive(slots, generator, at=car.range[:, 0] * 0)  # its range follows
        nearer.obstacle += 1
        nearer.range, nearer.range_rate = car.range * 0.5, car.range_rate * 0.5
        nearer.in_path = later < 0
        nearer.offset = np.clip(later / 20, 0, 1) * SIDE
        nearer.seen = car.seen
        slots.cars.append(nearer)
    elif what == "was_ahead_all_the_time":
        car.offset = 0.4 * np.sin(later / 10)
    elif what == "is_a_truck":
        car.type = 1
    elif what == "host_signals":
        slots.signal = np.abs(later) <= 15
    elif what == "is_oncoming":
        car.range_rate = np.broadcast_to(-(slots.host_speed + 8), later.shape)
        at = generator.uniform(30, 90, len(later))[:, None]
        car.range = at + car.range_rate * later / 10
        car.seen = car.seen & (car.range > 0.5)
    elif what == "has_no_host_speed":
        slots.host_recorded = np.abs(later) > 10
    elif what == "id_is_used_again":
        car.seen &= (later < -30) | (later >= 0)
        car.offset = np.where(later < 0, SIDE, 0.0)
        car.range = np.where(later < 0, car.range + 20, car.range)
    elif what == "leaves_and_returns":
        car.offset[:] = 1.4
        car.in_path = (later < 0) | (later >= 6)
    elif what == "is_found_in_the_path":
        car.seen &= later >= 0
    elif what == "stays_beside":
        car.offset = np.sign(car.offset + 1e-9) * SIDE
        car.in_path[:] = False


def make_slots(numbers: np.ndarray, generator: np.random.Generator) -> list[Slots]:
    """Draw what happens in the slots of some numbers, and make it."""
    kinds = [*CUT_INS, *OTHERS]
    drawn = generator.integers(len(kinds), size=len(numbers))
    found = []
    for index, what in enumerate(kinds):
        number = numbers[drawn == index]
        shape = (len(number), FRAMES)
        trip_speed = 8 + 25 * ((number // SLOTS * 7919) % 100) / 100
        kmh = 3.6 * (trip_speed[:, None] + np.sin(frames() / FRAMES * 2 * np.pi))
        slots = Slots(
            number=number,
            moment=generator.integers(80, 120, len(number)),
            host_speed=kmh.astype(np.float32).astype(float) / 3.6,
            host_recorded=np.ones(shape, bool),
            signal=np.zeros(shape, bool),
        )
        happen(what, slots, generator)
        for beside in range(3):
            car = drive(slots, generator)
            car.obstacle += 2 + beside
            slots.cars.append(car)
        found.append(slots)
    return found


def keys(slots: Slots) -> dict[str, np.ndarray]:
    """Return device, trip and time of each frame, shape (n, FRAMES)."""
    trip = np.broadcast_to(slots.number[:, None] // SLOTS, (len(slots.number), FRAMES))
    time = 500 + 10 * (slots.number[:, None] % SLOTS * FRAMES + frames())
    return {"Device": 10100 + trip % DEVICES, "Trip": 200 + trip // DEVICES, "Time": time}


def target_rows(slots: Slots, car: Car, index: int) -> pd.DataFrame:
    """Return the rows of DataFrontTargets of one car."""
    obstacle = (slots.number[:, None] % 11 * 5 + car.obstacle) % 64
    columns = {
        **keys(slots),
        "TargetId": np.full_like(obstacle, index + 1),
        "ObstacleId": obstacle,
        "Range": car.range.astype(np.float32),
        "RangeRate": car.range_rate.astype(np.float32),
        "Transversal": car.offset.astype(np.float32),
        "TargetType": np.full_like(obstacle, car.type),
        "Status": np.full_like(obstacle, 3),
        "CIPV": car.in_path.astype(int),
    }
    rows = pd.DataFrame({name: values[car.seen] for name, values in columns.items()})
    return rows if car.twice is None else pd.concat([rows, rows[car.twice[car.seen]]])


def host_rows(slots: Slots) -> pd.DataFrame:
    """Return the rows of DataWsu."""
    recorded, shape = slots.host_recorded, slots.host_speed.shape
    varying = {
        **keys(slots),
        "GpsSpeedWsu": slots.host_speed.astype(np.float32),
        "SpeedWsu": (3.6 * slots.host_speed).astype(np.float32),
        "TurnSngRWsu": slots.signal.astype(int),
    }
    rows = pd.DataFrame({name: np.broadcast_to(x, shape)[recorded] for name, x in varying.items()})
    constant = dict(zip(HOST.split(","), CONSTANT.split(","), strict=True))
    return rows.assign(**{name: x for name, x in constant.items() if name not in varying})[list(constant)]


HOST = (
    "Device,Trip,Time,GpsValidWsu,GpsTimeWsu,LatitudeWsu,LongitudeWsu,AltitudeWsu,GpsHeadingWsu,GpsSpeedWsu,"
    "HdopWsu,PdopWsu,FixQualityWsu,GpsCoastingWsu,ValidCanWsu,YawRateWsu,SpeedWsu,TurnSngRWsu,TurnSngLWsu,"
    "BrakeAbsTcsWsu,AxWsu,PrndlWsu,VsaActiveWsu,HeadlampWsu,WiperWsu,ThrottleWsu,SteerWsu"
)
CONSTANT = "0,0,0,1,1365685117400,42.24915,-83.61466,182.8,251.91,0,0.8,1.4,1,0,1,0,0,0,0,0,0,5,0,0,0,0,0"


def planted_rows(slots: Slots) -> pd.DataFrame:
    """Return the cut-ins of the slots as an extraction should find them, units SI."""
    n = np.arange(len(slots.number))
    car, at = slots.cars[0], slots.moment
    key = keys(slots)
    rate = car.range_rate[n, at].astype(np.float32).astype(float)
    return pd.DataFrame(
        {
            "device": key["Device"][n, at],
            "trip": key["Trip"][n, at],
            "time": key["Time"][n, at] / 100,
            "lead_speed": slots.host_speed[n, at] + rate,
            "range": car.range[n, at].astype(np.float32).astype(float),
            "closing_speed": -rate,
        }
    )


def batches(
    slots: int, generator: np.random.Generator
) -> Iterator[tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]]:
    """Yield targets, host and planted cut-ins of some trips after the other, in the order of a real file."""
    order = ["Device", "Trip", "Time"]
    for first in range(0, slots, BATCH):
        made = make_slots(np.arange(first, min(first + BATCH, slots)), generator)
        targets = pd.concat([target_rows(s, car, i) for s in made for i, car in enumerate(s.cars)])
        host = pd.concat([host_rows(s) for s in made])
        planted = pd.concat([planted_rows(s) for s in made if s.is_cut_in])
        yield targets.sort_values([*order, "TargetId"]), host.sort_values(order), planted


def write_recordings(folder: Path, slots: int, generator: np.random.Generator) -> tuple[int, pd.DataFrame]:
    """Write DataFrontTargets.csv and DataWsu.csv of some slots of 20 s.

    Returns
    -------
    tuple
        Rows of targets, and the planted cut-ins: device, trip, time [s], lead_speed [m/s], range [m],
        closing_speed [m/s].
    """
    folder.mkdir(parents=True, exist_ok=True)
    rows, planted = 0, []
    with (folder / "DataFrontTargets.csv").open("wb") as front, (folder / "DataWsu.csv").open("wb") as wsu:
        for targets, host, truth in batches(slots, generator):
            append(front, targets)
            append(wsu, host)
            rows += len(targets)
            planted.append(truth)
    return rows, pd.concat(planted, ignore_index=True)


def append(file: BinaryIO, table: pd.DataFrame) -> None:
    """Write rows, and before the first of them a header without quotes, which the real files have."""
    if not file.tell():
        file.write((",".join(table) + "\n").encode())
    csv.write_csv(
        pa.Table.from_pandas(table, preserve_index=False), file, csv.WriteOptions(include_header=False)
    )


def main() -> None:
    """Write recordings into a folder, with the cut-ins that are planted in them beside it."""
    parser = argparse.ArgumentParser(description="Write recordings in the Safety Pilot format.")
    parser.add_argument("folder", type=Path, help="to write; FOLDER_planted.csv gets what is planted")
    parser.add_argument("--slots", type=int, default=1500, help="of 20 s, 600 rows (default: %(default)s)")
    given = parser.parse_args()
    _, planted = write_recordings(given.folder, given.slots, np.random.default_rng(2016))
    planted.to_csv(given.folder.with_name(f"{given.folder.name}_planted.csv"), index=False)


if __name__ == "__main__":
    main()
