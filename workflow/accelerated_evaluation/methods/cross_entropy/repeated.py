"""Searches of f* that end later than those of the study, and what this changes (beyond the paper)."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from tqdm import tqdm

from accelerated_evaluation.crash_map.exact_variance import IGNORED_SHARE, exact_variation
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.methods import Stopping, normal_reach
from accelerated_evaluation.methods.cross_entropy.method import CrossEntropyMethod
from accelerated_evaluation.methods.cross_entropy.search import COORDINATES
from accelerated_evaluation.methods.problem import Problem

SEEDS = range(8)
CRASH_UPDATES = (2, 6, 12)  # numbers of updates with the crash itself, after which a search ends


def repeated_searches(
    methods: Sequence[CrossEntropyMethod],
    stopping: Stopping,
    problem: Problem,
    stratum: str,
    crash_map: CrashMap,
    generator_of: Callable[[str, int], np.random.Generator],
) -> pd.DataFrame:
    """Search f* of one stratum with several seeds, and end each search after 2, 6 and 12 crash updates.

    This experiment, which is beyond the paper, shows the effect of more updates on the efficiency of f*.
    The generator depends on the method and the seed only, so that a longer search continues the shorter one.
    Of the stopping rule, level and half-width are used. The columns are method, crash_updates, seed;
    simulations of the search; ``needed``, the simulations to convergence by the exact variance; and the
    `parameter_change` of each coordinate.
    """
    reach, only, rows = normal_reach(stopping.alpha) / stopping.beta, problem.only(stratum), []
    law = only.stratified
    for method, updates, seed in tqdm([(m, n, s) for m in methods for n in CRASH_UPDATES for s in SEEDS]):
        longer = replace(method, cross_entropy={**method.cross_entropy, "crash_iterations": updates})
        search = longer.search(only, stratum, generator_of(method.name, seed))
        proposals, trace = {stratum: search.proposal}, pd.DataFrame(search.trace)
        variation = exact_variation(crash_map, law, proposals, ignored_shares=(IGNORED_SHARE,))[stratum]
        rows.append(
            {
                "method": method.name,
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
