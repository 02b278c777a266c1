"""Checks for a drift of the records, of the outcomes of replays, and against known records."""

from collections.abc import Iterator, Mapping
from itertools import combinations

import numpy as np
import pandas as pd
from scipy.stats import norm

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.tables import CLUSTER
from accelerated_evaluation.records.checks import (
    CHECKS,
    CUT_INS,
    FINE,
    LEVEL,
    MANY,
    NAMED_ROWS,
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


NEAR_TTC, NEAR_RANGE = 1.0, 1.0  # [s], [m]; the crash map defines near misses by the same limits
# Largest share of crashes in records of other scenarios than the cut-in. Their vehicles are less careful than
# the recorded drivers: the vehicle of the left turn crashes in 2 % of the records of the project.
MANY_CRASHES = 0.1


@CHECKS.add("replayed_crashes")
def replayed_crashes(records: Records) -> Finding:
    """Simulate the records within the limits, and report crashes and, for cut-ins, near misses.

    A near miss has a time to collision below 1 s or a range below 1 m. The verdict is ``stop`` if more than 1
    % of the cut-ins crash, or more than 10 % of the encounters of another scenario. It is ``warning`` if
    there is any crash or near miss.
    """
    near_miss = f", or come to a TTC under {NEAR_TTC:g} s or a range under {NEAR_RANGE:g} m"
    looked_at = f"rows that crash when the vehicle replays them{near_miss if records.are_cut_ins else ''}"
    if records.simulate is None or records.kept.empty:
        return Finding(FINE, looked_at, "not checked: no vehicle or no rows", 0.0)
    outcomes = records.outcomes
    crash = outcomes["crash"]
    crashes, nearly = outcomes.index[crash], outcomes.index[:0]
    if records.are_cut_ins:
        near = ~crash & ((outcomes["min_ttc"] < NEAR_TTC) | (outcomes["min_range"] < NEAR_RANGE))
        nearly = outcomes[near].sort_values("min_ttc").index
    most = MANY if records.are_cut_ins else MANY_CRASHES
    return Finding(
        STOP if crash.mean() > most else WARNING if len(crashes) + len(nearly) else FINE,
        looked_at,
        f"{len(crashes):,} of {len(crash):,} rows crash{_named(crashes)}"
        + (f", {len(nearly):,} nearly" if records.are_cut_ins else ""),
        len(crashes),
        "Inspect these rows with the command accelerated-evaluation replay: an error of the record, or of "
        "the vehicle? The recorded drivers did not crash, so with many crashes a unit may be wrong.",
        [*crashes, *nearly],
    )


def _named(rows: list[int]) -> str:
    """Return the first few row numbers in brackets."""
    return f" ({'; '.join(map(str, rows[:NAMED_ROWS]))})" if len(rows) else ""


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
