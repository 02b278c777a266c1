"""The recorded lane changes of the Safety Pilot Model Deployment, kept in this repository (data/spmd)."""

import hashlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.sections import text
from accelerated_evaluation.base.tables import read_parquet, require_file
from accelerated_evaluation.records.sources import exposure, source

COLUMNS = ("lead_speed", "inverse_range", "inverse_ttc")


@source(
    "spmd",
    description="Safety Pilot Model Deployment (real events)",
    files="Parquet file of the recorded lane changes, which is part of the repository",
    path="data/spmd/cut_ins.parquet",
    outlier_rows=(26382, 114923, 117159),  # the later code of the paper's authors leaves these rows out
    sha256=text(
        "d3775682fe969584c219ded2dd8967ab77dd509dcf99fbf7a4a96713dacde471",
        "Checksum of the file, 64 hexadecimal digits.",
        pattern="^[0-9a-fA-F]{64}$",
    ),
    exposure=exposure(kilometres=3_218_688),  # "over 2 million miles" (section II)
)
def read(settings: Mapping[str, str]) -> pd.DataFrame:
    """Read the recorded lane changes, and verify the checksum ``sha256`` of the Parquet file.

    InputError is raised if the file is missing, has another checksum or has other columns.
    """
    path = settings["path"]
    require_file(path, "Restore the file from the repository, or correct data.spmd.path.")
    content = Path(path).read_bytes()
    seen = hashlib.sha256(content).hexdigest()
    if seen != settings["sha256"].lower():
        raise InputError(
            str(path),
            seen=f"sha256 {seen} ({len(content):,} bytes)",
            expected=f"sha256 {settings['sha256']}",
            change="Restore the file from the repository; for another file, state its data.spmd.sha256.",
        )
    table = read_parquet(path)
    if list(table.columns) != list(COLUMNS) or not (table.dtypes == np.float64).all():
        raise InputError(
            str(path),
            seen=f"columns {', '.join(f'{name} ({kind})' for name, kind in table.dtypes.items())}",
            expected=f"columns of doubles: {', '.join(COLUMNS)}",
            change="Restore the file from the repository, or read it as source table.",
        )
    return table.set_index(pd.RangeIndex(1, len(table) + 1, name="row"))
