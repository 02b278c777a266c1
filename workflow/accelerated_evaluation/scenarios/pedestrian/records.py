"""Records of pedestrians: the moment at which an instrumented vehicle was nearest to a pedestrian."""

from pathlib import Path

import numpy as np
import pandas as pd

from accelerated_evaluation.scenarios.pedestrian import PEDESTRIAN
from accelerated_evaluation.scenarios.record_table import read_record_table

RATE = 10.0  # [1/s], sampling rate


def read_records(path: Path) -> pd.DataFrame:
    """Return the records of pedestrians in a file; the recording devices are the clusters.

    The table has the columns of the file, the cluster as text, and flags for rows that are repeated, outside
    the limits of a variable, or used in fits.
    """
    return read_record_table(PEDESTRIAN, path, "device")


def records_of_series(series: pd.DataFrame) -> pd.DataFrame:
    """Return one record for each time series, computed in the same way as by the authors of the paper.

    The samples are in order of time, 10 per second. The variables are those at the sample with the smallest
    distance, and ``is_last`` says whether this is the last sample. The pedestrian speed is the central
    difference of the transversal position, and a one-sided difference at the ends. In most records the
    smallest distance is that of the last sample, where the sensor loses the pedestrian, so the vehicle has
    not yet passed the pedestrian.
    """
    samples = series.assign(distance_m=np.hypot(series["range_m"], series["transversal_m"]))
    groups = samples.groupby("record", sort=False)
    samples["pedestrian_speed_mps"] = groups["transversal_m"].transform(lambda x: np.gradient(x) * RATE)
    samples["is_last"] = groups.cumcount(ascending=False) == 0
    nearest = samples.loc[groups["distance_m"].idxmin()]
    return nearest[["record", *PEDESTRIAN.names, "is_last"]].reset_index(drop=True)
