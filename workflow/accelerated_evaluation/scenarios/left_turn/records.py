"""Records of left turns: speeds and distance at the moment in which a car begins to turn."""

from pathlib import Path

import pandas as pd

from accelerated_evaluation.scenarios.left_turn import LEFT_TURN
from accelerated_evaluation.scenarios.record_table import read_record_table


def read_records(path: Path) -> pd.DataFrame:
    """Read records of left turns; they belong together if the same driver drove the instrumented vehicle.

    See `read_record_table` for the result. Some passes are in the authors' file twice, with other times, and
    count once. The column ``in_fit`` of that file marks the rows to which the authors fitted their law.
    """
    return read_record_table(LEFT_TURN, path, "driver")
