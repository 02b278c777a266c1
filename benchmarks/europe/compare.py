"""What the European cut-ins of data/europe say about the study, as a table.

python benchmarks/europe/compare.py results/spmd results/europe benchmarks/results/europe.csv
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from accelerated_evaluation import read_records
from accelerated_evaluation.answer.candidates.family_file import fit_or_read
from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.consequences.counted_crashes import (
    HUNDRED_CAR_MILES,
    KILOMETRES_PER_MILE,
    cut_in_rate,
)
from accelerated_evaluation.answer.consequences.moving_problem import MovingProblem
from accelerated_evaluation.answer.ways.extrapolation import exact_interval
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.mapping import map_crashes
from accelerated_evaluation.crash_map.maps import CrashMap, Grid
from accelerated_evaluation.laws.motion.recorded import Recorded
from accelerated_evaluation.laws.smooth.conditional import Places, SpeedLaw
from accelerated_evaluation.laws.smooth.draws import SmoothDraws
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.support import Support
from accelerated_evaluation.publishing.tables.display import reproducible
from accelerated_evaluation.study.configuration import load
from accelerated_evaluation.vehicles import Vehicle, load_vehicle
from scipy.stats import norm

DATA = Path(__file__).resolve().parents[2] / "data" / "europe"
LIMITS = ("lead_speed_min", "lead_speed_max", "range_max")
LEVEL = 0.95
RESPONSE = 0.75  # [s], time of the careful human of UN R157 until it brakes
FAST = 0.1  # probability of a closing speed that counts as fast
RESAMPLED = 20  # number of resampled tables of cut-ins
MOVING = ("acc_aeb", "cc_human")  # vehicles that are simulated with the European lead motion

Row = dict[str, str | float]


def mean_row(what: str, group: str, values: pd.Series) -> Row:
    """Return a row with the mean of the known values and its limits by the normal approximation."""
    known = values.dropna()
    error = norm.isf((1 - LEVEL) / 2) * known.std() / np.sqrt(len(known))
    mean = known.mean()
    return {
        "what": what,
        "group": group,
        "count": len(known),
        "value": mean,
        "low": mean - error,
        "high": mean + error,
    }


def share_row(what: str, group: str, happened: pd.Series) -> Row:
    """Return a row with a share and its exact limits (Clopper and Pearson 1934)."""
    count, size = int(happened.sum()), len(happened)
    low, high = exact_interval(count, size)
    return {"what": what, "group": group, "count": size, "value": count / size, "low": low, "high": high}


def of_cut_ins(cut_ins: pd.DataFrame, followed: pd.DataFrame) -> Iterator[Row]:
    """Yield the rows of what happened before and after the crossing, for all cut-ins and closing ones."""
    for group in ("all", "closing"):
        own, after = (
            table if group == "all" else table[table["closing_speed"] > 0] for table in (cut_ins, followed)
        )
        seen = own["seen"].dropna()
        yield mean_row("time from a drift of .375 m to the crossing [s]", group, seen)
        for level in (0.1, 0.9):
            row = {"what": f"the same, quantile {level:g} [s]", "group": group, "count": len(seen)}
            yield row | {"value": seen.quantile(level)}
        yield share_row(f"the same, share above {RESPONSE:g} s", group, seen > RESPONSE)
        yield mean_row("lateral speed at the crossing [m/s]", group, own["lateral_speed"])
        yield mean_row("change of the host's speed in the 2 s before [m/s]", group, own["host_change"])
        yield mean_row(
            "change of the lead speed in 5 s [m/s]", group, after["speed_5.0"] - after["lead_speed"]
        )


def of_closing_speeds(closing: pd.DataFrame, law: SpeedLaw, support: Support) -> Iterator[Row]:
    """Yield the rows that compare closing speeds with their distribution at the same speed and range.

    The cumulative hazard -log P(C > c) of a closing speed c has mean 1 if the law is right.
    """
    places = Places.of(closing["lead_speed"].to_numpy(), closing["range"].to_numpy(), support)
    hazard = pd.Series(law.given(places).cumulative(closing["closing_speed"].to_numpy()))
    yield mean_row("cumulative hazard of the closing speeds", "closing", hazard)
    yield share_row("share above the median of the law", "closing", hazard > np.log(2))
    yield share_row(f"share above the quantile {1 - FAST:g} of the law", "closing", hazard > -np.log(FAST))


def of_reaction(records: DistinctRecords, study: LawStudy, grid: Grid, per_kilometre: float) -> Iterator[Row]:
    """Yield the crashes of the careful human that reacts at the crossing, and of one that has reacted."""
    family, law = study.smooth.family, study.smooth.speeds(study.heaviest)
    kilometres = 1e6 * HUNDRED_CAR_MILES * KILOMETRES_PER_MILE
    for response in (RESPONSE, 0.0):
        human = load_vehicle("cc_human", reaction_time=response)
        lines = CrashLines.of(mapped(human, grid), records.lead_speed, support=records.support)
        row: Row = {"what": "crashes in two million miles", "group": f"cc_human, {response:g} s"}
        masses = lines.masses(SmoothDraws.of_laws(family.ranges, [law], records.support))
        expected = masses.sum() * per_kilometre * kilometres
        yield row | {"count": records.size, "value": expected}


def of_lead_motion(
    name: str, followed: pd.DataFrame, records: DistinctRecords, study: LawStudy, grid: Grid
) -> Row:
    """Return by which factor the European lead motion multiplies the crash probability of a vehicle.

    The limits are those of a log-normal distribution. Its deviation is that of the factors of resampled
    cut-ins, and contains the error of the simulation.
    """
    family, law, vehicle = study.smooth.family, study.smooth.speeds(study.heaviest), load_vehicle(name)
    generator = child_generator(load()["seed"], "europe", name)
    problem = MovingProblem(vehicle, mapped(vehicle, grid), records, family.ranges, law)

    def factor(cut_ins: pd.DataFrame) -> float:
        return problem.closing(Recorded.of(cut_ins), generator).factor()[0]

    found = factor(followed)
    resampled = [
        factor(followed.sample(frac=1, replace=True, random_state=generator)) for _ in range(RESAMPLED)
    ]
    wide = np.exp(norm.isf((1 - LEVEL) / 2) * np.log(resampled).std(ddof=1))
    row: Row = {"what": "factor of the European lead motion", "group": name, "count": len(followed)}
    return row | {"value": found, "low": found / wide, "high": found * wide}


def mapped(vehicle: Vehicle, grid: Grid) -> CrashMap:
    """Return the crash map of a vehicle that repeats itself."""
    return map_crashes(vehicle, grid, [], child_generator(0, "not used"))


def of_answer(answer: pd.DataFrame, count: int) -> Iterator[Row]:
    """Yield the rows of the crash probability from the European cut-ins alone."""
    crash = answer.set_index("event").loc["crash"]
    for level in (80, 95):
        row = {"what": f"crash of a closing cut-in, {level} %", "group": "acc_aeb", "count": count}
        yield row | {"value": crash["median"], "low": crash[f"low{level}"], "high": crash[f"high{level}"]}


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name in ("study", "europe", "table"):
        parser.add_argument(name, type=Path)
    given = parser.parse_args()
    answer = pd.read_csv(given.europe / "laws" / "answer.csv")
    rate = cut_in_rate(pd.read_csv(given.study / "laws" / "exposure.csv"))
    config = load()
    records = read_records(config).data
    generator = child_generator(config["seed"], "europe")
    family = fit_or_read(given.study / "laws" / "family.npz", records)
    study = LawStudy.of_family(family, config["answer"]["draws"], generator)
    grid = Grid(**{key: config["filters"][key] for key in LIMITS}, **config["answer"]["grid"])
    cut_ins, followed = pd.read_csv(DATA / "cut_ins.csv"), pd.read_parquet(DATA / "lead_motion.parquet")
    low, high, farthest = (config["filters"][key] for key in LIMITS)
    inside = cut_ins["lead_speed"].between(low, high, inclusive="left") & (cut_ins["range"] <= farthest)
    closing = cut_ins[inside & (cut_ins["closing_speed"] > 0)]
    rows = [
        *of_cut_ins(cut_ins, followed),
        *of_closing_speeds(closing, study.smooth.speeds(study.heaviest), records.support),
        *of_reaction(records, study, grid, rate),
        *(of_lead_motion(name, followed, records, study, grid) for name in MOVING),
        *of_answer(answer, len(closing)),
    ]
    write_csv(given.table, reproducible(pd.DataFrame(rows)))


if __name__ == "__main__":
    main()
