"""Estimate the crash probability by surrogate-guided sampling, in independent replicates."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.encounters.segments import VARIABLES, segment_names
from accelerated_evaluation.files import write_csv
from accelerated_evaluation.jobs import job
from accelerated_evaluation.methods.paper import load_cut_ins
from accelerated_evaluation.methods.surrogate.sampler import Result, Target, sample
from accelerated_evaluation.methods.surrogate.two_phase import counted
from accelerated_evaluation.randomness import child_generator
from accelerated_evaluation.rare_event import cut_in_event
from tqdm import tqdm


def main(config: dict, inputs: dict[str, str], outputs: dict[str, str]) -> None:
    """Write an estimate for each replicate, and every simulation, over all segments and in the first one."""
    settings, criterion = config["surrogate"], config["importance_sampling"]
    target = Target(criterion["beta"], criterion["alpha"], settings["maximum_calls"])
    model, problems = load_cut_ins(inputs["model"], inputs["encounters"], config["vehicle"])
    first = model.segments[0]
    scopes = {
        "all": cut_in_event(problems, {segment: model.share(segment) for segment in problems}),
        first: cut_in_event({first: problems[first]}, {first: 1.0}),
    }
    replicates = [(scope, replicate) for scope in scopes for replicate in range(settings["replicates"])]
    estimates, runs = [], []
    for scope, replicate in tqdm(replicates, desc="surrogate"):
        generator = child_generator(config["seed"], "surrogate", scope, replicate)
        result = sample(scopes[scope], target, generator, settings["batch_size"])
        labels = {"study": config["study"], "scope": scope, "method": "surrogate", "replicate": replicate}
        estimates.append(labels | summary(result))
        x = scopes[scope].inputs(np.array(result.state["z"]))
        table = run_table(result.state, x, config["segments"]["lead_speed_edges"])
        runs.append(table.assign(**labels)[[*labels, *table.columns]])
    write_csv(outputs["surrogate_runs"], pd.concat(runs, ignore_index=True))
    write_csv(outputs["surrogate"], pd.DataFrame(estimates))


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


def run_table(state: Mapping[str, Any], x: Array, edges: list[float]) -> pd.DataFrame:
    """Tabulate the simulations of a sampler's state, with the phase that each belongs to.

    The phases: ``search`` until an event was seen, ``learn`` until the surrogate was usable, ``estimate``, of
    which the estimate is made.
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


if __name__ == "__main__":
    with job(snakemake.log[0]):
        main(
            snakemake.config,
            {name: snakemake.input[name] for name in ("encounters", "model")},
            dict(snakemake.output.items()),
        )
