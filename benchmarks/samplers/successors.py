"""A vehicle that is like a known one: how many simulations the runs of its predecessor save.

    python benchmarks/samplers/successors.py benchmarks/results/successors.csv [--seeds 20]

The predecessor is the study's car in the segment 5-15 m/s. The sampler estimates its crash probability first;
then each variant of the car is estimated twice, with these runs and without.
"""

import argparse
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.publishing.tables.display import reproducible
from accelerated_evaluation.vehicles.builtin.acc_aeb import AccAeb
from fewruns import Predecessor, Sampler, ScoreProblem
from fewruns.arrays import Generator
from fewruns.running import run_batches, sampler_for
from methods import Target
from problems import BENCHMARK, WEAK_AEB, crash, segment_problem
from reference import reference
from tqdm import tqdm

ROOT, DRIVES = 2016, 60
TARGET = Target(minimum_events=1, maximum_simulations=1000)
VARIANTS: Mapping[str, Mapping[str, float]] = {
    "the same car": {},
    "AEB from a TTC of 0.85 s": {"aeb_ttc": 0.85},
    "AEB from a TTC of 1 s": {"aeb_ttc": 1.0},
    "AEB of 8.5 m/s²": {"aeb_deceleration": 8.5},
    "AEB jerk 12 m/s³": {"aeb_jerk": 12.0},
    "AEB jerk 24 m/s³": {"aeb_jerk": 24.0},
    "friction 8.5 m/s²": {"friction_limit": 8.5},
    "actuator jerk 12 m/s³": {"actuator_jerk": 12.0},
    "time headway 1.5 s": {"headway": 1.5},
    "weak AEB": WEAK_AEB,
}


def event_of(parameters: Mapping[str, float]) -> ScoreProblem:
    """Return the crash of a variant of the car."""
    return crash("variant", segment_problem("5-15", AccAeb(**parameters), BENCHMARK)).event


def driven(event: ScoreProblem, generator: Generator, known: Predecessor | None) -> tuple[Sampler, float]:
    """Run the sampler to its end; return it, and what it says after `DRIVES` simulations.

    Where it has no estimate yet, it says what the surrogate foretells.
    """
    sampler = sampler_for(event, generator, predecessor=known)
    early = np.nan
    for _ in run_batches(sampler, event, TARGET):
        if sampler.simulations == DRIVES:
            early = early_answer(sampler)
    return sampler, early_answer(sampler) if np.isnan(early) else early


def early_answer(sampler: Sampler) -> float:
    """Return the estimate, or what the surrogate foretells while there is none; 0 if there is neither."""
    estimate = sampler.estimate(TARGET).probability
    batches = sampler.progress.estimates
    foretold = batches[-1].prediction.probability if batches else 0.0
    return foretold if np.isnan(estimate) else estimate


@cache
def predecessor(root: int, seed: int) -> Predecessor:
    """Return the runs of the study's car until its estimate has converged."""
    progress = driven(event_of({}), child_generator(root, "predecessor", seed), None)[0].progress
    return Predecessor(progress.z, progress.happened)


def pair(name: str, seed: int, root: int = ROOT) -> dict[str, object]:
    """Return what the sampler gives for a variant, with the runs of its predecessor and ``_alone``."""
    event, row = event_of(VARIANTS[name]), {"variant": name, "seed": seed}
    for end, known in {"": predecessor(root, seed), "_alone": None}.items():
        sampler, early = driven(event, child_generator(root, "successor", seed), known)
        found = sampler.estimate(TARGET)
        row |= {f"early{end}": early, f"simulations{end}": found.simulations}
        row |= {f"{name}{end}": getattr(found, name) for name in ("probability", "low", "high")}
    return row


def table(runs: pd.DataFrame, truth: Mapping[str, float]) -> pd.DataFrame:
    """Sum up the runs, a row for each variant, whose crash probabilities are ``truth``."""
    before, exact = truth["the same car"], runs["variant"].map(truth)
    runs = runs.assign(
        ranked=(runs["early"] > before) == (exact > before),
        holds=(runs["low"] <= exact) & (exact <= runs["high"]),
        off=~runs["probability"].between(exact / 2, 2 * exact),
        early_error=np.square(runs["early"] / exact - 1),
        error=np.square(runs["probability"] / exact - 1),
        error_alone=np.square(runs["probability_alone"] / exact - 1),
    )
    groups = runs.groupby("variant", sort=False)
    found = pd.DataFrame({"probability": truth, "ratio": truth}).loc[list(groups.groups)]
    found["ratio"] /= before
    errors, means = ["early_error", "error", "error_alone"], ["ranked", "simulations", "holds", "off"]
    summed = groups[[*errors, *means, "simulations_alone"]].mean()
    found = found.assign(seeds=groups.size()).join(summed.assign(**np.sqrt(summed[errors])))
    return found.rename_axis("variant").reset_index()


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("output", type=Path, help="where to write the table")
    parser.add_argument("--seeds", type=int, default=20, help="default: 20")
    arguments = parser.parse_args()
    truth = {
        name: reference(event_of(parameters), child_generator(ROOT, "reference", name))[0]
        for name, parameters in tqdm(VARIANTS.items(), desc="references")
    }
    seeds = range(arguments.seeds)
    runs = [pair(name, seed) for seed in tqdm(seeds, desc="seeds of all variants") for name in VARIANTS]
    write_csv(arguments.output, reproducible(table(pd.DataFrame(runs), truth)))


if __name__ == "__main__":
    main()
