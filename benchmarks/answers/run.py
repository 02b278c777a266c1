"""The whole answer from few simulations, compared with the posterior of a crash map.

``run`` appends a row per seed to a table, so that it can be stopped and continued. ``tabulate`` sums up such
tables: a row per vehicle.
"""

import argparse
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from accelerated_evaluation import choose_draws, read_records
from accelerated_evaluation.answer.candidates.fitted_records import FittedRecords
from accelerated_evaluation.answer.ways.answer import evaluate
from accelerated_evaluation.answer.ways.by_few_runs import FewRuns
from accelerated_evaluation.answer.ways.by_map import Map
from accelerated_evaluation.answer.ways.choice import ANSWER
from accelerated_evaluation.answer.ways.posterior import SampledPosterior
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.mapping import map_crashes
from accelerated_evaluation.crash_map.maps import Grid
from accelerated_evaluation.laws.draws import Draws
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.methods.surrogate import Surrogate
from accelerated_evaluation.publishing.tables.display import reproducible
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.configuration import load
from accelerated_evaluation.study.preflight import compared_sections
from accelerated_evaluation.vehicles import Vehicle, load_vehicle
from tqdm import tqdm

ROOT = 2026  # root of all randomness
LIMITS = ("lead_speed_min", "lead_speed_max", "range_max")
LEVELS = {"low95": 0.025, "low80": 0.1, "median": 0.5, "high80": 0.9, "high95": 0.975}
ENDS = {"low50": 0.25, "high50": 0.75} | LEVELS
REFERENCE = "cc_human"


def vehicle_named(name: str, config: dict) -> Vehicle:
    """Return a vehicle of a study, by its name."""
    sections = [config["vehicle"], *compared_sections(config["compared_vehicles"]).values()]
    parameters = next(section["parameters"] for section in sections if section["name"] == name)
    return load_vehicle(name, **parameters)


def by_map(name: str, config: dict, records: FittedRecords, draws: Draws) -> Array:
    """Return the crash probability of a vehicle under each draw of the law, from its crash map."""
    grid = Grid(**{key: config["filters"][key] for key in LIMITS}, **config["answer"]["grid"])
    vehicle, generator = vehicle_named(name, config), partial(child_generator, ROOT, "answers")
    crashes = map_crashes(vehicle, grid, [], generator("map", name))
    problem = Problem(CUT_IN, vehicle, law=draws.proposal)
    answer = Map(crashes, records).answer(problem, draws, (), generator("lines", name))
    return answer.posterior.probabilities


def run(name: str, seeds: int, output: Path) -> None:
    """Append the rows of the seeds that a table does not have yet."""
    config = load()
    records = read_records(config)
    draws = choose_draws(ANSWER, records, config)
    known = by_map(name, config, records, draws)
    reference = known if name == REFERENCE else by_map(REFERENCE, config, records, draws)
    problem = Problem(CUT_IN, vehicle_named(name, config), law=draws.proposal)
    way = FewRuns(Surrogate.stopping(config), config["surrogate"]["batch_size"])
    rows = pd.read_csv(output).to_dict("records") if output.exists() else []
    for seed in tqdm(range(len(rows), seeds), desc=name, unit=" seeds"):
        generator = child_generator(ROOT, "answers", name, seed)
        found = evaluate(problem, draws, way, generator=generator)
        row = {"vehicle": name, "seed": seed, "runs": found.simulations, "converged": found.converged}
        rows.append(row | compared(found.posterior, known, reference))
        write_csv(output, pd.DataFrame(rows))


def compared(posterior: SampledPosterior | None, known: Array, reference: Array) -> dict[str, float]:
    """Return the logarithms of found over exact quantiles, and by how much the draws differ; {} for None."""
    if posterior is None:
        return {}
    values = posterior.whole.probabilities
    row = {f"few_{name}": np.quantile(values, level) for name, level in ENDS.items()}
    row |= {f"map_{name}": np.quantile(known, level) for name, level in ENDS.items()}
    row |= {name: np.log(row[f"few_{name}"] / row[f"map_{name}"]) for name in LEVELS}
    differences = np.log(posterior.probabilities / known)
    row |= {"shared": differences.mean(), "between_draws": differences.std(), "error": posterior.deviation}
    ratio = np.log(np.median(values / np.repeat(reference, values.size // reference.size)))
    return row | {"ratio": ratio - np.log(np.median(known / reference))}


def tabulate(runs: pd.DataFrame) -> pd.DataFrame:
    """Sum up the seeds of each vehicle: runs, and root mean squares and mean of logarithms."""
    rows = []
    for name, of_vehicle in runs.groupby("vehicle", sort=False):
        row = {"vehicle": name, "seeds": len(of_vehicle), "runs_mean": of_vehicle["runs"].mean()}
        row |= {"runs_p95": of_vehicle["runs"].quantile(0.95), "converged": of_vehicle["converged"].mean()}
        for column in (*LEVELS, "between_draws", "ratio"):
            row[column] = np.sqrt((of_vehicle[column] ** 2).mean())
        row |= {"median_bias": of_vehicle["median"].mean(), "median_bias_se": of_vehicle["median"].sem()}
        far = of_vehicle["median"].abs() > np.log(2)
        row["no_answer"] = of_vehicle["median"].isna().mean()
        rows.append(row | {"off_by_2": far.mean(), "silently": (far & of_vehicle["converged"]).mean()})
    return pd.DataFrame(rows)


def main() -> None:
    """Run or tabulate."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    steps = parser.add_subparsers(dest="step", required=True)
    one = steps.add_parser("run", help="append rows to a table, one per seed")
    one.add_argument("vehicle")
    one.add_argument("--seeds", type=int, required=True)
    summed = steps.add_parser("tabulate", help="sum up such tables")
    summed.add_argument("runs", nargs="+")
    for step in (one, summed):
        step.add_argument("--output", type=Path, required=True)
    arguments = parser.parse_args()
    if arguments.step == "run":
        run(arguments.vehicle, arguments.seeds, arguments.output)
    else:
        runs = pd.concat(map(pd.read_csv, arguments.runs), ignore_index=True)
        write_csv(arguments.output, reproducible(tabulate(runs)))


if __name__ == "__main__":
    main()
