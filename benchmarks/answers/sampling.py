"""Whether the stated sampling error of an answer from few runs covers, for several sets of records.

``run`` appends a row per replicate to a table, so that it can be stopped and continued. ``tabulate`` sums it
up: a row for each set of records. The crash map of the vehicle gives the exact probability under the same
draws of the law.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from accelerated_evaluation import choose_draws, read_records
from accelerated_evaluation.answer.answer import evaluate
from accelerated_evaluation.answer.by_few_runs import FewRuns
from accelerated_evaluation.answer.choice import ANSWER
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.smooth.family import Fitter, Member, members_at
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.publishing.tables.display import reproducible
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.configuration import load, resolved
from run import by_map, vehicle_named
from scipy.special import stdtrit
from tqdm import tqdm

sys.path.append(str(Path(__file__).resolve().parents[1] / "worlds"))

from kinds import LEVEL, TwoKindsOfDrivers
from setting import distinct_records

ROOT = 57  # root of all randomness
VEHICLE = "acc_aeb"
SYNTHETIC = 40_000  # number of synthetic records
LEVELS = (0.8, 0.95)  # of the intervals of the sampling alone


def configuration(records: str, folder: Path) -> dict[str, Any]:
    """Return the configuration of a set of records by its name; synthetic records are written to a folder."""
    if records.startswith("spmd"):
        sample = {"sample": 1000 * int(records[4:-1]), "spmd": {"outlier_rows": []}}
        return load(given={"study": records, "data": sample})
    path = folder / "synthetic.csv"
    synthetic_records().to_csv(path, index=False)
    table = {"source": "table", "table": {"description": "synthetic records", "path": str(path)}}
    filters = {"lead_speed_min": 5, "lead_speed_max": 35, "range_max": 75}
    segments = {"lead_speed_edges": [5, 15, 25, 35]}
    given = {"study": "synthetic", "data": table, "filters": filters, "segments": segments}
    return resolved(load(given=given))


def synthetic_records() -> pd.DataFrame:
    """Draw records of two kinds of drivers, as in the worlds of this name."""
    recorded, _ = distinct_records(pd.read_parquet(load()["data"]["spmd"]["path"]))
    family = Fitter(recorded, members_at((LEVEL,))).fit()
    world = TwoKindsOfDrivers(family, family.law(Member(LEVEL, "exponential")))
    generator = np.random.default_rng(ROOT)
    drawn = world.draw(generator.choice(recorded.lead_speed, SYNTHETIC), generator)
    columns = drawn.lead_speed, np.minimum(drawn.range_, 75.0), drawn.closing_speed
    return pd.DataFrame(dict(zip(("lead_speed", "range", "closing_speed"), columns, strict=True)))


def run(records: str, replicates: int, output: Path) -> None:
    """Append the rows of the replicates that a table does not have yet."""
    config = configuration(records, output.parent)
    known_records = read_records(config)
    draws = choose_draws(ANSWER, known_records, config)
    exact = by_map(VEHICLE, config, known_records, draws)
    problem, way = (
        Problem(CUT_IN, vehicle_named(VEHICLE, config), law=draws.proposal),
        FewRuns.configured(config),
    )
    rows = pd.read_csv(output).to_dict("records") if output.exists() else []
    for seed in tqdm(range(len(rows), replicates), desc=records, unit=" replicates"):
        generator = child_generator(ROOT, "verify", records, seed)
        found = evaluate(problem, draws, way, generator=generator)
        row = {"records": records, "seed": seed, "runs": found.simulations}
        if (posterior := found.posterior) is not None:
            row |= {
                "log_median": np.log(np.median(posterior.whole.probabilities) / np.median(exact)),
                "log_ratio": np.log(posterior.probabilities / exact).mean(),
                "stated": posterior.deviation,
                "batches": posterior.batches,
            }
        rows.append(row)
        write_csv(output, pd.DataFrame(rows))


def tabulate(runs: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each set of records: the spread of the logarithms, the stated error, and the coverage.

    The probability is covered at a level if (estimate / probability - 1) is at most the stated error times
    the quantile of Student's t distribution.
    """
    rows = []
    for records, of_records in runs.groupby("records", sort=False):
        error = np.expm1(of_records["log_ratio"]).abs() / of_records["stated"]
        row = {"records": records, "replicates": len(of_records), "runs": of_records["runs"].mean()}
        for name in ("log_median", "log_ratio", "stated"):
            row[f"{name}_rms"] = np.sqrt((of_records[name] ** 2).mean())
        for level in LEVELS:
            reach = stdtrit(of_records["batches"] - 1, (1 + level) / 2)
            row[f"covers{100 * level:.0f}"] = int((error <= reach).sum())
        rows.append(row)
    return pd.DataFrame(rows)


def main() -> None:
    """Run or tabulate."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    steps = parser.add_subparsers(dest="step", required=True)
    one = steps.add_parser("run", help="append rows to a table, one per replicate")
    one.add_argument("records", help="spmd20k for a sample of 20,000 records, or synthetic")
    one.add_argument("--replicates", type=int, required=True)
    summed = steps.add_parser("tabulate", help="sum up such tables")
    summed.add_argument("runs", nargs="+")
    for step in (one, summed):
        step.add_argument("--output", type=Path, required=True)
    arguments = parser.parse_args()
    if arguments.step == "run":
        run(arguments.records, arguments.replicates, arguments.output)
    else:
        runs = pd.concat(map(pd.read_csv, arguments.runs), ignore_index=True)
        write_csv(arguments.output, reproducible(tabulate(runs)))


if __name__ == "__main__":
    main()
