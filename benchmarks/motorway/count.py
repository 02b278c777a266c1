"""Count the crashes of hosts in a world, and predict them cut-in by cut-in."""

import argparse

import numpy as np
import pandas as pd
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.motion import MOTIONS, LeadMotion, draw_lead_speeds
from accelerated_evaluation.laws.motion.recorded import FEWEST as FEWEST_COURSES
from accelerated_evaluation.laws.motion.recorded import Recorded, recorded_courses
from hosts import encounters_of, hosts
from traffic import run_command

RANGES = (0.0, 15.0, 35.0, 75.0, 150.0)  # [m], edges of the cells
COURSES = 2  # drawn for each cut-in by each law of lead motion
CHUNK = 20_000  # cut-ins in memory at a time
FEWEST = 10  # counted crashes from which a ratio is shown
KEYS = ["host", "gap", "range_from", "range_to"]


def crashes(
    cut_ins: pd.DataFrame, motions: dict[str, LeadMotion], generator: np.random.Generator
) -> pd.DataFrame:
    """Count and predict the crashes of all hosts, cut-in by cut-in.

    Parameters
    ----------
    cut_ins
        Cut-ins with courses of the other cars, n rows.
    motions
        Laws of lead motion, by name.
    generator
        Source of all randomness. All hosts drive behind the same drawn courses.

    Returns
    -------
    pandas.DataFrame
        A row for each host and cut-in: ``host``; whether it crashes behind the recorded course (``counted``)
        and behind a constant speed (``snapshot``); and for each law of lead motion the share of drawn courses
        behind which it crashes. The index is that of ``cut_ins``.
    """
    given, recorded = encounters_of(cut_ins), recorded_courses(cut_ins)
    cars, parts = hosts(generator), {}
    for host, car in cars.items():
        outcomes = {
            "counted": car.simulate_moving(*given, recorded).crash,
            "snapshot": car.simulate(*given).crash,
        }
        parts[host] = pd.DataFrame(outcomes, index=cut_ins.index).astype(float)
        parts[host][list(motions)] = 0.0
    for name, motion in motions.items():
        for _ in range(COURSES):
            speeds = draw_lead_speeds(motion, given, generator)
            for host, car in cars.items():
                parts[host][name] += car.simulate_moving(*given, speeds).crash / COURSES
    return pd.concat([part.assign(host=host) for host, part in parts.items()])


def cells(cut_ins: pd.DataFrame) -> pd.DataFrame:
    """Return the sign of the closing speed and the cell of the range of each cut-in."""
    index = np.searchsorted(RANGES, cut_ins["range"].to_numpy(), side="left") - 1
    gap = np.where(cut_ins["closing_speed"] > 0, "closing", "opening")
    edges: dict[str, Array] = {"range_from": np.take(RANGES, index), "range_to": np.take(RANGES, index + 1)}
    return pd.DataFrame({"gap": gap} | edges, index=cut_ins.index)


def counted(
    cut_ins: pd.DataFrame, motions: dict[str, LeadMotion], generator: np.random.Generator
) -> pd.DataFrame:
    """Return sums of `crashes`, and the number of ``cut_ins``, for each host and cell of the cut-ins."""
    cut_ins = cut_ins.reset_index(drop=True)
    place, sums = cells(cut_ins), []
    for first in range(0, len(cut_ins), CHUNK):
        part = crashes(cut_ins.iloc[first : first + CHUNK], motions, generator)
        sums.append(part.join(place).assign(cut_ins=1).groupby(KEYS, as_index=False).sum())
    table = pd.concat(sums).groupby(KEYS, as_index=False).sum()
    return table[[*KEYS, "cut_ins", "counted", "snapshot", *motions]]


def summed(parts: list[pd.DataFrame]) -> pd.DataFrame:
    """Add up the counts of all worlds, with the ratio of each prediction to the count."""
    groups = pd.concat(parts).groupby(KEYS, sort=False)
    # A prediction that could not be made in one world is unknown in the sum.
    table = groups.sum().where(groups.count().eq(groups.size(), axis=0)).reset_index()
    predictions = table.columns[table.columns.get_loc("counted") + 1 :]
    enough = table["counted"].where(table["counted"] >= FEWEST)
    ratios = {f"{name}_to_counted": (table[name] / enough).round(3) for name in predictions}
    return table.round(2).assign(**ratios)


def main() -> None:
    """Count the crashes of one world, or join the tables of all worlds."""
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(required=True, dest="command")
    count = commands.add_parser("count", help="crashes in the cells of one world")
    count.add_argument("cut_ins", nargs="+", help="Parquet files of the world")
    count.add_argument("--records", required=True, help="Parquet file of other cut-ins, for the lead motion")
    count.add_argument("--seed", type=int, required=True, help="root of all random numbers")
    count.add_argument("--world", type=int, required=True, help="number of the world")
    for name, help_ in (("sum", "add up the counts of all worlds"), ("join", "join tables of worlds")):
        commands.add_parser(name, help=help_).add_argument(
            "tables", nargs="+", help="CSV files of the worlds"
        )
    for command in commands.choices.values():
        command.add_argument("--output", required=True)
    arguments = parser.parse_args()
    if arguments.command == "count":
        cut_ins = pd.concat(map(pd.read_parquet, arguments.cut_ins), ignore_index=True)
        if cut_ins.empty:
            raise InputError(
                f"world {arguments.world}",
                seen="no cut-in in front of a car",
                expected="traffic in which vehicles change lanes",
                change="Simulate more hours, or change the flow or the share of lorries in the settings.",
            )
        motions: dict[str, LeadMotion] = {"ngsim": MOTIONS["ngsim"]()}
        records = pd.read_parquet(arguments.records)
        if len(records) >= FEWEST_COURSES:
            motions["recorded"] = Recorded.of(records, arguments.records)
        generator = child_generator(arguments.seed, "motorway", "count", arguments.world)
        table = counted(cut_ins, motions, generator).assign(
            **dict.fromkeys({"recorded"} - set(motions), np.nan)
        )
    else:
        parts = [pd.read_csv(path) for path in arguments.tables]
        table = summed(parts) if arguments.command == "sum" else pd.concat(parts, ignore_index=True)
    write_csv(arguments.output, table)


if __name__ == "__main__":
    run_command(main)
