"""Compiled simulations: compile functions with numba, and divide a batch of encounters among threads."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numba
import numpy as np
from fewruns.compiling import cached_njit

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.scenarios.protocol import Scenario

# Smallest number of encounters for a thread, which take about 5 ms. For smaller slices, starting a further
# thread takes longer than it saves.
SLICE_FOR_A_THREAD = 16_384


compiled = cached_njit(error_model="numpy", nogil=True)


def simulate_in_slices(
    scenario: Scenario,
    simulate_slice: Callable,
    encounters: Array,
    *numbers: Any,  # noqa: ANN401
    threads: int | None = None,
) -> Any:  # noqa: ANN401
    """Return the outcomes of n encounters, simulated in equal slices, one for each thread.

    Small batches use fewer threads than ``threads``. ``simulate_slice(encounters, begin, end, *numbers,
    outcomes)`` writes the outcomes of the encounters from ``begin`` to ``end`` to the same columns of
    ``outcomes``, and releases Python's global interpreter lock. The encounters are checked before, and the
    outcomes are those of the scenario.
    """
    n, threads = encounters.shape[1], available_threads() if threads is None else threads
    outcomes = np.empty((len(scenario.outcomes), n))
    parts = max(1, min(threads, n // SLICE_FOR_A_THREAD))
    cuts = np.linspace(0, n, parts + 1, dtype=int).tolist()
    if parts == 1:
        simulate_slice(encounters, 0, n, *numbers, outcomes)
    else:
        with ThreadPoolExecutor(parts) as pool:
            list(pool.map(lambda cut: simulate_slice(encounters, *cut, *numbers, outcomes), pairwise(cuts)))
    return scenario.outcomes_of(outcomes)


def available_threads() -> int:
    """Return the number of threads for a large batch.

    The number is that of the environment variable OMP_NUM_THREADS, which Snakemake sets to the number of
    threads of a rule. Without the variable, the number of cores is returned.
    """
    limit = os.environ.get("OMP_NUM_THREADS", "")
    return int(limit) if limit.isdigit() and int(limit) > 0 else numba.config.NUMBA_NUM_THREADS
