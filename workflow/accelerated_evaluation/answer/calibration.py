"""Recorded and expected counts near the crash set, with limits for random variation."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import groupby

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.stats import poisson

from accelerated_evaluation.answer.scores import GivenLaw
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.support import SUPPORT

LIMITS = (0.05, 0.95)
# Ranges [m] with the closing speeds [m/s] that cut them into cells, the last without an end; they rise with
# the range as the closing speeds at which the study's car crashes do, and hold from hundreds of records
# down to none.
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


@dataclass(frozen=True)
class Cell:
    """Ranges [m] and closing speeds [m/s], lower ends included.

    The last range also includes its upper end.
    """

    range_: tuple[float, float]
    closing_speed: tuple[float, float]

    @property
    def name(self) -> str:
        """The name of the cell in tables."""
        low, high = self.closing_speed
        speeds = f"{low:g} to {high:g}" if np.isfinite(high) else f"above {low:g}"
        return f"R {self.range_[0]:g} to {self.range_[1]:g} m, {speeds} m/s"

    def beside(self, range_: Array) -> Array:
        """Return which ranges lie in the cell."""
        return (range_ >= self.range_[0]) & (range_ < np.nextafter(self.range_[1], np.inf))


def cells(range_max: float = SUPPORT.range_max) -> list[Cell]:
    """Return the cells up to the largest range [m]."""
    within = [(ends, speeds) for ends, speeds in CELLS.items() if ends[0] < range_max]
    return [
        Cell((low, high if (low, high) != within[-1][0] else range_max), ends)
        for (low, high), speeds in within
        for ends in zip(speeds, (*speeds[1:], np.inf), strict=True)
    ]


def cell_counts(
    records: DistinctRecords, given: Callable[[Places], Iterable[GivenLaw]]
) -> list[pd.DataFrame]:
    """Return the number of records in each cell, and the number that each law expects.

    The expected number is conditional on the lead speeds and ranges of the records.

    Parameters
    ----------
    records
        Distinct cut-ins.
    given
        Function that returns the laws of the closing speed at places. It is called with the places of the
        records of one interval of ranges at a time, which bounds the memory.

    Returns
    -------
    list of pandas.DataFrame
        For each law the columns ``where``, ``recorded`` and ``expected``.
    """
    counts, expected = [], []
    for _, cells_ in groupby(cells(records.support.range_max), key=lambda cell: cell.range_):
        of_range = list(cells_)
        part = records.only(np.flatnonzero(of_range[0].beside(records.range_)))
        ends = [[np.full(part.size, speed) for speed in cell.closing_speed] for cell in of_range]
        for cell, (low, high) in zip(of_range, ends, strict=True):
            inside = (part.closing_speed >= low) & (part.closing_speed < high)
            counts.append((cell.name, int(inside.sum())))
        expected.append(
            [
                [
                    float(np.sum(np.exp(-law.cumulative(low)) - np.exp(-law.cumulative(high))))
                    for low, high in ends
                ]
                for law in given(part.places)
            ]
        )
    table = pd.DataFrame(counts, columns=["where", "recorded"])
    return [table.assign(expected=np.concatenate(of_law)) for of_law in zip(*expected, strict=True)]


def near_miss_counts(
    recorded: Mapping[str, int], probability: Mapping[str, float], size: int
) -> pd.DataFrame:
    """Return recorded and expected numbers of near misses of replayed cut-ins; columns as of `cell_counts`.

    Parameters
    ----------
    recorded
        Number of distinct cut-ins that end in the near miss when they are replayed, by its name.
    probability
        Probability of each near miss under the law.
    size
        Number of distinct cut-ins.
    """
    rows = [(name, count, size * probability[name]) for name, count in recorded.items()]
    return pd.DataFrame(rows, columns=["where", "recorded", "expected"])


def with_limits(counts: pd.DataFrame) -> pd.DataFrame:
    """Add the 90 % Poisson limits ``low`` and ``high``, ``within`` (inside the limits), and ``p_value``.

    The p-value is a two-sided mid-p value.
    """
    expected = counts["expected"].to_numpy()
    low, high = (poisson.ppf(level, expected) for level in LIMITS)
    recorded = counts["recorded"].to_numpy()
    return counts.assign(
        low=low, high=high, within=(recorded >= low) & (recorded <= high), p_value=mid_p(recorded, expected)
    )


def mid_p(recorded: ArrayLike, expected: ArrayLike) -> Array:
    """Return two-sided mid-p values of Poisson counts.

    A mid-p value includes half of the probability of the count itself.
    """
    recorded, expected = np.asarray(recorded), np.asarray(expected, dtype=float)
    half = poisson.pmf(recorded, expected) / 2
    below, above = poisson.cdf(recorded, expected) - half, poisson.sf(recorded, expected) + half
    return np.minimum(2 * np.minimum(below, above), 1.0)
