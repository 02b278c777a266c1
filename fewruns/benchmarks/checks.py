"""Intervals that are checked after every batch: how often one of them misses the truth, and what that costs.

    python fewruns/benchmarks/checks.py run segment_5_15 --seeds 0 200 --output checks.csv
    python fewruns/benchmarks/checks.py table checks.csv --output summary.csv

One run of the sampler serves both kinds of interval. It goes on until the anytime interval is narrow; the
usual interval has been narrow before. The first ten checks do not count.
"""

import argparse
from dataclasses import replace

import pandas as pd
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.methods import Estimate
from chance import PROBLEMS as CHANCE
from chance import Chance, reference
from fewruns import Sampler
from methods import Target
from problems import problems
from run import ROOT
from scipy.stats import binomtest

LIMIT = 1000
FIRST = 10  # checks that do not count
KINDS = {"usual": False, "anytime": True}


def checked(name: str, seed: int) -> dict[str, object]:
    """Return what both kinds of interval did in one run of the sampler.

    Returns
    -------
    dict
        For each kind whether a check missed the truth (``any``), whether the last one before the end did
        (``last``), and the simulations at which it was narrow; the end is that of the kind itself.
    """
    chance = problem_of(name)
    event = chance.make(child_generator(ROOT, name, "checks of the car", seed))
    sampler = Sampler(
        event.dimension,
        child_generator(ROOT, name, "checks", seed),
        fingerprint=event.fingerprint,
        deterministic=event.deterministic,
    )
    goals = {kind: replace(Target(minimum_events=1), anytime=anytime) for kind, anytime in KINDS.items()}
    row: dict[str, object] = {"problem": name, "seed": seed, "exact": chance.exact}
    row |= {f"{kind}_{what}": False for kind in KINDS for what in ("any", "all")} | {"checks": 0}
    open_kinds = [*KINDS]
    while open_kinds and sampler.simulations < LIMIT:
        z = sampler.ask(certify=sampler.is_narrow(goals[open_kinds[0]]))
        again = getattr(event, "repeat", event.evaluate)
        sampler.tell(*(again(z) if sampler.repeats_next else event.evaluate(z)))
        row["checks"] += 1
        for kind in [*KINDS]:
            found = sampler.estimate(goals[kind])
            missed = row["checks"] > FIRST and misses(found, chance.exact)
            row[f"{kind}_all"] |= missed  # also after the goal was met
            if kind in open_kinds:
                row[f"{kind}_any"] |= missed
                row |= {f"{kind}_last": misses(found, chance.exact), f"{kind}_simulations": found.simulations}
                row |= {
                    f"{kind}_ratio": found.probability / chance.exact,
                    f"{kind}_converged": found.converged,
                }
                if found.converged:
                    open_kinds.remove(kind)
    return row


def misses(found: Estimate, exact: float) -> bool:
    """Whether an interval misses the truth."""
    return not found.low <= exact <= found.high


def problem_of(name: str) -> Chance:
    """Return a problem of the benchmark, or of those with chance, with its exact probability."""
    if name in CHANCE:
        return CHANCE[name]()
    own = problems()[name]
    return Chance(lambda _: own.event, own.exact or reference(name))


def table(runs: pd.DataFrame) -> pd.DataFrame:
    """Sum up the runs, a row a problem and a kind of interval."""
    rows = []
    for name, own in runs.groupby("problem", sort=False):
        for kind in KINDS:
            count = int(own[f"{kind}_any"].sum())
            ends = binomtest(count, len(own)).proportion_ci(0.95, "exact")
            rows.append(
                {
                    "problem": name,
                    "interval": kind,
                    "seeds": len(own),
                    "converged": int(own[f"{kind}_converged"].sum()),
                    "simulations": own[f"{kind}_simulations"].mean(),
                    "missed_at_any_check": count / len(own),
                    "missed_at_any_low": ends.low,
                    "missed_at_any_high": ends.high,
                    "missed_at_the_end": own[f"{kind}_last"].mean(),
                }
            )
    return pd.DataFrame(rows)


def main() -> None:
    """Check one problem, or sum up."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    steps = parser.add_subparsers(dest="step", required=True)
    run = steps.add_parser("run", help="check one problem with some seeds")
    run.add_argument("problem")
    run.add_argument("--seeds", type=int, nargs=2, metavar=("FIRST", "END"), required=True)
    summed = steps.add_parser("table", help="sum up all runs")
    summed.add_argument("runs", nargs="+")
    for step in (run, summed):
        step.add_argument("--output", required=True)
    arguments = parser.parse_args()
    if arguments.step == "run":
        rows = [checked(arguments.problem, seed) for seed in range(*arguments.seeds)]
        write_csv(arguments.output, pd.DataFrame(rows))
    else:
        write_csv(arguments.output, table(pd.concat(map(pd.read_csv, arguments.runs), ignore_index=True)))


if __name__ == "__main__":
    main()
