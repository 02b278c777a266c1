"""The methods of this project: its adaptive sampler, the paper's three, and crude Monte Carlo."""

from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import yaml
from accelerated_evaluation.methods.importance_sampling import Stratum, estimate, run_to_convergence
from accelerated_evaluation.methods.intervals import Sums, sequential_estimate
from accelerated_evaluation.methods.paper import search_by_method
from accelerated_evaluation.methods.surrogate.sampler import sample
from methods import Counter, Estimate, Target, adapter
from problems import Problem

CONFIG = Path(__file__).resolve().parents[2] / "config" / "config.yaml"
SEARCH_SAMPLE = 300  # cut-ins an iteration: the paper's 1,000 cost more than they gain at this target


@cache
def settings() -> dict:
    """Return the study's settings of the search and of importance sampling."""
    return yaml.safe_load(CONFIG.read_text(encoding="utf-8"))


@adapter
def surrogate(problem: Problem, counter: Counter, generator: np.random.Generator, target: Target) -> Estimate:
    """Sample adaptively with a surrogate of the event, the sampler of this project."""
    found = sample(counter.event(problem.event), target, generator, batch_size=10)
    return found.probability, found.ci_low, found.ci_high, found.converged


@adapter
def crude(problem: Problem, counter: Counter, generator: np.random.Generator, target: Target) -> Estimate:
    """Draw from the model itself until the interval is as narrow as asked."""
    event = counter.event(problem.event)

    def draw(size: int) -> Sums:
        happened, _ = event.evaluate(generator.standard_normal((size, event.dimension)))
        return Sums.unweighted(size, int(np.count_nonzero(happened)))

    found = sequential_estimate(
        draw,
        alpha=target.alpha,
        beta=target.half_width,
        minimum_events=1,
        maximum_simulations=target.maximum_calls,
        weight_bound=1.0,
    )
    return found.sums.probability, found.interval.low, found.interval.high, found.converged


def by_paper(
    method: str, problem: Problem, counter: Counter, generator: np.random.Generator, target: Target
) -> Estimate:
    """Search f* by one of the paper's methods, then sample from it by the paper's rule of convergence."""
    cut_in = replace(problem.cut_in, vehicle=counter.vehicle(problem.cut_in.vehicle))
    search = settings()["cross_entropy"] | {"sample_size": SEARCH_SAMPLE}
    proposal = search_by_method(method, cut_in, search, generator).proposal
    weights, converged_at = run_to_convergence(
        {"segment": Stratum(cut_in, 1.0, proposal)},
        generator,
        alpha=target.alpha,
        beta=target.half_width,
        minimum_events=settings()["importance_sampling"]["minimum_events"],
        simulations=2000,
        maximum_simulations=target.maximum_calls - counter.calls,
    )
    # The rule looks after every simulation; those drawn at once beyond it are neither used nor counted.
    found = estimate(weights[:converged_at], target.alpha)
    counter.calls -= weights.size - found.simulations
    return found.probability, found.ci_low, found.ci_high, converged_at is not None


def _of_paper(method: str):
    run = partial(by_paper, method)
    run.__name__ = method
    return adapter(run)


piecewise, single, heuristic = map(_of_paper, ("piecewise", "single", "heuristic"))
