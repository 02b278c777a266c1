"""Records of the toy scenario: a table with the two variables and the number of the driver."""

from pathlib import Path

import pandas as pd
from accelerated_evaluation.scenarios.backing_out import BACKING_OUT
from accelerated_evaluation.scenarios.record_table import read_record_table


def read_records(path: Path) -> pd.DataFrame:
    """Read a table of records; those of one driver belong together."""
    return read_record_table(BACKING_OUT, path, "driver")
