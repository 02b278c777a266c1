"""Check that compares records with those of the same scenario that come with the project."""

from collections.abc import Iterator, Mapping
from itertools import combinations

import numpy as np
import pandas as pd

from accelerated_evaluation.base.tables import CLUSTER
from accelerated_evaluation.records.checks import CHECKS, FINE, STOP, WARNING, Finding, Records, needs

# Numbers in one unit that stand for 1 in the unit of the variable.
FACTORS = {
    "m/s": {"km/h": 3.6, "mph": 1 / 0.44704, "ft/s": 1 / 0.3048},
    "m": {"ft": 1 / 0.3048, "yd": 1 / 0.9144, "km": 0.001, "cm": 100.0, "mm": 1000.0},
}
CLEAR = 0.3  # distance from the known records beyond which other units and exchanged columns are tried
OTHER = 0.4  # distance of records that describe other traffic than the known ones, or have a fault
SAME = 0.1  # distance of records of the same traffic: that of two samples of 300, at level 0.1
ENOUGH = 5_000  # number of rows that are compared, so that a distance is known within 0.02


@CHECKS.add("known_records")
@needs(CLUSTER)
def known_records(records: Records) -> Finding:
    """Compare the variables with those of the known records of the scenario, as they are and without a fault.

    The distance is the largest Kolmogorov-Smirnov distance of a variable. If it is large, each wrong unit of
    one variable or of all variables of a unit, and each exchange of two variables, is corrected in turn. The
    verdict is ``stop`` if the corrected records agree with the known ones. It is ``warning`` if they are at
    most half as distant, or if the distance is very large without an explanation. The number is the distance
    of the records as they are.
    """
    looked_at = "distance of the variables from those of the records of this scenario in the project"
    if records.known is None:
        return Finding(FINE, looked_at, "not checked: the project has no such records", 0.0)
    rows, known = (_some(table[records.variables].abs()) for table in (records.valid, records.known))
    distance = _distance(rows, known)
    middle, usual = rows.median(), known.median()
    medians = ", ".join(
        f"{name} {middle[name]:.3g} {unit} (known: {usual[name]:.3g})" for name, unit in records.units.items()
    )
    seen = f"distance {distance:.2f}; medians: {medians}"
    if distance < CLEAR:
        return Finding(FINE, looked_at, seen, distance)
    corrected = {text: _distance(table, known) for text, table in _faults(rows, records.units)}
    fault = min(corrected, key=corrected.__getitem__)
    explained = corrected[fault] <= distance / 2
    if explained:
        seen = (
            f"the fault '{fault}' explains the distance, which is {corrected[fault]:.2f} without it; {seen}"
        )
    verdict = STOP if corrected[fault] < SAME else WARNING if explained or distance > OTHER else FINE
    return Finding(
        verdict,
        looked_at,
        seen,
        distance,
        "Check the units and the order of the columns. If they are right, the records describe other traffic "
        "than the known ones, which is no fault.",
    )


def _some(table: pd.DataFrame) -> pd.DataFrame:
    """Return at most about `ENOUGH` rows, spread over the table."""
    return table.iloc[:: max(len(table) // ENOUGH, 1)]


def _distance(rows: pd.DataFrame, known: pd.DataFrame) -> float:
    """Return the largest Kolmogorov-Smirnov distance of a column from the known one of its name."""
    return max(_kolmogorov_smirnov(rows[name].to_numpy(), known[name].to_numpy()) for name in known)


def _kolmogorov_smirnov(one: np.ndarray, other: np.ndarray) -> float:
    both = np.concatenate([one, other])
    shares = [np.searchsorted(np.sort(each), both, side="right") / each.size for each in (one, other)]
    return float(np.abs(shares[0] - shares[1]).max())


def _faults(rows: pd.DataFrame, units: Mapping[str, str]) -> Iterator[tuple[str, pd.DataFrame]]:
    """Iterate over possible faults, each in words and with the rows that are free of it."""
    for unit, factors in FACTORS.items():
        own = [name for name in units if units[name] == unit]
        for columns in [*([name] for name in own), *([own] if len(own) > 1 else [])]:
            what = " and ".join(columns)
            for other, factor in factors.items():
                yield f"{what} in {other}", rows.assign(**{name: rows[name] / factor for name in columns})
                taken = f"{what} in {unit}, but converted as if in {other}"
                yield taken, rows.assign(**{name: rows[name] * factor for name in columns})
    for one, another in combinations(units, 2):
        yield f"{one} and {another} exchanged", rows.assign(**{one: rows[another], another: rows[one]})
