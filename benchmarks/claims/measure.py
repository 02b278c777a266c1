"""Short measurements for the claims of the README that no other benchmark script makes in a few minutes.

``vehicle`` repeats the published outcomes of the car under test. ``successor`` counts the simulations for
variants of the car with and without the runs of the original. ``estimate`` counts those of whole answers.
"""

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

import pandas as pd
from accelerated_evaluation import choose_draws, read_records
from accelerated_evaluation.answer.ways.answer import evaluate
from accelerated_evaluation.answer.ways.by_few_runs import FewRuns
from accelerated_evaluation.answer.ways.choice import ANSWER
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.methods.surrogate import Surrogate
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.configuration import load
from accelerated_evaluation.vehicles import load_vehicle
from accelerated_evaluation.vehicles.protocol import events_of
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "samplers"))

ROOT = 2027  # root of all randomness, another one than that of the published benchmarks
VEHICLE = "acc_aeb"


def vehicle(verdicts: Path) -> pd.DataFrame:
    """Return how many published outcomes there are, and how many the simulator repeats."""
    published = pd.read_parquet(verdicts)
    columns = [published[name].to_numpy() for name in ("lead_speed", "range", "closing_speed")]
    same = load_vehicle(VEHICLE).simulate(*columns).crash == (published["crash"] == 1)
    return pd.DataFrame({"published": [len(published)], "repeated": [int(same.sum())]})


def successor(seeds: Iterable[int]) -> pd.DataFrame:
    """Return the simulations for every variant of the car, with the runs of the original and without."""
    from successors import VARIANTS, pair

    tasks = [(name, seed) for seed in seeds for name in VARIANTS]
    rows = pd.DataFrame([pair(*task, ROOT) for task in tqdm(tasks, desc="variants", unit=" variants")])
    return rows[["variant", "seed", "simulations", "simulations_alone"]]


def estimate(seeds: Iterable[int]) -> pd.DataFrame:
    """Return the table of the whole answer for the car under test, with the simulations, for every seed."""
    config = load()
    draws = choose_draws(ANSWER, read_records(config), config)
    problem = Problem(CUT_IN, load_vehicle(VEHICLE), law=draws.proposal)
    way = FewRuns(Surrogate.stopping(config), config["surrogate"]["batch_size"])
    events, tables = events_of(CUT_IN, config["answer"]["events"]), []
    for seed in tqdm(seeds, desc="whole answers", unit=" seeds"):
        generator = child_generator(ROOT, "estimate", seed)
        found = evaluate(problem, draws, way, events, generator=generator)
        tables.append(found.table().assign(seed=seed, simulations=found.simulations))
    return pd.concat(tables, ignore_index=True)


def main() -> None:
    """Make one measurement, and write its table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("measurement", choices=["vehicle", "successor", "estimate"])
    parser.add_argument("--verdicts", type=Path, help="table of published outcomes, for vehicle")
    parser.add_argument("--seeds", type=int, nargs=2, metavar=("FIRST", "COUNT"), default=(0, 1))
    parser.add_argument("--output", type=Path, required=True)
    arguments = parser.parse_args()
    first, count = arguments.seeds
    if arguments.measurement == "vehicle":
        table = vehicle(arguments.verdicts)
    else:
        table = {"successor": successor, "estimate": estimate}[arguments.measurement](
            range(first, first + count)
        )
    write_csv(arguments.output, table)


if __name__ == "__main__":
    main()
