"""Recorded and expected counts near the crash set, with limits for random variation."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.stats import poisson

from accelerated_evaluation.answer.scores import GivenLaw
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.support import SUPPORT, Support

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
# Number of equal intervals of the lead speed, and host speeds [m/s] above the upper end of an interval that
# cut it into cells, the last without an end: from thousands of records down to none.
LEAD_SPEEDS, HOST_SPEEDS = 8, (0, 3, 6, 9, 12)
CLOSING, HOST, REPLAYED = "closing speed", "host speed", "replay"  # what is counted


@dataclass(frozen=True)
class Strip:
    """Cells next to each other: records with one variable in an interval, cut by the values of a speed.

    Attributes
    ----------
    counted
        The speed that cuts: `CLOSING` in an interval of the range, or `HOST` in one of the lead speed.
    interval
        Of the range [m] or the lead speed [m/s]; both ends are included.
    speeds
        The lower ends of the cells [m/s]; the last cell has no upper end.
    """

    counted: str
    interval: tuple[float, float]
    speeds: tuple[float, ...]

    @property
    def names(self) -> list[str]:
        """The names of the cells in tables."""
        low, high = self.interval
        unit, what = ("m", "R") if self.counted == CLOSING else ("m/s", "v_L")
        begin = f"{what} {low:g} to {high:g} {unit}, {'' if self.counted == CLOSING else 'host '}"
        return [
            f"{begin}{slow:g} to {fast:g} m/s" if isfinite(fast) else f"{begin}above {slow:g} m/s"
            for slow, fast in pairwise((*self.speeds, np.inf))
        ]

    def inside(self, records: DistinctRecords) -> NDArray[np.intp]:
        """Return the indices of the records in the interval."""
        variable = records.range_ if self.counted == CLOSING else records.lead_speed
        low, high = self.interval
        return np.flatnonzero((variable >= low) & (variable <= high))

    def ends(self, records: DistinctRecords) -> list[Array]:
        """Return the closing speeds [m/s] between the cells for each record, from the slowest cell on."""
        of_host = np.zeros(records.size) if self.counted == CLOSING else records.lead_speed
        return [np.maximum(speed - of_host, 0.0) for speed in (*self.speeds, np.inf)]


def strips(support: Support = SUPPORT) -> list[Strip]:
    """Return the cells of ranges and closing speeds, and those of lead and host speeds, within limits."""
    within = [(ends, speeds) for ends, speeds in CELLS.items() if ends[0] < support.range_max]
    near = [
        Strip(CLOSING, (low, high if (low, high) != within[-1][0] else support.range_max), speeds)
        for (low, high), speeds in within
    ]
    edges = np.linspace(*support.lead_speeds, LEAD_SPEEDS + 1).tolist()
    return near + [
        Strip(HOST, ends, tuple(ends[1] + step for step in HOST_SPEEDS)) for ends in pairwise(edges)
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
        records of one strip of cells at a time, which bounds the memory.

    Returns
    -------
    list of pandas.DataFrame
        For each law the columns ``where``, ``counted`` (which speed), ``recorded`` and ``expected``.
    """
    counts, expected = [], []
    for strip in strips(records.support):
        part = records.only(strip.inside(records))
        ends = strip.ends(part)
        for name, (low, high) in zip(strip.names, pairwise(ends), strict=True):
            inside = (part.closing_speed >= low) & (part.closing_speed < high)
            counts.append((name, strip.counted, int(inside.sum())))
        expected.append([_expected(law, ends) for law in given(part.places)])
    table = pd.DataFrame(counts, columns=["where", "counted", "recorded"])
    return [table.assign(expected=np.concatenate(of_law)) for of_law in zip(*expected, strict=True)]


def _expected(law: GivenLaw, ends: list[Array]) -> list[float]:
    """Return the expected number of records between each pair of ends."""
    faster = [np.exp(-law.cumulative(end)) for end in ends]
    return [float(np.sum(low - high)) for low, high in pairwise(faster)]


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
    rows = [(name, REPLAYED, count, size * probability[name]) for name, count in recorded.items()]
    return pd.DataFrame(rows, columns=["where", "counted", "recorded", "expected"])


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
