"""Account of the records of a scenario other than the cut-in: how many were fitted, repeated or outside."""

import pandas as pd

from accelerated_evaluation.scenarios.protocol import CLUSTER, FITTED, Scenario


def records_account(scenario: Scenario, records: pd.DataFrame) -> pd.DataFrame:
    """Describe the records of a scenario: number of rows and clusters, and quantiles of each variable.

    Parameters
    ----------
    scenario
        The scenario.
    records
        Its record table.

    Returns
    -------
    pandas.DataFrame
        One row for each variable: ``variable``; ``unit``; the numbers of ``records``, of records for the fit
        (``fitted``), of ``clusters``, of ``repeated`` records (all variables are equal to those of an earlier
        record) and of records ``outside`` of the limits; ``smallest``, ``median`` and ``largest`` value.
    """
    repeated = int(records.duplicated(list(scenario.names)).sum())
    rows = []
    for each in scenario.variables:
        values = records[each.name]
        rows.append(
            {
                "variable": each.name,
                "unit": each.unit,
                "records": len(records),
                "fitted": int(records[FITTED].sum()),
                "clusters": records[CLUSTER].nunique(),
                "repeated": repeated,
                "outside": int((~values.between(each.low, each.high)).sum()),
                "smallest": values.min(),
                "median": values.median(),
                "largest": values.max(),
            }
        )
    return pd.DataFrame(rows)
