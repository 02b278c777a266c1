"""Checks whether one row is one cut-in: repeated and nearly repeated rows, and stuck sensors.

The number of equal values that occur by chance depends on the resolution of the records, which is not stated.
It is estimated from pairs of rows that are so far apart that they belong to different cut-ins.
"""

import numpy as np
import pandas as pd
from scipy.stats import poisson

from accelerated_evaluation.records.checks import (
    CHECKS,
    FINE,
    LEVEL,
    STOP,
    WARNING,
    Finding,
    Records,
    by_share,
)

MEASURED = ["lead_speed", "range", "closing_speed"]
RESOLUTION = np.array([0.1, 0.2, 0.1])  # [m/s], [m], [m/s]: of the radars of cars
FAR = (0.23, 0.31, 0.43)  # distances, as shares of the record, between rows of different cut-ins


@CHECKS.add("repeated_rows")
def repeated_rows(records: Records) -> Finding:
    """Check for rows that are equal to the row before them."""
    rows = records.valid.index.difference(records.distinct.index)
    share = len(rows) / max(len(records.valid), 1)
    return Finding(
        FINE if len(rows) == 0 else STOP if share > 0.5 else WARNING,
        "rows equal to the row before them; if most are, a row is a time step and no cut-in",
        f"{len(rows):,} of {len(records.valid):,} rows ({share:.1%})",
        len(rows),
        "Find out whether one cut-in was written twice. The answer counts them once, the paper's models "
        "twice unless data.repeated_rows is drop.",
        list(rows),
    )


@CHECKS.add("rows_repeated_elsewhere")
def rows_repeated_elsewhere(records: Records) -> Finding:
    """Check for rows that are equal to an earlier row that is not the row before.

    Their number is compared with the number of equal rows after one column has been shifted.
    """
    rows = records.distinct[MEASURED].round(9)
    found = rows.index[rows.duplicated()]
    shifted = rows.assign(range=np.roll(rows["range"], len(rows) // 3))
    chance = max(int(shifted.duplicated().sum()), 1)
    return Finding(
        _against_chance(len(found), chance, len(rows)),
        "rows equal to one farther up, beside as many as chance gives at this resolution",
        f"{len(found):,} rows; {chance:,} or fewer by chance",
        len(found),
        "Remove files or blocks that were appended twice.",
        list(found),
    )


@CHECKS.add("nearly_repeated_rows")
def nearly_repeated_rows(records: Records) -> Finding:
    """Check for rows that differ from the row before them by no more than the resolution of sensors."""
    rows = records.distinct[MEASURED].to_numpy()
    near = np.concatenate([[False], _near(rows, 1)])
    chance = max(np.mean([_near(rows, lag).sum() for lag in _lags(len(rows))]), 1.0)
    found = records.distinct.index[near]
    return Finding(
        _against_chance(len(found), chance, len(rows)),
        "rows within 0.1 m/s, 0.2 m and 0.1 m/s of the row before them, the resolution of radars, beside as "
        "many as rows far apart give",
        f"{len(found):,} rows; {chance:.1f} or fewer by chance",
        len(found),
        "See whether one cut-in is recorded by several targets or time steps, and keep one row of each.",
        list(found),
    )


@CHECKS.add("stuck_sensor")
def stuck_sensor(records: Records) -> Finding:
    """Check for one quantity that is the same as in the row before while another quantity changes."""
    rows, worst = records.distinct, (1.0, MEASURED[0], 0, pd.Index([]))
    for name in MEASURED:
        values = rows[name].to_numpy()
        stuck = np.concatenate([[False], values[1:] == values[:-1]])
        chance = max(np.mean([(values[lag:] == values[:-lag]).sum() for lag in _lags(len(values))]), 1.0)
        p = float(poisson.sf(stuck.sum() - 1, chance))
        worst = min(worst, (p, name, int(stuck.sum()), rows.index[stuck]), key=lambda entry: entry[0])
    p, name, count, found = worst
    is_chance = p * len(MEASURED) >= LEVEL
    return Finding(
        FINE if is_chance else by_share(count, len(rows)),
        "rows with the same value of one quantity as the row before, while another changes",
        f"{name.replace('_', ' ')} in {count:,} rows (p = {p:.2g})",
        count,
        "Look for a sensor that kept its last value, and leave these rows out.",
        () if is_chance else list(found),
    )


def _lags(size: int) -> list[int]:
    return [max(int(share * size), 1) for share in FAR]


def _near(rows: np.ndarray, lag: int) -> np.ndarray:
    """Return which rows equal the row ``lag`` before them, within the resolution; shape (n - lag,)."""
    return (np.abs(rows[lag:] - rows[:-lag]) <= RESOLUTION).all(axis=1)


def _against_chance(count: int, chance: float, size: int) -> str:
    """Return the verdict on a count: ``fine`` if chance gives as many at the test level."""
    return FINE if poisson.sf(count - 1, chance) >= LEVEL else by_share(count, size)
