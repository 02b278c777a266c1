"""Count the crashes of hosts in a world, and predict them from the same cut-ins.

A host takes the place of the car behind at the moment of the cut-in, and drives behind the recorded course of
the other car. The other car does not react to it, so this is the same as driving in the running world.
"""

import argparse

import numpy as np
import pandas as pd
from accelerated_evaluation.answer.scored_family import score_family
from accelerated_evaluation.answer.weighted_family import WeightedLaws
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.mapping import map_crashes
from accelerated_evaluation.crash_map.maps import Grid
from accelerated_evaluation.laws.motion import MOTIONS, STATES, STEP, LeadMotion, draw_lead_speeds
from accelerated_evaluation.laws.smooth.family import DistinctRecords, members_at
from accelerated_evaluation.laws.smooth.support import SUPPORT
from accelerated_evaluation.vehicles import load_vehicle
from accelerated_evaluation.vehicles.builtin.moving import MovingVehicle
from scipy.stats import poisson
from traffic import NAMES, SAMPLED, run_command

ROOT = 2026  # root of all randomness
# The hosts; the last one is poor on purpose: it brakes late and weakly, and has no emergency braking.
HOSTS = {
    "acc_aeb": ("acc_aeb", {}),
    "acc_only": ("acc_only", {}),
    "cc_human": ("cc_human", {}),
    "poor": ("acc_only", {"acc_limit": 2.0, "headway": 1.0}),
}
PREDICTIONS = ["counted", "snapshot", "motion"]
COURSES = 20  # drawn for each cut-in
AWAY = 100.0  # [m/s]
RANGES = (0.0, 15.0, 35.0, 75.0, 150.0)  # [m], edges of the cells
CHUNK = 20_000  # cut-ins in memory at a time
FEWEST = 10  # counted crashes from which a ratio is shown
SHARE = 4  # one of so many cut-ins is recorded by the study of the whole chain
DRAWS = 500
MEMBERS = members_at((0.9, 0.95, 0.98))  # fewer thresholds than in the study, to save time
GRID = {"lead_speed_cells": 30, "range_cells": 60, "refinement": 12}
GRID |= {"closing_speed_max": 40.0, "closing_speed_points": 120, "range_max": SUPPORT.range_max}
GRID |= dict(zip(("lead_speed_min", "lead_speed_max"), SUPPORT.lead_speeds, strict=True))


def lead_speeds(cut_ins: pd.DataFrame) -> Array:
    """Return the recorded speeds of the other cars every 0.1 s [m/s], shape (n, STATES).

    A car that has left the lane, or that is not seen any more, cannot be hit. It drives away at a high speed.
    """
    courses = cut_ins.filter(like="speed_").to_numpy(dtype=float)
    times = np.arange(STATES) * STEP
    low = np.minimum((times / SAMPLED).astype(int), courses.shape[1] - 2)
    speeds = courses[:, low] + (courses[:, low + 1] - courses[:, low]) * (times / SAMPLED - low)
    speeds[:, 0] = cut_ins["lead_speed"]
    gone = times[1:] > cut_ins["seen"].to_numpy()[:, None] + STEP / 2
    speeds[:, 1:][gone] = AWAY
    return speeds


def crashes(
    car: MovingVehicle, cut_ins: pd.DataFrame, motion: LeadMotion, generator: np.random.Generator
) -> dict[str, Array]:
    """Count and predict the crashes of a host, cut-in by cut-in.

    Returns
    -------
    dict
        Whether it crashes behind the recorded course (``counted``) and behind a constant speed
        (``snapshot``), and the share of drawn courses behind which it crashes (``motion``), shape (n,).
    """
    given = [cut_ins[name].to_numpy() for name in NAMES]
    drawn = [
        car.simulate_moving(*given, draw_lead_speeds(motion, np.stack(given), generator)).crash
        for _ in range(COURSES)
    ]
    return {
        "counted": car.simulate_moving(*given, lead_speeds(cut_ins)).crash,
        "snapshot": car.simulate(*given).crash,
        "motion": np.mean(drawn, axis=0),
    }


def cells(cut_ins: pd.DataFrame) -> tuple[Array, Array]:
    """Return the sign of the closing speed and the cell of the range of each cut-in."""
    closing = np.where(cut_ins["closing_speed"] > 0, "closing", "opening")
    return closing, np.searchsorted(RANGES, cut_ins["range"].to_numpy(), side="left") - 1


def counted(cut_ins: pd.DataFrame, generator: np.random.Generator) -> pd.DataFrame:
    """Count the crashes of every host, and predict them from what is known when the other car cuts in.

    Returns
    -------
    pandas.DataFrame
        A row for each host, sign of the closing speed and cell of the range: ``host``, ``gap``,
        ``range_from`` and ``range_to`` [m], ``cut_ins``, and the sums of `crashes`.
    """
    gap, cell = cells(cut_ins)
    motion = MOTIONS["ngsim"]()
    rows = []
    for host, (name, parameters) in HOSTS.items():
        car = load_vehicle(name, **parameters)
        parts = [
            pd.DataFrame(crashes(car, cut_ins.iloc[first : first + CHUNK], motion, generator))
            for first in range(0, len(cut_ins), CHUNK)
        ]
        table = pd.concat(parts, ignore_index=True).assign(gap=gap, cell=cell, cut_ins=1)
        rows.append(table.groupby(["gap", "cell"], as_index=False).sum().assign(host=host))
    result = pd.concat(rows, ignore_index=True)
    for name, shift in (("range_from", 0), ("range_to", 1)):
        result[name] = np.take(RANGES, result["cell"] + shift)
    return result[["host", "gap", "range_from", "range_to", "cut_ins", *PREDICTIONS]]


def chain(cut_ins: pd.DataFrame, generator: np.random.Generator) -> pd.DataFrame:
    """Predict the count from a quarter of the cut-ins, as a study would: laws, answer, interval.

    Only cut-ins that the study's filters keep are counted: the gap closes, and range and lead speed are
    within the limits.

    Returns
    -------
    pandas.DataFrame
        A row for each host: ``recorded`` cut-ins, ``cut_ins`` and ``counted`` in the others, ``median``,
        and the ends of the 80 and 95 % intervals of the predicted count, which include Poisson variation.
    """
    kept = cut_ins[
        (cut_ins["closing_speed"] > 0)
        & (cut_ins["range"] < SUPPORT.range_max)
        & cut_ins["lead_speed"].between(*SUPPORT.lead_speeds, "left")
    ]
    recorded = generator.permutation(len(kept)) < len(kept) // SHARE
    sample, rest = kept[recorded], kept[~recorded]
    records = DistinctRecords.of(sample)
    weighted = WeightedLaws.drawn(score_family(records, MEMBERS), generator, DRAWS)
    rows = []
    for host, (name, parameters) in HOSTS.items():
        car = load_vehicle(name, **parameters)
        mapped = map_crashes(car, Grid(**GRID), [], generator)
        lines = CrashLines.of(mapped, records.lead_speed)
        posterior = weighted.draw({"crash": weighted.thinned(lines, generator)}, generator)["crash"]
        expected = posterior.probabilities * len(rest)
        possible = poisson.rvs(expected, random_state=generator)
        found = car.simulate_moving(*(rest[column].to_numpy() for column in NAMES), lead_speeds(rest)).crash
        ends = np.quantile(possible, [0.025, 0.1, 0.5, 0.9, 0.975])
        row = dict(zip(("low95", "low80", "median", "high80", "high95"), ends, strict=True))
        rows.append(
            {"host": host, "recorded": len(sample), "cut_ins": len(rest), "counted": found.sum()} | row
        )
    return pd.DataFrame(rows)


def summed(parts: list[pd.DataFrame]) -> pd.DataFrame:
    """Add up the counts of all worlds, with their ratio."""
    keys = ["host", "gap", "range_from", "range_to"]
    table = pd.concat(parts).groupby(keys, sort=False, as_index=False).sum()
    enough = table["counted"].where(table["counted"] >= FEWEST)
    ratios = {f"{name}_to_counted": (table[name] / enough).round(3) for name in PREDICTIONS[1:]}
    return table.assign(**ratios)


def main() -> None:
    """Count the crashes of one world, predict them by the whole chain, or sum up."""
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(required=True, dest="command")
    for name, help_ in (("count", "crashes in the cells"), ("chain", "the count and its prediction")):
        command = commands.add_parser(name, help=help_)
        command.add_argument("cut_ins", nargs="+", help="Parquet files of one world")
        command.add_argument("--world", type=int, required=True, help="number of the world")
        command.add_argument("--output", required=True)
    for name, help_ in (("sum", "add up the counts of all worlds"), ("join", "join tables of worlds")):
        command = commands.add_parser(name, help=help_)
        command.add_argument("tables", nargs="+", help="CSV files of the worlds")
        command.add_argument("--output", required=True)
    arguments = parser.parse_args()
    if arguments.command in ("sum", "join"):
        parts = [pd.read_csv(path) for path in arguments.tables]
        table = summed(parts) if arguments.command == "sum" else pd.concat(parts, ignore_index=True)
    else:
        cut_ins = pd.concat(map(pd.read_parquet, arguments.cut_ins), ignore_index=True)
        generator = child_generator(ROOT, "motorway", arguments.command, arguments.world)
        table = (counted if arguments.command == "count" else chain)(cut_ins, generator)
        if arguments.command == "chain":
            table.insert(0, "world", arguments.world)
    write_csv(arguments.output, table)


if __name__ == "__main__":
    run_command(main)
