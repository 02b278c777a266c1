"""Compiled simulations on several threads."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numba
import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.vehicles.protocol import Outcomes

SLICE_FOR_A_THREAD = 16_384  # encounters, some 5 ms: below that a second thread costs more than it gains


def simulate_in_slices(
    simulate_slice: Callable, numbers: tuple[Any, ...], encounters: Array, *, threads: int
) -> Outcomes:
    """Simulate a batch in equal slices, one for each thread; a small batch takes fewer threads.

    Parameters
    ----------
    simulate_slice
        Compiled function of (encounters, begin, end, numbers, outcomes) that releases Python's global lock
        and writes crash, min_range, min_ttc and impact_speed to the columns of outcomes, shape (4, n).
    numbers
        What it needs to know of the vehicle.
    encounters
        Checked lead speed [m/s], range [m] and closing speed [m/s], shape (3, n).
    threads
        The largest number of threads.
    """
    n = encounters.shape[1]
    outcomes = np.empty((4, n))
    parts = max(1, min(threads, n // SLICE_FOR_A_THREAD))
    cuts = np.linspace(0, n, parts + 1, dtype=int).tolist()
    if parts == 1:
        simulate_slice(encounters, 0, n, numbers, outcomes)
    else:
        with ThreadPoolExecutor(parts) as pool:
            list(pool.map(lambda cut: simulate_slice(encounters, *cut, numbers, outcomes), pairwise(cuts)))
    return Outcomes(outcomes[0] > 0, *outcomes[1:])


def available_threads() -> int:
    """Return the number of threads for a large batch.

    It is OMP_NUM_THREADS, which Snakemake sets to the threads of a rule, or the number of cores.
    """
    limit = os.environ.get("OMP_NUM_THREADS", "")
    return int(limit) if limit.isdigit() and int(limit) > 0 else numba.config.NUMBA_NUM_THREADS
