"""Compiled simulations: how a function is compiled, and how a batch is divided among threads."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numba
import numpy as np
from numba import njit

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.scenarios.protocol import Scenario

SLICE_FOR_A_THREAD = 16_384  # encounters, some 5 ms: below that a second thread costs more than it gains


def compiled(function: Callable) -> Callable:
    """Compile ``function``, and keep the result on disk where numba finds a place that can be written."""
    options = {"error_model": "numpy", "nogil": True}
    try:
        return njit(cache=True, **options)(function)
    except RuntimeError:  # no such place
        return njit(**options)(function)


def simulate_in_slices(
    scenario: Scenario,
    simulate_slice: Callable,
    numbers: tuple[Any, ...],
    encounters: Array,
    *,
    threads: int,
) -> Any:  # noqa: ANN401
    """Simulate a batch in equal slices, one for each thread; a small batch takes fewer threads.

    Parameters
    ----------
    scenario
        The scenario, which names the outcomes.
    simulate_slice
        Compiled function of (encounters, begin, end, numbers, outcomes) that releases Python's global lock
        and writes the outcomes of the encounters from ``begin`` to ``end`` to the columns of outcomes.
    numbers
        What it needs to know of the vehicle.
    encounters
        Checked encounters, shape (d, n).
    threads
        The largest number of threads.

    Returns
    -------
    object
        The outcomes, of the scenario's type.
    """
    n = encounters.shape[1]
    outcomes = np.empty((len(scenario.outcomes), n))
    parts = max(1, min(threads, n // SLICE_FOR_A_THREAD))
    cuts = np.linspace(0, n, parts + 1, dtype=int).tolist()
    if parts == 1:
        simulate_slice(encounters, 0, n, numbers, outcomes)
    else:
        with ThreadPoolExecutor(parts) as pool:
            list(pool.map(lambda cut: simulate_slice(encounters, *cut, numbers, outcomes), pairwise(cuts)))
    return scenario.outcomes_of(outcomes)


def available_threads() -> int:
    """Return the number of threads for a large batch.

    It is OMP_NUM_THREADS, which Snakemake sets to the threads of a rule, or the number of cores.
    """
    limit = os.environ.get("OMP_NUM_THREADS", "")
    return int(limit) if limit.isdigit() and int(limit) > 0 else numba.config.NUMBA_NUM_THREADS
