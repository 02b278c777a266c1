"""Compare the recorded numbers of critical cut-ins with the numbers that the laws predict."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from math import isfinite

import numpy as np
import pandas as pd
import scipy  # loads scipy.stats where it is used, because this takes half a second
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from accelerated_evaluation.answer.candidates.scores import (
    Fold,
    GivenLaw,
    HeldOut,
    contiguous_folds,
    forward_folds,
)
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.support import SUPPORT, Support

LIMITS = (0.05, 0.95)
# Cells of range and closing speed: for each interval of the range [m] the lower ends of the cells [m/s]. The
# last cell has no upper end. The closing speeds rise with the range, like those at which the car under test
# crashes, and the cells contain from hundreds of records down to none.
CELLS = {
    (0, 5): (1, 2, 3),
    (5, 10): (3, 5, 7),
    (10, 15): (5, 7, 9),
    (15, 20): (7, 9, 11),
    (20, 30): (8, 10, 12),
    (30, 45): (10, 12, 14.5),
    (45, 60): (12, 14, 16),
    (60, 75): (13, 15, 18),
}
# Cells of lead speed and host speed: number of equal intervals of the lead speed, and the lower ends of the
# cells as host speeds above the upper end of the interval [m/s]. The last cell has no upper end. The cells
# contain from thousands of records down to none.
LEAD_SPEEDS, HOST_SPEEDS = 8, (0, 3, 6, 9, 12)
LEAST_EXPECTED = 1.0  # records in a cell, from which on its square has a moderate variance
TENTHS = "tenths"
# Divisions of the records, by their names in tables.
DIVISIONS: Mapping[str, Callable[[int], list[Fold]]] = {
    "halves": partial(contiguous_folds, blocks=2),
    "quarters": partial(contiguous_folds, blocks=4),
    TENTHS: contiguous_folds,
    "later tenths, from all records before": forward_folds,
}
CLOSING, HOST, REPLAYED = "closing speed", "host speed", "replay"  # kinds of counts


@dataclass(frozen=True)
class Strip:
    """A strip of the cut-ins, which consists of adjacent cells.

    A strip is an interval of one variable, the range or the lead speed. Values of a speed divide it into
    cells.
    """

    counted: str  # the speed that divides the interval: `CLOSING` for a range, `HOST` for a lead speed
    interval: tuple[float, float]  # ends of the range [m] or of the lead speed [m/s], both included
    speeds: tuple[float, ...]  # lower ends of the cells [m/s]; the last cell has no upper end

    @property
    def names(self) -> list[str]:
        """Names of the cells in tables: the interval of the strip, and the speeds that limit the cell."""
        low, high = self.interval
        unit, what = ("m", "R") if self.counted == CLOSING else ("m/s", "v_L")
        begin = f"{what} {low:g} to {high:g} {unit}, {'' if self.counted == CLOSING else 'host '}"
        return [
            f"{begin}{slow:g} to {fast:g} m/s" if isfinite(fast) else f"{begin}above {slow:g} m/s"
            for slow, fast in pairwise((*self.speeds, np.inf))
        ]

    def inside(self, records: DistinctRecords) -> NDArray[np.intp]:
        """Return the indices of the records whose range or lead speed is in the interval of the strip."""
        variable = records.range_ if self.counted == CLOSING else records.lead_speed
        low, high = self.interval
        return np.flatnonzero((variable >= low) & (variable <= high))

    def ends(self, records: DistinctRecords) -> list[Array]:
        """Return the closing speeds [m/s] that separate the cells, for each record.

        The list contains the lower end of each cell and infinity, in rising order; each of its arrays has
        shape (records,).
        """
        of_host = np.zeros(records.size) if self.counted == CLOSING else records.lead_speed
        return [np.maximum(speed - of_host, 0.0) for speed in (*self.speeds, np.inf)]


def strips(support: Support = SUPPORT) -> list[Strip]:
    """Return the strips whose predicted and recorded cut-ins are compared, by ranges and by lead speeds."""
    within = [(ends, speeds) for ends, speeds in CELLS.items() if ends[0] < support.range_max]
    near = [
        Strip(CLOSING, (low, high if (low, high) != within[-1][0] else support.range_max), speeds)
        for (low, high), speeds in within
    ]
    edges = np.linspace(*support.lead_speeds, LEAD_SPEEDS + 1).tolist()
    return near + [
        Strip(HOST, ends, tuple(ends[1] + step for step in HOST_SPEEDS)) for ends in pairwise(edges)
    ]


def recorded_counts(records: DistinctRecords) -> pd.DataFrame:
    """Count the records in each cell of the cut-ins.

    The cells are rectangles of range and closing speed, and of lead speed and host speed. The columns are the
    name of the cell (``where``), the speed by which cells are divided (``counted``), and the number
    ``recorded``.
    """
    counts = []
    for strip in strips(records.support):
        part = records.only(strip.inside(records))
        for name, (low, high) in zip(strip.names, pairwise(strip.ends(part)), strict=True):
            inside = (part.closing_speed >= low) & (part.closing_speed < high)
            counts.append((name, strip.counted, int(inside.sum())))
    return pd.DataFrame(counts, columns=["where", "counted", "recorded"])


def expected_counts(records: DistinctRecords, given: Callable[[Places], Iterable[GivenLaw]]) -> Array:
    """Return the expected number of records in each cell of `recorded_counts`, shape (laws, cells).

    The expected number is conditional on the lead speeds and ranges of the records. The function ``given``
    returns the distributions of the closing speed, one for each law, at given pairs of lead speed and range.
    It is called with the records of one strip of cells at a time, which limits the memory.
    """
    expected = []
    for strip in strips(records.support):
        part = records.only(strip.inside(records))
        ends = strip.ends(part)
        expected.append([_expected(law, ends) for law in given(part.places)])
    return np.concatenate(expected, axis=1)


def counts_by_fold(held_out: HeldOut) -> Array:
    """Return the expected number of records of each fold in each cell, shape (laws, folds, cells).

    The laws do not know the records of the fold.
    """
    pairs = zip(held_out.folds, held_out.given, strict=True)
    found = [expected_counts(held_out.records.only(fold.tested), given) for fold, given in pairs]
    return np.stack(found, axis=1)


def recorded_by_fold(records: DistinctRecords, folds: Sequence[Fold]) -> Array:
    """Return the number of records of each fold in each cell, shape (folds, cells)."""
    return np.stack([recorded_counts(records.only(fold.tested))["recorded"] for fold in folds])


def _expected(law: GivenLaw, ends: list[Array]) -> list[float]:
    """Return the expected number of records between each pair of ends, of which the last one is infinite."""
    faster = [*(np.exp(-law.cumulative(end)) for end in ends[:-1]), np.zeros(ends[-1].size)]
    return [float(np.sum(low - high)) for low, high in pairwise(faster)]


def fold_row(recorded: Array, expected: Array) -> dict[str, float]:
    """Compare recorded and expected numbers of the cells of all folds, both of shape (folds, cells).

    If laws are fitted to counts, the sums over folds agree with the records by construction. The numbers of
    single folds need not, so that this comparison can fail.

    Returns
    -------
    dict
        The number of ``cells`` in all folds; how many recorded numbers are ``outside`` of their 90 % Poisson
        limits (`with_poisson_limits`), and how many would be ``by_chance`` if the numbers had Poisson
        distributions with the expected means; the ``dispersion``, which is the mean of
        (recorded - expected)^2 / expected over the cells in which at least `LEAST_EXPECTED` records are
        expected, with its expected value of 1 and its 95 % ``dispersion_limit`` for Poisson numbers; and
        whether the dispersion exceeds this limit (``overdispersed``). The laws are fitted to finite records,
        so that even with the right laws slightly more cells than ``by_chance`` are outside.
    """
    recorded, expected = np.ravel(recorded), np.ravel(expected)
    low, high = (scipy.stats.poisson.ppf(level, expected) for level in LIMITS)
    outside = (recorded < low) | (recorded > high)
    by_chance = scipy.stats.poisson.cdf(low - 1, expected) + scipy.stats.poisson.sf(high, expected)
    many = expected >= LEAST_EXPECTED
    squares = (recorded[many] - expected[many]) ** 2 / expected[many]
    # The variance of a square is 2 + 1 / expected.
    deviation = np.sqrt(np.sum(2 + 1 / expected[many])) / max(many.sum(), 1)
    dispersion = float(squares.mean()) if many.any() else np.nan
    limit = 1 + ndtri(LIMITS[1]) * deviation
    return {
        "cells": recorded.size,
        "outside": int(outside.sum()),
        "by_chance": float(by_chance.sum()),
        "dispersion": dispersion,
        "dispersion_limit": limit,
        "overdispersed": dispersion > limit,
    }


def near_miss_counts(
    recorded: Mapping[str, int], probability: Mapping[str, float], size: int
) -> pd.DataFrame:
    """Return a table of recorded and expected numbers of near misses, with a row for each.

    The recorded numbers are those of distinct cut-ins that end in the near miss if the vehicle replays them.
    The expected number is the probability times the number of records, ``size``.
    """
    rows = [(name, REPLAYED, count, size * probability[name]) for name, count in recorded.items()]
    return pd.DataFrame(rows, columns=["where", "counted", "recorded", "expected"])


def with_poisson_limits(counts: pd.DataFrame) -> pd.DataFrame:
    """Add Poisson limits to recorded and expected numbers.

    ``low`` and ``high`` are the 5 and 95 % quantiles of the Poisson distribution with the expected number as
    its mean, ``within`` says whether the recorded number is between them, and ``p_value`` is its two-sided
    mid-p value.
    """
    expected = counts["expected"].to_numpy()
    low, high = (scipy.stats.poisson.ppf(level, expected) for level in LIMITS)
    recorded = counts["recorded"].to_numpy()
    return counts.assign(
        low=low, high=high, within=(recorded >= low) & (recorded <= high), p_value=mid_p(recorded, expected)
    )


def mid_p(recorded: ArrayLike, expected: ArrayLike) -> Array:
    """Return two-sided mid-p values of Poisson counts with given means.

    A mid-p value includes half of the probability of the recorded count itself.
    """
    recorded, expected = np.asarray(recorded), np.asarray(expected, dtype=float)
    half = scipy.stats.poisson.pmf(recorded, expected) / 2
    below, above = (
        scipy.stats.poisson.cdf(recorded, expected) - half,
        scipy.stats.poisson.sf(recorded, expected) + half,
    )
    return np.minimum(2 * np.minimum(below, above), 1.0)
