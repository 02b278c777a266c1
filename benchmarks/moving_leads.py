"""Compute the crash probabilities with lead motion a second time, without a crash map and without strata.

    python benchmarks/moving_leads.py [STUDY] --output FILE.csv

A study draws lead speeds, ranges and motions where its crash maps say that they matter, and integrates the
closing speed by strata. Here, closing cut-ins are drawn from a wide density that knows no vehicle, motions
are drawn from their law, and opening cut-ins are recorded ones with motions of the law, whose crashes are
counted. The study has to be finished, in ``results/STUDY``. The columns are those of the table
``second_ways`` of a study.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from accelerated_evaluation.answer.candidates.fitted_records import stored_records
from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.candidates.smooth_family import SmoothFamily
from accelerated_evaluation.answer.consequences.lead_motion import FEWEST as FEWEST_RECORDED
from accelerated_evaluation.answer.consequences.lead_motion import mirrored
from accelerated_evaluation.answer.second_ways import CAP, Features, Key, Means, Plain, WideCutIns
from accelerated_evaluation.answer.settings import support_of
from accelerated_evaluation.answer.study_tables import UNDER_TEST
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.files import read_json, write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.motion import LeadMotion, draw_lead_speeds
from accelerated_evaluation.laws.motion.ngsim import Ngsim
from accelerated_evaluation.laws.motion.recorded import Recorded
from accelerated_evaluation.laws.smooth.draws import SmoothDraws
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.records.ingest import opening_cut_ins
from accelerated_evaluation.records.sources import read_source
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.preflight import compared_sections
from accelerated_evaluation.vehicles.moving import simulate_motion, takes_motion
from accelerated_evaluation.vehicles.named import all_loaded
from accelerated_evaluation.vehicles.protocol import Vehicle, inner_of, simulate_inner
from second_ways import compared

PROFILES = Path("data/europe/lead_motion.parquet")
FINER = 2  # times as many closing cut-ins as the second numbers of a study have
ROUNDS, SIZE = 100, 10_000  # rounds of opening cut-ins, and cut-ins in each
SAMPLING, COUNTS = "plain importance sampling", "counts of simulations"
FEWEST = 5.0  # smallest number of crashes of opening cut-ins that are compared


def crashes(
    vehicle: Vehicle, cut_ins: Array, motion: LeadMotion, inner: Array | None, generator: np.random.Generator
) -> Array:
    """Return 1 for each of n cut-ins, shape (3, n), that crashes behind a lead vehicle with this motion."""
    speeds = draw_lead_speeds(motion, cut_ins, generator)
    return simulate_motion(vehicle, tuple(cut_ins), speeds, inner).crash.astype(float)


def closing(
    vehicles: Mapping[str, Vehicle],
    motions: Mapping[str, LeadMotion],
    lead_speed: Array,
    law: SmoothDraws,
    generator: np.random.Generator,
) -> dict[Key, tuple[float, float]]:
    """Return the probabilities and factors of closing cut-ins, each with its standard error.

    They have the recorded lead speeds [m/s].
    """

    def features(x: Array) -> Features:
        for name, vehicle in vehicles.items():
            inner = inner_of(vehicle, len(x), generator)
            still = simulate_inner(vehicle, tuple(x.T), inner).crash.astype(float)
            moved = [crashes(vehicle, x.T, motion, inner, generator) for motion in motions.values()]
            yield name, np.column_stack([still, *moved]), None

    def made(means: Means) -> dict[Key, float]:
        numbers: dict[Key, float] = {}
        for name, ((still, *moved),) in means.items():
            found = dict(zip(motions, moved, strict=True))
            for table in ("lead_motion", "lead_motion_europe"):
                columns = {"exact": still, "constant": still, "moving": found[table]}
                columns["factor"] = found[table] / still
                numbers |= {(table, f"{name}, closing", column): each for column, each in columns.items()}
            numbers["lead_motion", f"{name}, closing", "factor_half"] = found["half"] / still
        return numbers

    wide = WideCutIns(lead_speed, law.support.range_max, CAP)
    return Plain.of(wide, partial(law.log_densities, cap=CAP), features, generator, FINER).numbers(made)


def opening(
    vehicles: Mapping[str, Vehicle],
    motions: Mapping[str, LeadMotion],
    recorded: DistinctRecords,
    generator: np.random.Generator,
) -> Iterator[tuple[Key, tuple[float, float]]]:
    """Yield the probability of a crash of recorded opening cut-ins, with its standard error."""
    cut_ins = np.array([recorded.lead_speed, recorded.range_, recorded.closing_speed])
    for name, vehicle in vehicles.items():
        for table in ("lead_motion", "lead_motion_europe"):
            count = 0.0
            for _ in range(ROUNDS):
                drawn = cut_ins[:, generator.integers(recorded.size, size=SIZE)]
                inner = inner_of(vehicle, SIZE, generator)
                count += crashes(vehicle, drawn, motions[table], inner, generator).sum()
            if count >= FEWEST:
                yield (
                    (table, f"{name}, opening", "moving"),
                    (count / ROUNDS / SIZE, count**0.5 / ROUNDS / SIZE),
                )


def read_study(study: Path) -> tuple[dict[str, Any], SmoothFamily, SmoothDraws]:
    """Return the configuration of a finished study, its smooth laws, and the law of the largest weight."""
    config = read_json(study / "config.json")
    support = support_of(CUT_IN, config).content()
    exposure = read_json(study / "exposure.json")
    records = stored_records(CUT_IN, study / "encounters.parquet", support, exposure)
    laws = partial(child_generator, config["seed"], "laws")
    whole = LawStudy.of_smooth(records, config["answer"]["draws"], laws, study / "laws" / "family.npz")
    smooth = whole.smooth
    ranges, speeds = smooth.family.ranges, smooth.speeds(whole.heaviest)
    return config, smooth, SmoothDraws.of_laws(ranges, [speeds], smooth.records.support)


def twice(study: Path, seed: int) -> pd.DataFrame:
    """Return the numbers of the tables of lead motion that have a second one, each with both."""
    config, smooth, law = read_study(study)
    stream = child_generator(config["seed"], "sample")
    kept = opening_cut_ins(read_source(config["data"], stream), config["data"], config["filters"])
    motions = {"lead_motion": Ngsim(), "half": Ngsim(0.5), "lead_motion_europe": Recorded.read(PROFILES)}
    sections = {UNDER_TEST: config["vehicle"], **compared_sections(config["compared_vehicles"])}
    generator = child_generator(seed, "second ways", "lead motion")
    recorded = DistinctRecords.of(kept, smooth.records.support)
    if recorded.size < FEWEST_RECORDED:
        recorded = mirrored(smooth.records)
    with all_loaded(sections, config["simulations"], CUT_IN, workers=1) as loaded:
        vehicles = {name: each for name, each in loaded.items() if takes_motion(each)}
        second = closing(vehicles, motions, smooth.records.lead_speed, law, generator)
        counted = dict(opening(vehicles, motions, recorded, generator))
    first = {}
    for table in ("lead_motion", "lead_motion_europe"):
        for row in pd.read_csv(study / f"{table}.csv").to_dict("records"):
            stated = {"moving": row["standard_error"]}
            stated |= {column: row[f"{column}_error"] for column in ("constant", "factor")}
            for column in ("exact", "constant", "moving", "factor", "factor_half"):
                if not np.isnan(row[column]):
                    key = table, f"{row['vehicle']}, {row['gap']}", column
                    first[key] = row[column], stated.get(column, np.nan)
    return compared(first, second | counted, lambda key: COUNTS if key in counted else SAMPLING)


def write_twice(description: str, numbers: Callable[[Path, int], pd.DataFrame]) -> None:
    """Compute numbers of the study that the command line names a second time, and write their table."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("study", nargs="?", default="spmd", metavar="STUDY")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--output", type=Path, required=True)
    given = parser.parse_args()
    write_csv(given.output, numbers(Path("results") / given.study, given.seed))


if __name__ == "__main__":
    write_twice(__doc__, twice)
