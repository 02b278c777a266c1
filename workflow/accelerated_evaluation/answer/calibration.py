"""Recorded against expected counts near the crash set, with the limits that chance alone gives them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.stats import poisson

from accelerated_evaluation.answer.scores import GivenLaw
from accelerated_evaluation.base.arrays import Array
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
    """Ranges [m] and closing speeds [m/s], lower ends included; the last range includes its upper end too."""

    range_: tuple[float, float]
    closing_speed: tuple[float, float]

    @property
    def name(self) -> str:
        """How tables call it."""
        low, high = self.closing_speed
        speeds = f"{low:g} to {high:g}" if np.isfinite(high) else f"above {low:g}"
        return f"R {self.range_[0]:g} to {self.range_[1]:g} m, {speeds} m/s"

    def beside(self, range_: Array) -> Array:
        """Tell which ranges lie in the cell."""
        return (range_ >= self.range_[0]) & (range_ < np.nextafter(self.range_[1], np.inf))


def cells(range_max: float = SUPPORT.range_max) -> list[Cell]:
    """Return the cells up to the largest range [m], at which the last of them end."""
    within = [(ends, speeds) for ends, speeds in CELLS.items() if ends[0] < range_max]
    return [
        Cell((low, high if (low, high) != within[-1][0] else range_max), ends)
        for (low, high), speeds in within
        for ends in zip(speeds, (*speeds[1:], np.inf), strict=True)
    ]


def cell_counts(records: DistinctRecords, law: GivenLaw) -> pd.DataFrame:
    """Count records in the cells, and what a law expects there, given their lead speeds and ranges.

    Parameters
    ----------
    records
        Distinct cut-ins.
    law
        The law of the closing speed at their lead speeds and ranges.

    Returns
    -------
    pandas.DataFrame
        Columns ``where``, ``recorded`` and ``expected``.
    """
    rows = []
    for cell in cells(records.support.range_max):
        beside = cell.beside(records.range_)
        low, high = (np.full(records.size, speed) for speed in cell.closing_speed)
        inside = beside & (records.closing_speed >= low) & (records.closing_speed < high)
        expected = np.exp(-law.cumulative(low)) - np.exp(-law.cumulative(high))
        rows.append((cell.name, int(inside.sum()), float(expected[beside].sum())))
    return pd.DataFrame(rows, columns=["where", "recorded", "expected"])


def near_miss_counts(
    recorded: Mapping[str, int], probability: Mapping[str, float], size: int
) -> pd.DataFrame:
    """Put recorded near misses of replayed cut-ins beside what a law expects; columns as of `cell_counts`.

    Parameters
    ----------
    recorded
        Number of distinct cut-ins that end in the near miss when replayed, by its name.
    probability
        Of each near miss under the law.
    size
        Number of distinct cut-ins.
    """
    rows = [(name, count, size * probability[name]) for name, count in recorded.items()]
    return pd.DataFrame(rows, columns=["where", "recorded", "expected"])


def with_limits(counts: pd.DataFrame) -> pd.DataFrame:
    """Add the 90 % Poisson limits ``low`` and ``high``, ``within`` them, and the mid-p ``p_value``."""
    expected = counts["expected"].to_numpy()
    low, high = (poisson.ppf(level, expected) for level in LIMITS)
    recorded = counts["recorded"].to_numpy()
    return counts.assign(
        low=low, high=high, within=(recorded >= low) & (recorded <= high), p_value=mid_p(recorded, expected)
    )


def mid_p(recorded: ArrayLike, expected: ArrayLike) -> Array:
    """Return the two-sided mid-p values of Poisson counts: half of the probability of the count itself."""
    recorded, expected = np.asarray(recorded), np.asarray(expected, dtype=float)
    half = poisson.pmf(recorded, expected) / 2
    below, above = poisson.cdf(recorded, expected) - half, poisson.sf(recorded, expected) + half
    return np.minimum(2 * np.minimum(below, above), 1.0)
