"""Readable tables of the account of the records, and of the checks of the records."""

import pandas as pd

from accelerated_evaluation.publishing.published import result_table, table


@table("encounters_account")
def account_table(account: pd.DataFrame) -> pd.DataFrame:
    """Return the account of the records, one row for each filter, for publication without changes."""
    return account


def _what_was_seen(report: pd.DataFrame) -> pd.DataFrame:
    """Return the columns that fit on a page; notebook 12 shows the others for checks that are not fine."""
    return report[["check", "verdict", "looked_at", "seen"]]


# The report on the records.
records_report_table = result_table("records_report", digits=3, digest=_what_was_seen)
