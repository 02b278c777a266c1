"""Cut-ins of the motorway, recordings of it in the format of highD, and whether ``extract`` finds them.

``drive`` simulates a part of a world, and writes its cut-ins.
``write`` simulates a part of a world, and records single minutes that are evenly spread over it. It writes
their trajectories, the list of their cut-ins, and configurations for ``accelerated-evaluation extract``.
``compare`` compares the list with what was found.

Traffic has calm and congested periods of several minutes. Single minutes show more of these periods than the
same number of minutes in a row, so that fewer of them are needed to represent the traffic of an hour.
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from accelerated_evaluation.base.files import atomic_path, write_csv, write_text
from traffic import CAR, FOLLOWED, NAMES, RATE, Trajectories, add_part, named_part, run_command, simulate

TRACKS = ("frame", "id", "x", "width", "xVelocity", "followingId", "laneId")  # the columns that are read
STUDY = "data:\n  source: highd\n  highd: {{path: {path}{rule}}}\n"
# Without the rules that leave out some of the changes of lane; docs/your_records.md explains them.
RULES = {"default": "", "none": ", settled: 0, rule: {gap: 0.2, absence: 0, stay: 0}"}
KEYS = ["time", "vehicle"]
MINUTE = 60.0  # [s]
BEFORE = 2.0  # [s] before a recorded minute, in which the host has been in its lane


def recorded_minutes(hours: float, recorded: float) -> list[int]:
    """Return which minutes of some hours are recorded, so that they add up to ``recorded`` hours."""
    minutes = max(round(60 * recorded), 1)
    return [number * round(60 * hours) // minutes for number in range(minutes)]


def in_minutes(table: pd.DataFrame, minutes: list[int]) -> pd.DataFrame:
    """Return the cut-ins of a table that begin in one of the recorded minutes."""
    return table[(table["time"] // MINUTE).isin(minutes)]


def write_recordings(folder: Path, found: Trajectories, minutes: list[int]) -> None:
    """Write a recording of each minute in the format of highD; ids begin with 1, as 0 stands for no vehicle.

    A recording begins `BEFORE` its minute, and goes on until the last cut-in of the minute has been followed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for number, minute in enumerate(minutes, start=1):
        begin, end = MINUTE * minute - BEFORE, MINUTE * (minute + 1) + FOLLOWED
        _write_recording(folder, number, found.during(begin, end))
    for name, rule in RULES.items():
        write_text(folder / f"{name}.yaml", STUDY.format(path=folder, rule=rule))


def _write_recording(folder: Path, number: int, found: Trajectories) -> None:
    following = np.where(found.behind < 0, 0, found.vehicle[found.behind] + 1)
    columns = (found.frame, found.vehicle + 1, found.front - found.length, found.length, found.speed)
    columns += (following, found.lane + 1)
    tracks = pd.DataFrame(dict(zip(TRACKS, columns, strict=True)))
    tracks.to_csv(folder / f"{number:02}_tracks.csv", index=False, float_format="%.4f")
    ids, first = np.unique(found.vehicle, return_index=True)
    kinds = np.where(found.length[first] == CAR, "Car", "Truck")
    meta = pd.DataFrame({"id": ids + 1, "drivingDirection": 2, "class": kinds})
    meta.to_csv(folder / f"{number:02}_tracksMeta.csv", index=False)
    rate = pd.DataFrame({"id": [number], "frameRate": [RATE]})
    rate.to_csv(folder / f"{number:02}_recordingMeta.csv", index=False)


def compared(known: pd.DataFrame, found: pd.DataFrame) -> tuple[pd.DataFrame, dict[str, float]]:
    """Compare the cut-ins that were found with those of the world.

    Returns
    -------
    records : pandas.DataFrame
        The cut-ins that were found and can be followed, with the courses of the other cars.
    row : dict
        ``known``, ``found``, how many are in both, ``recall``, ``false``, the share of those that were found
        and are not known, and ``difference``, the largest one of a lead speed [m/s], range [m] or closing
        speed [m/s]. They are NaN if they are ratios or differences of nothing.
    """
    found = found.assign(vehicle=found["vehicle"] - 1).drop_duplicates(KEYS)  # if recordings overlap
    both = known.merge(found[[*KEYS, *NAMES]], on=KEYS, suffixes=("_known", ""))
    differences = [(both[name] - both[f"{name}_known"]).abs().max() for name in NAMES]
    row = {"known": len(known), "found": len(found), "both": len(both)}
    row |= {"recall": len(both) / len(known) if len(known) else np.nan}
    row |= {"false": 1 - len(both) / len(found) if len(found) else np.nan, "difference": max(differences)}
    return both[both["counts"]].drop(columns=["counts", *(f"{name}_known" for name in NAMES)]), row


def main() -> None:
    """Write the cut-ins of a part, write a recording, or compare what was found in it."""
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(required=True, dest="command")
    drive = commands.add_parser("drive", help="simulate, and write the cut-ins")
    write = commands.add_parser("write", help="simulate, and write the recordings")
    for command in (drive, write):
        add_part(command)
    drive.add_argument("output", help="Parquet file of the cut-ins")
    write.add_argument("folder", type=Path, help="of the recordings")
    write.add_argument("known", help="Parquet file of the cut-ins of the world")
    compare = commands.add_parser("compare", help="compare the list of the world with what was found")
    compare.add_argument("--hours", type=float, required=True, help="hours of traffic after the warm-up")
    compare.add_argument("--world", type=int, required=True, help="number of the world")
    compare.add_argument("--known", required=True, help="Parquet file that write has written")
    compare.add_argument("--found", nargs=len(RULES), required=True, help=f"by the rules {', '.join(RULES)}")
    compare.add_argument("--records", required=True, help="Parquet file of the cut-ins found by the default")
    compare.add_argument("--output", required=True, help="CSV file of the comparison")
    for command in (write, compare):
        command.add_argument("--recorded", type=float, required=True, help="hours that are recorded")
    arguments = parser.parse_args()
    if arguments.command == "drive":
        cut_ins = simulate(*named_part(arguments)).cut_ins()
        with atomic_path(arguments.output) as temporary:
            cut_ins.query("counts").drop(columns="counts").to_parquet(temporary, index=False)
        return
    minutes = recorded_minutes(arguments.hours, arguments.recorded)
    if arguments.command == "write":
        motorway, part = named_part(arguments)
        found = simulate(motorway, part)
        write_recordings(arguments.folder, found, minutes)
        with atomic_path(arguments.known) as temporary:
            in_minutes(found.cut_ins(), minutes).to_parquet(temporary, index=False)
        return
    known, found = pd.read_parquet(arguments.known), map(pd.read_parquet, arguments.found)
    results = [compared(known, in_minutes(each, minutes)) for each in found]
    with atomic_path(arguments.records) as temporary:
        results[0][0].to_parquet(temporary, index=False)
    rows = [
        {"world": arguments.world, "rule": rule} | row for rule, (_, row) in zip(RULES, results, strict=True)
    ]
    write_csv(arguments.output, pd.DataFrame(rows))


if __name__ == "__main__":
    run_command(main)
