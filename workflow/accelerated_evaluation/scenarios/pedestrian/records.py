"""Records of pedestrians: the moment in which an instrumented vehicle was nearest to a pedestrian."""

from pathlib import Path

import numpy as np
import pandas as pd

from accelerated_evaluation.scenarios.pedestrian import PEDESTRIAN
from accelerated_evaluation.scenarios.record_table import read_record_table

RATE = 10.0  # [1/s], of the samples


def read_records(path: Path) -> pd.DataFrame:
    """Read records of pedestrians; they belong together if the same device recorded them.

    See `read_record_table` for the result.
    """
    return read_record_table(PEDESTRIAN, path, "device")


def records_of_series(series: pd.DataFrame) -> pd.DataFrame:
    """Compute the records of time series, as the authors did.

    Parameters
    ----------
    series
        Samples in order of time, 10 a second: ``record``, ``range_m`` and ``transversal_m`` (position of the
        pedestrian along and across the path of the vehicle) and ``vehicle_speed_mps``.

    Returns
    -------
    pandas.DataFrame
        A row for each record: the three variables of the scenario at the sample with the smallest distance,
        and ``is_last``, whether this is the last sample. The pedestrian speed is the central difference of
        the transversal position, and one-sided at the ends. In most records the smallest distance is that of
        the last sample, where the sensor loses the pedestrian, and not that of a passage.
    """
    samples = series.assign(distance_m=np.hypot(series["range_m"], series["transversal_m"]))
    groups = samples.groupby("record", sort=False)
    samples["pedestrian_speed_mps"] = groups["transversal_m"].transform(lambda x: np.gradient(x) * RATE)
    samples["is_last"] = groups.cumcount(ascending=False) == 0
    nearest = samples.loc[groups["distance_m"].idxmin()]
    return nearest[["record", *PEDESTRIAN.names, "is_last"]].reset_index(drop=True)
