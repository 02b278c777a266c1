"""Coverage of the intervals as a readable table."""

import pandas as pd

from accelerated_evaluation.methods.coverage import LEVELS
from accelerated_evaluation.publishing.published import table

COVERAGE_COLUMNS = (
    *("method", "stopping", "replicates", "bias", "cov_true", "cov_reported"),
    *(f"coverage{level}" for level in LEVELS),
)


@table("coverage", digits=3)
def coverage_table(coverage: pd.DataFrame) -> pd.DataFrame:
    """Return the table of the coverage of intervals, with the columns that contain the coverage first."""
    others = [name for name in coverage.columns if name not in COVERAGE_COLUMNS]
    return coverage[[*COVERAGE_COLUMNS, *others]]
