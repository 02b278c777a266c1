"""Experiment beyond the paper: the effect of more updates on the efficiency and the parameters of f*."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from accelerated_evaluation.crash_map.exact_variance import exact_variation
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.cross_entropy.search import COORDINATES
from accelerated_evaluation.methods.estimate import normal_reach
from accelerated_evaluation.problem import Problem

SEEDS = range(8)
CRASH_UPDATES = (2, 6, 12)  # numbers of updates with the crash itself, after which a search ends
IGNORED_SHARE = 1e-3  # of the crash probability, as in `exact_variance.variation_table`


def repeated_searches(
    methods: Sequence[str],
    config: Mapping[str, Any],
    problem: Problem,
    stratum: str,
    crash_map: CrashMap,
    generator_of: Callable[[str, int], np.random.Generator],
) -> pd.DataFrame:
    """Search f* of one stratum with several seeds, and end each search after 2, 6 and 12 crash updates.

    The generator depends on the method and the seed only, so that a longer search continues the shorter one.
    The columns are method, crash_updates, seed; simulations of the search; ``needed``, the simulations to
    convergence by the exact variance; and the `parameter_change` of each coordinate.
    """
    limits = config["importance_sampling"]
    reach, only, rows = normal_reach(limits["alpha"]) / limits["beta"], problem.only(stratum), []
    for name, updates, seed in tqdm([(m, n, s) for m in methods for n in CRASH_UPDATES for s in SEEDS]):
        section = config["cross_entropy"] | {"crash_iterations": updates}
        method = METHODS[name].configured({**config, "cross_entropy": section})
        search = method.search(only, stratum, generator_of(name, seed))
        proposals, trace = {stratum: search.proposal}, pd.DataFrame(search.trace)
        variation = exact_variation(crash_map, only.law, proposals, ignored_shares=(IGNORED_SHARE,))[stratum]
        rows.append(
            {
                "method": name,
                "crash_updates": updates,
                "seed": seed,
                "simulations": search.simulations,
                "needed": (reach * variation[0]) ** 2,
            }
            | {f"change_{coordinate}": parameter_change(trace, coordinate) for coordinate in COORDINATES}
        )
    return pd.DataFrame(rows)


def parameter_change(trace: pd.DataFrame, coordinate: str) -> float:
    """Return the mean relative change of a parameter from one update with the crash itself to the next.

    The parameter is the tilt of the piece that has the largest weight at the end, or the rate of a single
    exponential. The result is NaN if the trace has fewer than two such updates.
    """
    at_crash = trace[trace["threshold_ttc_s"] == 0]
    weights = trace.filter(regex=f"^{coordinate}_weight_")
    if weights.empty:
        parameter = f"{coordinate}_rate"
    else:
        parameter = weights.iloc[-1].idxmax().replace("_weight_", "_theta_")
    return float(at_crash[parameter].pct_change().abs().mean())
