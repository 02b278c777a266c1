"""Replays of the records: events that the sampler has missed, and cut-ins that a driver would avoid.

The records are a sample from the law, and no sampler has chosen them. If the vehicle under test has the event
in more of them than the estimate allows, the estimate is wrong: the sampler has not found a part of the
event, or the law does not describe the records.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray
from tqdm import tqdm

from accelerated_evaluation.base.arrays import Array

LEVEL = 0.01  # significance level of the comparison with the estimate
# The records are sorted by how near another vehicle came to the event. The strata end at these shares, and a
# slow vehicle replays so many records of each. What a small stratum cannot use, the last one receives. Most
# replays are of records that a careful vehicle survives easily: a lapse, such as a target that is recognised
# late, may happen in each of them, and shows there by an event that nothing else explains.
SHARES, SIZES = (0.001, 0.01, 0.1, 1.0), (10, 20, 40, 30)
CONFIDENCE = 0.95  # of the bound on the share of the records with an event that no replay has shown
SIMILAR = 10  # number of similar records that are replayed after each event,
FOLLOWED = 40  # and their largest number in total
FAST = 1e-3  # [s]; a vehicle that takes less for a run replays all records
CHUNK = 10_000  # number of records that are replayed at a time
PART = 20  # the same for a slow vehicle, whose outcomes are stored each time, so that few can be lost

Happens = Callable[[Array], NDArray[np.bool_]]


@dataclass(frozen=True)
class Replays:
    """The records that a vehicle has replayed."""

    records: NDArray[np.intp]  # number of distinct records in each stratum, the nearest to the event first
    sampled: NDArray[np.intp]  # number of records drawn at random from each stratum
    events: NDArray[np.intp]  # number of events among those
    replayed: int  # number of all replayed records, some of which are similar to records with the event
    # The records of the stratified sample and those similar to its events, (d, n); they guide the sampler.
    encounters: Array
    flags: NDArray[np.bool_]  # whether they ended with the event, (n,)
    with_event: Array  # the replayed records with the event, (d, happened)

    @property
    def happened(self) -> int:
        """Number of events in all replayed records."""
        return self.with_event.shape[1]

    @property
    def share_at_most(self) -> float:
        """Upper confidence limit of the share of the records that end with the event if all are replayed.

        The limits of Clopper and Pearson in the strata are added, each at the level of Bonferroni. Nothing is
        assumed about which records end with the event, or whether it happens by chance. A stratum of which
        all records were replayed has no uncertainty.
        """
        level = 1 - (1 - CONFIDENCE) / len(self.records)
        missed = scipy.stats.beta.ppf(level, self.events + 1, np.maximum(self.sampled - self.events, 1))
        missed = np.where(self.sampled > self.events, missed, 1.0)
        shares = np.where(self.sampled == self.records, self.events / self.records, missed)
        return float(np.average(shares, weights=self.records))

    def allowed(self, upper: float) -> float:
        """Return the largest expected number of events in the random sample of the records.

        The event has at most the probability ``upper``, and all its events in the records may lie in the
        stratum of which the largest share was sampled.
        """
        return float(upper * self.records.sum() * np.max(self.sampled / self.records))

    def p_value(self, upper: float, lower: float = 0.0) -> float:
        """Return the p-value of the hypothesis that the event has a probability from ``lower`` to ``upper``.

        All events of the law may lie in one stratum, so the probability in a stratum is at most that of all
        records times the inverse share of the stratum. All events in the replayed records are at most those
        in all records, however the replayed ones were chosen. The smallest p-value is multiplied by the
        number of tests. If there is a lower limit, so few events are compared with it, too: all events of the
        law may lie in the stratum that shows them worst.
        """
        most = upper * self.records.sum()
        inside = np.minimum(most / self.records, 1.0)
        tests = [*scipy.stats.binom.sf(self.events - 1, self.sampled, inside)]
        tests.append(scipy.stats.poisson.sf(self.happened - 1, most))
        if lower > 0:
            expected = np.minimum(lower * self.records.sum() / self.records, 1.0)
            tests.append(scipy.stats.binom.cdf(self.events, self.sampled, expected).max())
        return float(min(1.0, min(tests) * len(tests)))

    def table(self, upper: float, lower: float = 0.0) -> pd.DataFrame:
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
        p_value = np.where(is_last, self.p_value(upper, lower), np.nan)
        return table.assign(estimated_at_most=expected, p_value=p_value)


def replay(
    happens: Happens, records: Array, nearness: Array, generator: np.random.Generator, *, is_slow: bool
) -> Replays:
    """Replay a stratified sample of the records, and all of them if the vehicle is fast.

    If the vehicle has the event in some of the sample, similar records are replayed, too. ``happens`` returns
    whether the vehicle has the event in encounters of shape (d, n). A smaller nearness is nearer to the
    event. If the vehicle is not known to be slow, the time of the sample decides, so that the number of
    replayed records may depend on the computer.
    """
    order = np.argsort(nearness, kind="stable")
    ends = np.unique(np.ceil(np.array(SHARES) * len(order)).astype(int))
    strata = np.split(order, ends[:-1])
    sizes = [min(size, len(rows)) for size, rows in zip(SIZES[-len(strata) :], strata, strict=True)]
    sizes[-1] = min(len(strata[-1]), sum(SIZES) - sum(sizes[:-1]))
    drawn = [
        np.sort(generator.choice(rows, size, replace=False)) for rows, size in zip(strata, sizes, strict=True)
    ]
    chosen = np.concatenate(drawn)
    if not is_slow:
        happens(records[:, chosen[:1]])  # the first call may compile or load something
    begun = time.perf_counter()
    happened = _all(happens, records[:, chosen], PART if is_slow else CHUNK)
    is_fast = not is_slow and time.perf_counter() - begun < FAST * len(chosen)
    similar, others = _follow(happens, records, chosen, happened)
    known = records[:, np.append(chosen, similar)], np.append(happened, others)
    if is_fast:
        everything = _all(happens, records, CHUNK)
        one = np.array([len(everything)])
        return Replays(one, one, np.array([everything.sum()]), one[0], *known, records[:, everything])
    return Replays(
        np.array([len(rows) for rows in strata]),
        np.array(sizes),
        np.array([part.sum() for part in np.split(happened, np.cumsum(sizes)[:-1])]),
        len(known[1]),
        *known,
        known[0][:, known[1]],
    )


def _all(happens: Happens, records: Array, step: int) -> NDArray[np.bool_]:
    """Return whether the event happens in each record; so many records are replayed at a time."""
    size = records.shape[1]
    starts = tqdm(range(0, size, step), desc="records replayed", unit_scale=step, disable=None, delay=1)
    return np.concatenate([happens(records[:, start : start + step]) for start in starts])


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
