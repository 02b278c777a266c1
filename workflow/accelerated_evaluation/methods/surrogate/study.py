"""The study of the surrogate-guided sampler: replicates over all segments, and in the first one alone."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.encounters.segments import VARIABLES, segment_names
from accelerated_evaluation.methods.surrogate.sampler import Result, Target, sample
from accelerated_evaluation.methods.surrogate.two_phase import counted
from accelerated_evaluation.problem import CutIn
from accelerated_evaluation.rare_event import cut_in_event


def study_surrogate(
    problems: Mapping[str, CutIn],
    shares: Mapping[str, float],
    edges: Sequence[float],
    generator_of: Callable[[str, int], np.random.Generator],
    criterion: Mapping[str, Any],
    settings: Mapping[str, int],
) -> dict[str, pd.DataFrame]:
    """Run the replicates, which learn while they sample.

    Parameters
    ----------
    problems, shares
        The cut-ins of each segment, and its share in the lane changes.
    edges
        Edges of the segments of v_L [m/s].
    generator_of
        Gives the generator of a scope and replicate.
    criterion, settings
        Sections ``importance_sampling``, for alpha and beta, and ``surrogate`` of the configuration.

    Returns
    -------
    dict
        ``surrogate``, one row a replicate, and ``surrogate_runs``, one row a simulation.
    """
    target = Target(criterion["beta"], criterion["alpha"], settings["maximum_calls"])
    first = next(iter(problems))
    scopes = {
        "all": cut_in_event(problems, shares),
        first: cut_in_event({first: problems[first]}, {first: 1.0}),
    }
    replicates = [(scope, replicate) for scope in scopes for replicate in range(settings["replicates"])]
    estimates, runs = [], []
    for scope, replicate in tqdm(replicates, desc="surrogate"):
        result = sample(scopes[scope], target, generator_of(scope, replicate), settings["batch_size"])
        labels = {"scope": scope, "method": "surrogate", "replicate": replicate}
        estimates.append(labels | summary(result))
        x = scopes[scope].inputs(np.array(result.state["z"]))
        table = run_table(result.state, x, edges)
        runs.append(table.assign(**labels)[[*labels, *table.columns]])
    return {"surrogate": pd.DataFrame(estimates), "surrogate_runs": pd.concat(runs, ignore_index=True)}


def summary(result: Result) -> dict[str, Any]:
    """Return the columns of an estimate that mean the same as those of importance sampling."""
    half_width = result.ci_high - result.probability
    return {
        "probability": result.probability,
        "ci_low": result.ci_low,
        "ci_high": result.ci_high,
        "relative_half_width": half_width / result.probability if result.probability else math.inf,
        "simulations": result.calls,
        "events": int(np.sum(result.state["event"])),
        "converged": result.converged,
    }


def run_table(state: Mapping[str, Any], x: Array, edges: Sequence[float]) -> pd.DataFrame:
    """Tabulate the simulations of a sampler's state, with the phase that each belongs to.

    The phases: ``search`` until an event was seen, ``learn`` until the surrogate was usable, ``estimate``, of
    which the estimate is made.

    Parameters
    ----------
    state
        State of the sampler after its last simulation.
    x
        v_L, R^-1 and TTC^-1 of the simulations, shape (n, 3).
    edges
        Edges of the segments of v_L [m/s].
    """
    z, event = np.array(state["z"]), np.array(state["event"], dtype=bool)
    run = np.arange(len(z)) + 1
    batch = (run - 1) // state["batch_size"] + 1
    seen = batch[event].min(initial=batch[-1] + 1)
    learnt = batch[-1] - len(counted(state["batches"]))
    names = np.array(segment_names(edges))
    columns = {
        "run": run,
        "batch": batch,
        "phase": np.select([batch <= seen, batch <= learnt], ["search", "learn"], "estimate"),
        **{f"z_{name}": values for name, values in zip(VARIABLES, z.T, strict=True)},
        **dict(zip(VARIABLES, x.T, strict=True)),
        "segment": names[np.searchsorted(edges[1:-1], x[:, 0], side="right")],
        "event": event,
    }
    return pd.DataFrame(columns)
