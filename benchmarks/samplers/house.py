"""The methods of this project, each asked for its estimate by the one call that all of them have."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import yaml
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods import Estimate as Found
from fewruns.combining import interval
from methods import Counter, Estimate, Outcome, Target, adapter, normal_95
from problems import Problem

CONFIG = Path(__file__).resolve().parents[2] / "config" / "config.yaml"
SEARCH_SAMPLE = 300  # cut-ins an iteration: the paper's 1,000 cost more than they gain at this target
BATCH = 2000  # cut-ins drawn at once


@cache
def settings() -> dict:
    """Return the study's settings, with those of the search and of the batches as the benchmark has them."""
    config = yaml.safe_load(CONFIG.read_text(encoding="utf-8"))
    config["cross_entropy"]["sample_size"] = SEARCH_SAMPLE
    config["importance_sampling"]["simulations"] = BATCH
    return config


def house(name: str) -> Callable[[Problem, np.random.Generator, Target], Outcome]:
    """Return a method of the project as the benchmark runs it."""
    method = METHODS[name].configured(settings())

    def run(problem: Problem, counter: Counter, generator: np.random.Generator, target: Target) -> Estimate:
        needs_law = METHODS[name].learns_apart
        asked = counter.cut_in(problem.cut_in) if needs_law else counter.event(problem.event)
        events = settings()["importance_sampling"]["minimum_events"] if needs_law else 1
        found = method.estimate(asked, replace(target, minimum_events=events), generator)
        # Simulations that were drawn at once beyond the moment of stopping are neither used nor counted.
        counter.calls = found.simulations
        return found.probability, found.low, found.high, *interval_95(found), found.converged

    run.__name__ = name
    return adapter(run)


def interval_95(found: Found) -> tuple[float, float]:
    """Return the 95 % interval of the same error: the sampler's own where the method counts batches."""
    batches = found.diagnostics.get("batches", 0)
    if batches < 2:
        return normal_95(found.probability, found.low, found.high)
    error = max(found.diagnostics["observed_error"], found.diagnostics["predicted_error"])
    return interval(found.probability, error, batches, 0.05)
