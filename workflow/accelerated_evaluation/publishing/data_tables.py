"""What became of the rows of the records, and what the checks of them say, as tables to be read."""

import pandas as pd

from accelerated_evaluation.publishing.published import table


@table("encounters_account")
def account_table(account: pd.DataFrame) -> pd.DataFrame:
    """Return the account of the rows that were left out as it is published."""
    return account


@table("records_report", digits=3)
def records_report_table(records_report: pd.DataFrame) -> pd.DataFrame:
    """Return the report on the records as it is published."""
    return records_report
