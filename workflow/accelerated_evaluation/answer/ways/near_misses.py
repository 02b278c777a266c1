"""Intervals of near misses that allow for clusters of critical records."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from accelerated_evaluation.answer.ways.posterior import Posterior
from accelerated_evaluation.base.arrays import Array

BLOCKS = (5_000, 15_000)  # consecutive records in a block; the longest are used for the factor
LEAST = 20  # number of records below which a dispersion says nothing


def block_counts(happened: NDArray[np.bool_], length: int) -> Array:
    """Return the numbers of events in blocks of consecutive records; a last shorter block is left out."""
    whole = happened[: happened.size // length * length]
    return whole.reshape(-1, length).sum(axis=1)


def dispersion(happened: NDArray[np.bool_], length: int) -> float:
    """Return variance / mean of the block counts, which is 1 for Poisson counts; NaN for few events."""
    if happened.sum() < LEAST or happened.size < 2 * length:
        return float("nan")
    counts = block_counts(happened, length)
    return float(counts.var(ddof=1) / counts.mean())


def level_factors(critical: NDArray[np.bool_], draws: int, generator: np.random.Generator) -> Array:
    """Draw the relative number of critical records by the Bayesian bootstrap of long blocks, (draws,)."""
    counts = block_counts(critical, min(BLOCKS[-1], max(critical.size // 10, 1)))
    shares = generator.dirichlet(np.ones(counts.size), draws)
    return shares @ counts / max(counts.mean(), np.finfo(float).tiny)


def near_miss_table(
    posteriors: Mapping[str, Posterior],
    replayed: Mapping[str, NDArray[np.bool_]],
    critical: NDArray[np.bool_],
    generator: np.random.Generator,
) -> pd.DataFrame:
    """Tabulate the 95 % intervals of events with and without the variation between blocks of records.

    The laws take records as independent of each other. Critical cut-ins are more frequent in some parts of
    the file than in others, so their number varies more than a Poisson number. Here every draw of a
    probability is multiplied by a random factor, the relative number of critical records in a Bayesian
    bootstrap of long blocks.

    ``critical`` marks the records near the events, as in the region in which laws are scored.
    ``dispersion_5000`` and ``dispersion_15000`` are those in blocks of so many records, and the limits with
    the variation between blocks begin with ``clustered``. The random factors are the same for all events.
    """
    factors = level_factors(critical, len(next(iter(posteriors.values())).probabilities), generator)
    rows = []
    for event, posterior in posteriors.items():
        clustered = replace(posterior, probabilities=posterior.probabilities * factors)
        happened = replayed[event]
        row = {"event": event, "recorded": int(happened.sum())}
        row |= {f"dispersion_{length}": dispersion(happened, length) for length in BLOCKS}
        row |= dict(zip(("low95", "high95"), posterior.interval(0.95), strict=True))
        row |= dict(zip(("clustered_low95", "clustered_high95"), clustered.interval(0.95), strict=True))
        rows.append(row)
    return pd.DataFrame(rows)
