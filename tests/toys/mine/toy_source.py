"""A toy: a CSV file without a header, with lead speed, range and closing speed."""

import pandas as pd
from accelerated_evaluation.base.sections import number
from accelerated_evaluation.records.sources import source


@source(
    "toy_source",
    description="records of a toy",
    files="CSV file without a header",
    speed_unit=number(1, 0, 10, "Speed that the file calls 1 [m/s].", exclusive=True),
)
def read(settings):
    """Read the file, and convert the speeds to m/s."""
    table = pd.read_csv(settings["path"], names=["lead_speed", "range", "closing_speed"])
    table[["lead_speed", "closing_speed"]] *= settings["speed_unit"]
    return table.set_index(pd.RangeIndex(1, len(table) + 1, name="row"))
