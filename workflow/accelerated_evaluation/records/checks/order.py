"""Checks for a drift of the records from the first row to the last."""

import numpy as np
from scipy.stats import norm

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.records.checks import (
    CHECKS,
    CUT_INS,
    FINE,
    LEVEL,
    STOP,
    WARNING,
    Finding,
    Records,
    needs,
)

DRIFTING = ("lead_speed", "range", "inverse_ttc")
BLOCKS = 10  # number of blocks of consecutive rows in a third of the record, for the jackknife
MEDIUM = 0.5  # difference of means in standard deviations, a medium effect (Cohen 1988)


@CHECKS.add("drift")
@needs(*CUT_INS)
def drift(records: Records) -> Finding:
    """Test whether the first and the last third of the rows have the same distribution.

    The statistic of each variable is the probability that a value of the last third is larger than a value of
    the first third. Its standard error comes from a jackknife over blocks of consecutive rows, because rows
    of one trip are similar. The test level is divided by the number of variables (Bonferroni). The verdict is
    ``stop`` if a significant difference is larger than a medium effect. The number is the statistic of the
    variable with the most significant difference.
    """
    rows = records.closing
    looked_at = "chance that a value of the last third of the rows is larger than one of the first third"
    third = len(rows) // 3
    if third < 2 * BLOCKS:
        return Finding(FINE, looked_at, "too few rows for a test", 0.5)
    found = {}
    for name in DRIFTING:
        values = rows[name].to_numpy()
        found[name] = _superiority(values[:third], values[-third:])
    critical = norm.isf(LEVEL / 2 / len(DRIFTING))
    name = max(found, key=lambda name: abs(found[name][0] - 0.5) / found[name][1])
    chance, error = found[name]
    large = max(abs(value - 0.5) for value, _ in found.values()) > norm.cdf(MEDIUM / np.sqrt(2)) - 0.5
    drifts = abs(chance - 0.5) > critical * error
    return Finding(
        FINE if not drifts else STOP if large else WARNING,
        looked_at,
        "; ".join(
            f"{key.replace('_', ' ')} {p:.3f} +- {deviation:.3f}" for key, (p, deviation) in found.items()
        ),
        chance,
        "Plot the columns in the order of the rows: other places, vehicles, seasons, or a sensor that loses "
        "its calibration? The intervals assume that all rows are from one population.",
    )


def _superiority(first: Array, last: Array) -> tuple[float, float]:
    """Return the probability that a value of ``last`` exceeds one of ``first``, and its standard error."""
    blocks = [np.array_split(values, BLOCKS) for values in (first, last)]
    wins = np.array([[_wins(a, b) for b in blocks[1]] for a in blocks[0]])
    all_but = BLOCKS * (BLOCKS - 1)
    without = [(wins.sum() - wins.sum(axis=axis)) / all_but for axis in (0, 1)]
    variance = sum((BLOCKS - 1) * np.var(part) for part in without)
    return float(wins.mean()), float(np.sqrt(variance)) or np.finfo(float).tiny


def _wins(first: Array, last: Array) -> float:
    """Return the share of the pairs in which the value of ``last`` is larger; ties count by half."""
    ordered = np.sort(first)
    below = np.searchsorted(ordered, last, side="left") + np.searchsorted(ordered, last, side="right")
    return float(below.mean() / (2 * ordered.size))
