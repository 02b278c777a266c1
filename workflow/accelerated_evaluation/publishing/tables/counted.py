"""Beyond the paper: predicted and counted crash rates as a table."""

import pandas as pd

from accelerated_evaluation.publishing.published import table
from accelerated_evaluation.publishing.tables.laws import interval_column


def without_sources(counted: pd.DataFrame) -> pd.DataFrame:
    """Return the columns that a reader needs, both limits of a rate in one."""
    shown = ["who", "what", "count", "per_million_miles", "95 %", "in_hundred_car", "verdict"]
    return counted.assign(**{"95 %": interval_column(counted["low95"], counted["high95"])})[shown]


@table("counted_crashes", digits=2, digest=without_sources)
def counted_crashes_table(counted_crashes: pd.DataFrame) -> pd.DataFrame:
    """Return predicted and counted crash rates as they are published."""
    return counted_crashes
