"""The report on the records as text, for the log file and for the command ``inspect``."""

import os
import textwrap

import pandas as pd

from accelerated_evaluation.records.checks import STOP, VERDICTS

WIDTH = 100


def read_report(path: str | os.PathLike) -> pd.DataFrame:
    """Return the report on the records that a study has written, one row for each check."""
    return pd.read_csv(path, keep_default_na=False)


def report_in_words(report: pd.DataFrame) -> str:
    """Return the table of `checks.inspect_records` as readable text, in the order of the table."""
    lines = [summary(report), ""]
    for row in report.to_dict("records"):
        known = " (explained in docs/records_report.md)" if row["explained"] else ""
        lines.append(f"{row['verdict'].upper():5} {row['check']}: {row['seen']}{known}")
        if row["advice"]:
            rows = f"rows {row['example_rows']}" if row["rows"] else ""
            more = (
                f" and {row['rows'] - row['example_rows'].count(';') - 1:,} more" if row["rows"] > 5 else ""
            )
            parts = [f"looked at: {row['looked_at']}", f"{rows}{more}", row["advice"]]
            lines += [
                textwrap.fill(part, WIDTH, initial_indent=" " * 6, subsequent_indent=" " * 6)
                for part in parts
                if part
            ]
    return "\n".join(lines)


def summary(report: pd.DataFrame) -> str:
    """Return a summary of the table of `checks.inspect_records`.

    The summary states the number of checks for each verdict, and the names of the checks whose verdict is
    ``stop``.
    """
    counts = ", ".join(f"{(report['verdict'] == verdict).sum()} {verdict}" for verdict in VERDICTS)
    stops = report.loc[report["verdict"] == STOP, "check"]
    if stops.empty:
        return f"{len(report)} checks of the records: {counts}."
    return (
        f"{len(report)} checks of the records: {counts}. STOP: {', '.join(stops)}. "
        "No result of these records can be trusted before this is explained."
    )
