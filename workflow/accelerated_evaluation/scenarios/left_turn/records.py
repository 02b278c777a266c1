"""Records of left turns: speeds and distance at the moment in which a car begins to turn."""

from pathlib import Path

import pandas as pd

from accelerated_evaluation.scenarios.left_turn import LEFT_TURN
from accelerated_evaluation.scenarios.record_table import read_record_table


def read_records(path: Path) -> pd.DataFrame:
    """Return the records of left turns in a file; the drivers of the instrumented vehicles are the clusters.

    The table has the columns of the file, the cluster as text, and flags for rows that are repeated, outside
    the limits of a variable, or used in fits. Some left turns are in the authors' file twice, with different
    times, and are counted once. The column ``in_fit`` of this file marks the rows to which the authors fitted
    their law.
    """
    return read_record_table(LEFT_TURN, path, "driver")
