"""What became of the rows of the records, and what the checks of them say, as tables to be read."""

import pandas as pd

from accelerated_evaluation.publishing.published import table


@table("encounters_account")
def account_table(account: pd.DataFrame) -> pd.DataFrame:
    """Return the account of the rows that were left out as it is published."""
    return account


def _what_was_seen(report: pd.DataFrame) -> pd.DataFrame:
    """Return the columns that fit on a page; notebook 12 tells the rest of what asks for a look."""
    return report[["check", "verdict", "looked_at", "seen"]]


@table("records_report", digits=3, digest=_what_was_seen)
def records_report_table(records_report: pd.DataFrame) -> pd.DataFrame:
    """Return the report on the records as it is published."""
    return records_report
