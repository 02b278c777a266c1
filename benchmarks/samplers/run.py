"""Run one method on one problem with some seeds, and write what each gave."""

import argparse
import importlib
import time
from collections.abc import Iterable
from dataclasses import asdict

import pandas as pd
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from house import house
from methods import HOUSE, LIMITS, Target
from problems import Problem, problems

ROOT = 2016  # root of all randomness, as in the study


def repeated(problem: Problem, method: str, seeds: Iterable[int]) -> pd.DataFrame:
    """Return what a method gave on a problem, and what it took, a row a seed.

    Parameters
    ----------
    problem
        The problem.
    method
        Of this project, or one of the public tools in ``methods.TOOLS``.
    seeds
        Each begins a sequence of random numbers of its own.
    """
    # The public tools are installed for this benchmark alone, so they are imported only if they are run.
    estimate = house(method) if method in HOUSE else getattr(importlib.import_module("peers"), method)
    target = Target(maximum_simulations=LIMITS.get(method, Target.maximum_simulations))
    rows = []
    for seed in seeds:
        start = time.perf_counter()
        outcome = estimate(problem, child_generator(ROOT, problem.name, method, seed), target)
        seconds = time.perf_counter() - start
        labels = {"problem": problem.name, "method": method, "seed": seed}
        rows.append(labels | asdict(outcome) | {"seconds": round(seconds, 3)})
    return pd.DataFrame(rows)


def main() -> None:
    """Write a table with a row a seed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("problem")
    parser.add_argument("method")
    parser.add_argument("--seeds", type=int, nargs=2, metavar=("FIRST", "END"), required=True)
    parser.add_argument("--output", required=True)
    arguments = parser.parse_args()
    problem = problems()[arguments.problem]
    write_csv(arguments.output, repeated(problem, arguments.method, range(*arguments.seeds)))


if __name__ == "__main__":
    main()
