"""Replays of the records, which show events that the sampler of an estimate has missed.

The records are a sample from the law, and no sampler has chosen them. If the vehicle under test has the event
in more of them than the estimate allows, the estimate is wrong: the sampler has not found a part of the
event, or the law does not describe the records.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import binom, poisson
from tqdm import tqdm

from accelerated_evaluation.base.arrays import Array

LEVEL = 0.01  # significance level of the comparison with the estimate
# The records are sorted by how near another vehicle came to the event. The strata end at these shares, and a
# slow vehicle replays so many records of each.
SHARES, SIZES = (0.001, 0.01, 0.1, 1.0), (20, 30, 40, 10)
SIMILAR = 10  # number of similar records that are replayed after each event,
FOLLOWED = 40  # and their largest number in total
FAST = 1e-3  # [s]; a vehicle that takes less for a run replays all records
CHUNK = 10_000  # number of records that are replayed at a time

Happens = Callable[[Array], NDArray[np.bool_]]


@dataclass(frozen=True)
class Replays:
    """The records that a vehicle has replayed.

    Attributes
    ----------
    records
        Number of distinct records in each stratum, the nearest to the event first.
    sampled, events
        Number of records that were drawn at random from each stratum, and of the events among them.
    happened, replayed
        Number of events in all replayed records, and number of these records. Besides the sampled ones there
        may be others, which are similar to records with the event.
    encounters, flags
        The records of the stratified sample and those similar to its events, shape (d, n), and whether they
        ended with the event, shape (n,). They guide the sampler.
    """

    records: NDArray[np.intp]
    sampled: NDArray[np.intp]
    events: NDArray[np.intp]
    happened: int
    replayed: int
    encounters: Array
    flags: NDArray[np.bool_]

    def p_value(self, upper: float) -> float:
        """Return the probability of so many events if the event has at most the probability ``upper``.

        All events of the law may lie in one stratum, so the probability in a stratum is at most that of all
        records times the inverse share of the stratum. All events in the replayed records are at most those
        in all records, however the replayed ones were chosen. The smallest p-value is multiplied by the
        number of tests.
        """
        most = upper * self.records.sum()
        inside = np.minimum(most / self.records, 1.0)
        tests = [*binom.sf(self.events - 1, self.sampled, inside), poisson.sf(self.happened - 1, most)]
        return float(min(1.0, min(tests) * len(tests)))

    def table(self, upper: float) -> pd.DataFrame:
        """Return a row for each stratum, and one for all replays, with the p-value."""
        ends = np.cumsum(self.records)
        strata = [f"{end - size + 1} to {end}" for size, end in zip(self.records, ends, strict=True)]
        table = pd.DataFrame(
            {
                "records_by_nearness": [*strata, "all, with similar ones"],
                "records": [*self.records, self.records.sum()],
                "replayed": [*self.sampled, self.replayed],
                "events": [*self.events, self.happened],
            }
        )
        is_last = np.arange(len(table)) == len(strata)
        expected = np.where(is_last, upper * self.records.sum(), np.nan)
        p_value = np.where(is_last, self.p_value(upper), np.nan)
        return table.assign(estimated_at_most=expected, p_value=p_value)


def replay(
    happens: Happens, records: Array, nearness: Array, generator: np.random.Generator, *, is_slow: bool
) -> Replays:
    """Replay a stratified sample of the records, and all of them if the vehicle is fast.

    If the vehicle has the event in some of the sample, similar records are replayed, too.

    Parameters
    ----------
    happens
        Function that returns whether the vehicle has the event in n encounters, shape (d, n).
    records
        The distinct records, shape (d, N).
    nearness
        How near each record comes to the event, shape (N,); a smaller value is nearer.
    generator
        Source of randomness.
    is_slow
        Whether the vehicle is known to be slow. Otherwise the time of the sample decides, so that the number
        of replayed records may depend on the computer.
    """
    order = np.argsort(nearness, kind="stable")
    ends = np.unique(np.ceil(np.array(SHARES) * len(order)).astype(int))
    strata = np.split(order, ends[:-1])
    sizes = [min(size, len(rows)) for size, rows in zip(SIZES[-len(strata) :], strata, strict=True)]
    drawn = [
        np.sort(generator.choice(rows, size, replace=False)) for rows, size in zip(strata, sizes, strict=True)
    ]
    chosen = np.concatenate(drawn)
    if not is_slow:
        happens(records[:, chosen[:1]])  # the first call may compile or load something
    begun = time.perf_counter()
    happened = happens(records[:, chosen])
    is_fast = not is_slow and time.perf_counter() - begun < FAST * len(chosen)
    similar, others = _follow(happens, records, chosen, happened)
    known = records[:, np.append(chosen, similar)], np.append(happened, others)
    if is_fast:
        everything = _all(happens, records)
        one = np.array([len(everything)])
        return Replays(one, one, np.array([everything.sum()]), int(everything.sum()), one[0], *known)
    return Replays(
        np.array([len(rows) for rows in strata]),
        np.array(sizes),
        np.array([part.sum() for part in np.split(happened, np.cumsum(sizes)[:-1])]),
        int(known[1].sum()),
        len(known[1]),
        *known,
    )


def _all(happens: Happens, records: Array) -> NDArray[np.bool_]:
    """Return whether the event happens in each record."""
    size = records.shape[1]
    starts = tqdm(range(0, size, CHUNK), desc="records replayed", unit_scale=CHUNK, disable=None, delay=1)
    return np.concatenate([happens(records[:, start : start + CHUNK]) for start in starts])


def _follow(
    happens: Happens, records: Array, chosen: NDArray[np.intp], happened: NDArray[np.bool_]
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Replay the records that are most similar to those with the event, and then those similar to new events.

    The distance is Euclidean, after division of each variable by its standard deviation. The result is the
    rows of at most `FOLLOWED` records, and whether they ended with the event.
    """
    scaled = records / np.maximum(records.std(axis=1, keepdims=True), np.finfo(float).tiny)
    is_new = np.ones(records.shape[1], bool)
    is_new[chosen] = False
    rows, flags = np.empty(0, np.intp), np.empty(0, bool)
    events = chosen[happened].tolist()
    while events and len(rows) < FOLLOWED:
        event = events.pop(0)
        left = np.flatnonzero(is_new)
        distance = np.linalg.norm(scaled[:, left] - scaled[:, [event]], axis=0)
        near = left[np.argsort(distance, kind="stable")[: min(SIMILAR, FOLLOWED - len(rows))]]
        is_new[near] = False
        found = happens(records[:, near]) if len(near) else np.empty(0, bool)
        rows, flags = np.append(rows, near), np.append(flags, found)
        events += near[found].tolist()
    return rows, flags
