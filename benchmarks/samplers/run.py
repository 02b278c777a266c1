"""Run one method on one problem with some seeds, and write what each gave."""

import argparse
import importlib
import time
from dataclasses import asdict

import pandas as pd
from accelerated_evaluation.files import write_csv
from accelerated_evaluation.randomness import child_generator
from house import house
from methods import HOUSE, LIMITS, PEERS, Target
from problems import problems

ROOT = 2016  # root of all randomness, as in the study


def main() -> None:
    """Write a table with a row a seed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("problem")
    parser.add_argument("method")
    parser.add_argument("--seeds", type=int, nargs=2, metavar=("FIRST", "END"), required=True)
    parser.add_argument("--output", required=True)
    arguments = parser.parse_args()
    name, method = arguments.problem, arguments.method
    # The public tools are installed for this benchmark alone, so they are imported only if they are run.
    estimate = house(method) if method in HOUSE else getattr(importlib.import_module(PEERS[method]), method)
    target = Target(maximum_simulations=LIMITS.get(method, Target.maximum_simulations))
    rows = []
    for seed in range(*arguments.seeds):
        start = time.perf_counter()
        outcome = estimate(problems()[name], child_generator(ROOT, name, method, seed), target)
        seconds = time.perf_counter() - start
        labels = {"problem": name, "method": method, "seed": seed}
        rows.append(labels | asdict(outcome) | {"seconds": round(seconds, 3)})
    write_csv(arguments.output, pd.DataFrame(rows))


if __name__ == "__main__":
    main()
