"""The ratio of two vehicles from few runs (`estimate --against`), compared with that of their crash maps.

    python benchmarks/answers/pairs.py results/spmd pairs.csv [--seeds 0 1]

The laws and the probabilities by the maps are those of a finished study. In a seed, each vehicle is estimated
once as the old one, and each pair once, from the runs of the old vehicle if the two are similar.
"""

import argparse
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
from accelerated_evaluation.answer.study_tables import UNDER_TEST
from accelerated_evaluation.answer.ways.answer import Answer, evaluate
from accelerated_evaluation.answer.ways.by_few_runs import FewRuns, runs_to_begin_with
from accelerated_evaluation.answer.ways.comparison import compare, ratios
from accelerated_evaluation.answer.ways.posterior import Posterior
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.draws import as_draws
from accelerated_evaluation.methods.problem import Problem, read_law_of
from accelerated_evaluation.publishing.tables.display import reproducible
from accelerated_evaluation.records.segments import read_encounters
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.vehicles import load_vehicle
from tqdm import tqdm

ROOT = 2026  # root of all randomness
VEHICLES = {"acc_aeb": UNDER_TEST} | {name: name for name in ("acc_only", "cc_human", "fsm", "rss", "reg157")}
STEP = 5  # every fifth draw of the law is used, which changes no ratio
ENDS = (0.1, 0.9)


def row_of(own: Posterior, other: Posterior, exact: Array) -> dict[str, float]:
    """Return how a ratio from few runs compares with the exact ratio under each draw, shape (K,).

    ``covered`` is the share of the draws in which the 80 % interval of the sampling contains the exact ratio;
    ``widened`` how much wider the whole interval is than that of the exact ratios, in logarithms, and ``law``
    how much wider it is without the sampling.
    """
    middle = ratios(own, other)[1].reshape(exact.size, -1)
    known = ~np.broadcast_to(own.unknown | other.unknown, exact.shape)
    low, high = np.quantile(middle, ENDS, axis=1)
    found, ends = compare(own, other), np.quantile(exact, ENDS)
    width = np.log(found["ratio_high80"] / found["ratio_low80"]) / np.log(ends[1] / ends[0])
    covered = ((low <= exact) & (exact <= high))[known].mean()
    off = np.log(found["ratio"] / np.median(exact))
    alone = np.quantile((own.alone.probabilities / other.alone.probabilities)[known], ENDS)
    law = np.log(alone[1] / alone[0]) / np.log(ends[1] / ends[0])
    row = {"exact": float(np.median(exact)), "off": off, "covered": covered}
    return row | {"widened": width - 1, "law": law - 1}


def main() -> None:
    """Write a row for each pair and seed, and print what they have in common."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("study", type=Path, help="folder of a finished study")
    parser.add_argument("output", type=Path, help="table to write")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1], help="default: 0 1")
    arguments = parser.parse_args()
    records = read_encounters(arguments.study / "encounters.parquet")
    draws = as_draws(read_law_of(CUT_IN, str(arguments.study / "laws/draws.json"), records))
    chosen = np.arange(0, draws.size, STEP)
    draws = draws.subset(chosen)
    table = pd.read_csv(arguments.study / "laws/vehicle_draws.csv").set_index("vehicle")["probability"]
    problems = {name: Problem(CUT_IN, load_vehicle(name), law=draws.proposal) for name in VEHICLES}
    rows = []
    for seed in tqdm(arguments.seeds):
        olds: dict[str, Answer] = {
            name: evaluate(problem, draws, FewRuns(), generator=child_generator(ROOT, "old", name, seed))
            for name, problem in problems.items()
        }
        for pair in combinations(VEHICLES, 2):
            new, old = pair if seed % 2 == 0 else pair[::-1]
            way = FewRuns(predecessor=runs_to_begin_with(olds[old], problems[new]))
            generator = child_generator(ROOT, "new", new, old, seed)
            found = evaluate(problems[new], draws, way, generator=generator)
            exact = table[VEHICLES[new]].to_numpy()[chosen] / table[VEHICLES[old]].to_numpy()[chosen]
            row = {"new": new, "old": old, "seed": seed, "similar": way.predecessor is not None}
            row |= row_of(found.posterior, olds[old].posterior, exact)
            row |= {"simulations": found.simulations, "of_old": olds[old].simulations}
            rows.append(row | {"alone": olds[new].simulations})
        runs = pd.DataFrame(rows)
        write_csv(arguments.output, reproducible(runs))
    print(runs.groupby("similar")[["covered", "widened", "simulations", "of_old", "alone"]].mean())
    print(f"covered {runs['covered'].mean():.2f}, off {np.sqrt((runs['off'] ** 2).mean()):.2f}")


if __name__ == "__main__":
    main()
