"""Tests of independence of the variables of cut-ins, and the similarity of segments."""

import math
from collections.abc import Callable
from itertools import combinations

import numpy as np
import pandas as pd

from accelerated_evaluation.records.segments import segment_counts

VARIABLES = ("lead_speed", "inverse_range", "inverse_ttc")
BLOCKS = 30
CONFIDENCE = 0.95
QUANTILES = (0.5, 0.9, 0.95, 0.99)


def dependence(encounters: pd.DataFrame) -> pd.DataFrame:
    """Return Kendall's tau-b of each pair of variables in each segment, with a confidence interval.

    The rows are in the order of the record. The intervals are valid for dependent variables and for rows that
    are not independent (block jackknife). Tau is NaN if a variable is constant, and the interval is NaN if
    there are fewer than two rows per block.
    """
    table = []
    for segment in segment_counts(encounters)["segment"]:
        rows = encounters[encounters["segment"] == segment]
        for pair in combinations(VARIABLES, 2):
            x, y = (rows[name].to_numpy() for name in pair)
            tau, half_width = tau_interval(x, y)
            table.append((segment, " vs ".join(pair), tau, tau - half_width, tau + half_width, len(rows)))
    return pd.DataFrame(table, columns=["segment", "pair", "tau", "ci_low", "ci_high", "n"])


def tau_interval(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Return Kendall's tau-b of x and y, each of shape (n,), and the half-width of its confidence interval.

    The interval is symmetric, from the error of `jackknife` and Student's t with 29 degrees of freedom. It
    assumes neither that tau is zero nor that rows are independent.
    """
    # Imported here, because it takes half a second, which every job of the study would pay.
    from scipy.stats import kendalltau, t

    def tau(kept: np.ndarray) -> float:
        return kendalltau(x[kept], y[kept]).statistic

    value, standard_error = jackknife(tau, len(x))
    return value, t.ppf((1 + CONFIDENCE) / 2, BLOCKS - 1) * standard_error


def similarity(encounters: pd.DataFrame) -> pd.DataFrame:
    """Compare quantiles of TTC^-1 [1/s] between the segments; the ratio is one if the segments are alike.

    The rows are in the order of the record. The ratio is that of the largest to the smallest value. Its
    interval is from the errors of `jackknife` of both logarithms, and allows for the choice of the two
    segments among all pairs (Bonferroni).
    """
    from scipy.stats import t

    of_segments = {name: rows["inverse_ttc"].to_numpy() for name, rows in encounters.groupby("segment")}
    pairs = max(math.comb(len(of_segments), 2), 1)
    reach, table = t.ppf(1 - (1 - CONFIDENCE) / (2 * pairs), BLOCKS - 1), []
    for level in QUANTILES:
        found = {
            name: jackknife(lambda kept, x=x, level=level: np.log(np.quantile(x[kept], level)), len(x))
            for name, x in of_segments.items()
        }
        high, low = (choose(found, key=lambda name: found[name][0]) for choose in (max, min))
        ratio = found[high][0] - found[low][0]
        half_width = reach * np.hypot(found[high][1], found[low][1]) if high != low else 0.0
        values = [found[high][0], found[low][0], ratio, ratio - half_width, ratio + half_width]
        table.append((level, high, low, *np.exp(values)))
    columns = ["quantile", "largest_in", "smallest_in", "largest", "smallest", "ratio", "ci_low", "ci_high"]
    return pd.DataFrame(table, columns=columns)


def jackknife(statistic: Callable[[np.ndarray], float], rows: int) -> tuple[float, float]:
    """Return a statistic of all rows, and its standard error from leaving out blocks of consecutive rows.

    The statistic is a function of the indices of the rows that are kept. One of 30 blocks is left out at a
    time (Kuensch 1989, Annals of Statistics 17, 1217), because repeated rows and similar rows of one trip
    belong to the same block. The error is NaN if there are fewer than two rows per block.
    """
    everything = np.arange(rows)
    value = statistic(everything)
    if rows < 2 * BLOCKS:
        return value, np.nan
    without = [statistic(np.delete(everything, block)) for block in np.array_split(everything, BLOCKS)]
    return value, float(np.sqrt((BLOCKS - 1) * np.var(without)))
