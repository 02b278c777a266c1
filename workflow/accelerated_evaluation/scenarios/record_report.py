"""Report on the records of a scenario: each check has the verdict ``fine``, ``warning`` or ``stop``."""

from collections.abc import Callable

import numpy as np
import pandas as pd

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.records.checks import FINE, STOP, WARNING, Finding, by_share, report_of
from accelerated_evaluation.scenarios.protocol import CLUSTER, FITTED, Scenario

FEW_CLUSTERS = 20  # effective number of clusters below which bootstrap intervals over clusters are too short
MANY_EQUAL = 0.05  # share of records with the same value of a variable, which no smooth law can describe
# Share of records that crash when replayed. The recorded drivers did not crash, so with a larger share the
# vehicle or a unit is wrong.
MANY_CRASHES = 0.1
Simulate = Callable[..., object]


def inspect_scenario_records(scenario: Scenario, records: pd.DataFrame, simulate: Simulate) -> pd.DataFrame:
    """Return the results of checks of the records of a scenario.

    Parameters
    ----------
    scenario
        The scenario.
    records
        Records of the scenario, as ``scenario.read_records`` returns them.
    simulate
        Function that simulates encounters with the vehicle under test, and returns the outcomes.

    Returns
    -------
    pandas.DataFrame
        One row for each check, with its verdict; the columns are those of `records.checks.inspect_records`.
        Rows of the source are counted from 1.
    """
    numbered = records.set_axis(range(1, len(records) + 1))
    return report_of(
        {
            "repeated rows": _repeated(scenario, numbered),
            "rows outside limits": _outside(scenario, numbered),
            "equal values": _equal(scenario, numbered),
            "clusters": _clusters(numbered),
            "replayed crashes": _replayed(scenario, numbered, simulate),
        }
    )


def _repeated(scenario: Scenario, records: pd.DataFrame) -> Finding:
    rows = records.index[records.duplicated([*scenario.names, CLUSTER])]
    return Finding(
        STOP if len(rows) > len(records) / 2 else WARNING if len(rows) else FINE,
        "rows whose variables and cluster are those of an earlier row",
        f"{len(rows):,} of {len(records):,} rows",
        len(rows),
        "Find out whether one encounter was written twice. Laws are fitted only to the first of equal rows.",
        list(rows),
    )


def _outside(scenario: Scenario, records: pd.DataFrame) -> Finding:
    values, (low, high) = records[list(scenario.names)].to_numpy(float), scenario.limits.T
    outside = (values < low) | (values > high)
    rows = records.index[outside.any(axis=1)]
    counts = zip(scenario.variables, outside.sum(axis=0), strict=True)
    named = [f"{count:,} in {each.name} ({each.in_words})" for each, count in counts if count]
    return Finding(
        by_share(len(rows), len(records)),
        "rows with a variable outside the limits of the scenario",
        f"{len(rows):,} of {len(records):,} rows{': ' if named else ''}{', '.join(named)}",
        len(rows),
        "Check the unit and the sign of the column. Laws are not fitted to these rows.",
        list(rows),
    )


def _equal(scenario: Scenario, records: pd.DataFrame) -> Finding:
    fitted = records[records[FITTED]]
    counts = {name: fitted[name].value_counts() for name in scenario.names if len(fitted)}
    shares = {name: float(each.iloc[0]) / len(fitted) for name, each in counts.items()}
    name = max(shares, key=shares.__getitem__, default="")
    share = shares.get(name, 0.0)
    value = counts[name].index[0] if name else np.nan
    return Finding(
        STOP if share == 1 else WARNING if share > MANY_EQUAL else FINE,
        "largest share of the fitted records that have the same value of a variable",
        f"{share:.1%} have {name} {value:g}" if name else "no fitted records",
        share,
        "Use the values as they were measured. Laws are smooth, and cannot describe a constant or many equal "
        "values that were rounded or stand for missing values.",
        list(fitted.index[fitted[name] == value]) if share > MANY_EQUAL else (),
    )


def _clusters(records: pd.DataFrame) -> Finding:
    sizes = records.loc[records[FITTED], CLUSTER].value_counts().to_numpy(float)
    effective = float(sizes.sum() ** 2 / (sizes**2).sum()) if sizes.size else 0.0
    return Finding(
        WARNING if effective < FEW_CLUSTERS else FINE,
        "clusters, such as drivers or devices, that share the fitted records",
        f"{sizes.size:,} clusters, equivalent to {effective:.1f} of equal size",
        effective,
        "The records of one cluster are similar, so a few clusters contain little information about other "
        "clusters. Expect wide intervals. Records of more clusters reduce them most.",
    )


def _replayed(scenario: Scenario, records: pd.DataFrame, simulate: Simulate) -> Finding:
    fitted = records[records[FITTED]]
    columns: list[Array] = [fitted[name].to_numpy(float) for name in scenario.names]
    crash = simulate(*columns).crash if len(fitted) else np.zeros(0, bool)
    rows = fitted.index[crash]
    return Finding(
        STOP if len(rows) > MANY_CRASHES * len(fitted) else WARNING if len(rows) else FINE,
        "records that crash when the vehicle under test replays them",
        f"{len(rows):,} of {len(fitted):,} rows",
        len(rows),
        "Inspect these rows with the command accelerated-evaluation replay: an error of the record, or of "
        "the vehicle?",
        list(rows),
    )
