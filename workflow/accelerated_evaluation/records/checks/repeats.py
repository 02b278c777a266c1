"""Checks whether each row is a different cut-in, and of the number of drivers or devices.

The number of equal values that occur by chance depends on the resolution of the records, which is unknown. It
is estimated from pairs of rows that are so far apart in the record that they belong to different cut-ins.
"""

import numpy as np
import pandas as pd
from scipy.stats import poisson

from accelerated_evaluation.base.numerals import counted
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.base.tables import CLUSTER
from accelerated_evaluation.records.checks import (
    CHECKS,
    FINE,
    LEVEL,
    ORDER,
    STOP,
    WARNING,
    Finding,
    Records,
    by_share,
    needs,
)

FEW_CLUSTERS = 20  # effective number of clusters below which bootstrap intervals over clusters are too short
RESOLUTION = {"m/s": 0.1, "m": 0.2}  # of automotive radars; variables in other units must be equal
FAR = (0.23, 0.31, 0.43)  # distances between rows of different cut-ins, as shares of the length of the record


@CHECKS.add("clusters")
@needs(CLUSTER)
def clusters(records: Records) -> Finding:
    """Check by their effective number, n² / Σ n_k², whether the records belong to enough clusters."""
    sizes = records.fitted[CLUSTER].value_counts().to_numpy(float)
    effective = float(sizes.sum() ** 2 / (sizes**2).sum()) if sizes.size else 0.0
    return Finding(
        WARNING if effective < FEW_CLUSTERS else FINE,
        "clusters, such as drivers or devices, that share the fitted records",
        f"{sizes.size:,} clusters, equivalent to {effective:.1f} of equal size",
        effective,
        "The records of one cluster are similar, so a few clusters contain little information about other "
        "clusters. Expect wide intervals. Records of more clusters reduce them most.",
    )


@CHECKS.add("repeated_rows")
def repeated_rows(records: Records) -> Finding:
    """Check for rows that repeat the row before them or, with clusters, an earlier row of their cluster.

    The verdict is ``stop`` if more than half of the rows are such rows, and ``warning`` if there are some.
    """
    rows = records.repeated
    share = len(rows) / max(len(records.valid), 1)
    return Finding(
        FINE if len(rows) == 0 else STOP if share > 0.5 else WARNING,
        "rows equal to the row before them, or to an earlier one of the same driver or device; if most rows "
        "are, a row is a time step",
        f"{len(rows):,} of {len(records.valid):,} rows ({share:.1%})",
        len(rows),
        "Find out whether one encounter was written twice. The answer counts equal rows once. The paper's "
        "models of cut-ins count each of them, unless data.repeated_rows is drop.",
        list(rows),
    )


@CHECKS.add("rows_repeated_elsewhere")
def rows_repeated_elsewhere(records: Records) -> Finding:
    """Check for rows that are equal to an earlier row that is not the row directly before them.

    The number of these rows is compared with the number that occurs by chance, by a Poisson test. The number
    by chance is estimated by counting equal rows after one column has been permuted.
    """
    rows = records.distinct[records.variables].round(9)
    found = rows.index[rows.duplicated()]
    column, order = rows.columns[1], child_generator(0, "permuted").permutation(len(rows))
    chance = max(int(rows.assign(**{column: rows[column].to_numpy()[order]}).duplicated().sum()), 1)
    return Finding(
        _against_chance(len(found), chance, len(rows)),
        "rows equal to an earlier row, compared with the number expected by chance at this resolution",
        f"{counted(len(found), 'row')}; {chance:,} or fewer by chance",
        len(found),
        "Remove files or blocks that were appended twice.",
        list(found),
    )


@CHECKS.add("nearly_repeated_rows")
@needs(ORDER)
def nearly_repeated_rows(records: Records) -> Finding:
    """Check for rows that differ from the row before them by no more than the resolution of radars.

    The resolution is 0.1 m/s for speeds and 0.2 m for the range. The number of these rows is compared, by a
    Poisson test, with the number of such pairs among rows that are far apart in the record.
    """
    rows = records.distinct[records.variables].to_numpy()
    resolution = np.array([RESOLUTION.get(unit, 0.0) for unit in records.units.values()])
    near = np.concatenate([[False], _near(rows, 1, resolution)])
    chance = max(np.mean([_near(rows, lag, resolution).sum() for lag in _lags(len(rows))]), 1.0)
    found = records.distinct.index[near]
    return Finding(
        _against_chance(len(found), chance, len(rows)),
        "rows within 0.1 m/s and 0.2 m (the resolution of radars) of the row before them, compared with "
        "pairs of rows that are far apart",
        f"{counted(len(found), 'row')}; {chance:.1f} or fewer by chance",
        len(found),
        "Find out whether one encounter is recorded by several targets or time steps, and keep one row of "
        "each.",
        list(found),
    )


@CHECKS.add("stuck_sensor")
@needs(ORDER)
def stuck_sensor(records: Records) -> Finding:
    """Check for a quantity that has the same value as in the row before, while another quantity changes.

    The number of these rows is compared with the number of equal values in rows that are far apart, by a
    Poisson test for each of lead speed, range and closing speed. The verdict is that of the most conspicuous
    quantity.
    """
    rows, worst = records.distinct, (1.0, records.variables[0], 0, pd.Index([]))
    for name in records.variables:
        values = rows[name].to_numpy()
        stuck = np.concatenate([[False], (values[1:] == values[:-1]) & (values[1:] != 0)])
        equal = [(values[lag:] == values[:-lag]) & (values[lag:] != 0) for lag in _lags(len(values))]
        chance = max(np.mean([flags.sum() for flags in equal]), 1.0)
        p = float(poisson.sf(stuck.sum() - 1, chance))
        worst = min(worst, (p, name, int(stuck.sum()), rows.index[stuck]), key=lambda entry: entry[0])
    p, name, count, found = worst
    is_chance = p * len(records.units) >= LEVEL
    return Finding(
        FINE if is_chance else by_share(count, len(rows)),
        "rows with the same value of one quantity as the row before, while another changes",
        f"{name.replace('_', ' ')} in {counted(count, 'row')} (p = {p:.2g})",
        count,
        "Look for a sensor that kept its last value, and leave these rows out.",
        () if is_chance else list(found),
    )


def _lags(size: int) -> list[int]:
    """Return the distances `FAR` as numbers of rows, in a record of ``size`` rows."""
    return [max(int(share * size), 1) for share in FAR]


def _near(rows: np.ndarray, lag: int, resolution: np.ndarray) -> np.ndarray:
    """Return which rows are equal to the row ``lag`` places before, within `RESOLUTION`; shape (n - lag,)."""
    return (np.abs(rows[lag:] - rows[:-lag]) <= resolution).all(axis=1)


def _against_chance(count: int, chance: float, size: int) -> str:
    """Return the verdict on a count of ``size`` rows, of which ``chance`` are expected by chance.

    The verdict is ``fine`` if a Poisson test does not reject at `LEVEL`; otherwise see `by_share`.
    """
    return FINE if poisson.sf(count - 1, chance) >= LEVEL else by_share(count, size)
