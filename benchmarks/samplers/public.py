"""Problems of public collections, or with hidden parts: this project's sampler, and the best of OpenTURNS.

    make benchmark-public
    python benchmarks/samplers/public.py public.csv --raw FOLDER --seeds 10 --problems rp_22 rp_25

Raw results are kept, one table for each problem and method, so that an interrupted run continues with the
next seed. They do not say which version of the sampler made them, so use another folder after a change. The
methods ``nais`` and ``nais_25`` need OpenTURNS (``peers`` in pyproject.toml).
"""

import argparse
from pathlib import Path

import pandas as pd
from accelerated_evaluation.base.files import read_json, write_csv, write_json
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.publishing.tables.display import reproducible
from hidden_problems import group_of, hidden_problems, problems_with_near_parts
from problems import Problem
from public_problems import probability_of, public_problems
from run import ROOT, repeated
from summarise import summary
from tqdm import tqdm

COLLECTIONS = {"public": public_problems, "hidden": hidden_problems, "parts": problems_with_near_parts}
COLUMNS = [
    *("problem", "group", "method", "dimension", "reference", "reference_se", "published", "seeds"),
    *("calls_mean", "calls_p95", "error", "bias", "coverage80", "failed", "no_number", "claimed"),
]


def known(problem: Problem, raw: Path) -> tuple[float, float]:
    """Return the probability of a problem and its standard error, from the raw results where it is there."""
    path = raw / f"{problem.name}.json"
    if not path.exists():
        generator = child_generator(ROOT, "public reference", problem.name)
        probability, error = probability_of(problem, generator)
        write_json(path, {"probability": probability, "standard_error": error})
    content = read_json(path)
    return content["probability"], content["standard_error"]


def row(problem: Problem, method: str, raw: Path, seeds: int) -> dict[str, object]:
    """Return a row of the table: one method on one problem; what the raw results lack is run."""
    path = raw / f"{problem.name}_{method}.csv"
    runs = pd.read_csv(path) if path.exists() else pd.DataFrame()
    for seed in range(len(runs), seeds):
        runs = pd.concat([runs, repeated(problem, method, [seed])], ignore_index=True)
        write_csv(path, runs)
    probability, error = known(problem, raw)
    labels = {"problem": problem.name, "group": group_of(problem), "method": method}
    labels |= {"dimension": problem.event.dimension}
    references = {"reference": probability, "reference_se": error, "published": problem.published}
    found = summary(runs, probability)
    return labels | references | found | {"no_number": runs["probability"].isna().mean()}


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("output", type=Path, help="where to write the table")
    parser.add_argument("--raw", type=Path, required=True, help="folder of the raw results")
    parser.add_argument("--seeds", type=int, default=40, help="default: 40")
    parser.add_argument("--methods", nargs="+", default=["surrogate", "nais", "nais_25"])
    parser.add_argument("--collection", choices=COLLECTIONS, default="public")
    parser.add_argument("--problems", nargs="+", help="default: all")
    arguments = parser.parse_args()
    arguments.raw.mkdir(parents=True, exist_ok=True)
    everything = COLLECTIONS[arguments.collection]()
    wanted = [everything[name] for name in arguments.problems or everything]
    tasks = [(problem, method) for problem in wanted for method in arguments.methods]
    rows = [row(*task, arguments.raw, arguments.seeds) for task in tqdm(tasks, desc="problems")]
    write_csv(arguments.output, reproducible(pd.DataFrame(rows)[COLUMNS]))


if __name__ == "__main__":
    main()
