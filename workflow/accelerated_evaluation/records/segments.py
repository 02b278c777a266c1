"""The encounter table, its segments of lead speed, and tests of independence in them."""

import os
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.tables import read_parquet, require_file, write_parquet

NUMBERS = ("lead_speed", "range", "closing_speed", "inverse_range", "inverse_ttc")
COLUMNS = (*NUMBERS, "segment")
QUANTITIES = (*NUMBERS, "range_rate", "ttc")  # names of columns in the records of a source
# With fewer rows, and two equal values among them, the tail of TTC^-1 above the 95 % quantile would be fitted
# to a single row.
MINIMUM_ROWS = 30
MINIMUM_VALUES = 6  # number of different values of a variable: two for each of three pieces


def complete(raw: pd.DataFrame) -> pd.DataFrame:
    """Compute the five `NUMBERS` of the encounter table from the three columns of a source.

    The columns are ``lead_speed`` [m/s]; ``range`` [m] or ``inverse_range`` [1/m]; and one of
    ``closing_speed`` [m/s], ``range_rate`` [m/s], ``ttc`` [s] and ``inverse_ttc`` [1/s]. They are not
    changed. TTC = -R / (dR/dt), the first equation of section II of the paper, and the closing speed is
    -dR/dt.
    """
    range_ = raw["range"] if "range" in raw else 1 / raw["inverse_range"]
    inverse_range = raw["inverse_range"] if "inverse_range" in raw else 1 / range_
    if "closing_speed" in raw or "range_rate" in raw:
        closing_speed = raw["closing_speed"] if "closing_speed" in raw else -raw["range_rate"]
        inverse_ttc = closing_speed * inverse_range
    else:
        inverse_ttc = raw["inverse_ttc"] if "inverse_ttc" in raw else 1 / raw["ttc"]
        closing_speed = inverse_ttc / inverse_range
    values = (raw["lead_speed"], range_, closing_speed, inverse_range, inverse_ttc)
    return pd.DataFrame(dict(zip(NUMBERS, values, strict=True)))


def write_encounters(path: str | os.PathLike, encounters: pd.DataFrame, description: str) -> None:
    """Write the columns `COLUMNS` of an encounter table, and a description of the data, as a Parquet file."""
    table = encounters[list(COLUMNS)].reset_index(drop=True)
    table.attrs = {"description": description}
    write_parquet(path, table)


def read_encounters(path: str | os.PathLike) -> pd.DataFrame:
    """Read an encounter table from a Parquet file that `write_encounters` wrote.

    ``attrs["description"]`` contains the description of the data. InputError is raised if the file is missing
    or is not an encounter table.
    """
    require_file(path, "Run the ingest step, or correct the path.")
    table = read_parquet(path)
    if list(table.columns) != list(COLUMNS):
        raise InputError(
            str(path),
            seen=f"columns {', '.join(map(str, table.columns))}",
            expected=f"the columns of an encounter table: {', '.join(COLUMNS)}",
            change="Write the file with the ingest step.",
        )
    are_numbers = all(kind.kind in "iuf" for kind in table[list(NUMBERS)].dtypes)
    numbers = table[list(NUMBERS)].to_numpy(float, na_value=np.nan) if are_numbers else np.array(np.nan)
    if not (np.isfinite(numbers) & (numbers >= 0)).all():
        raise InputError(
            str(path),
            seen="speeds, ranges or times that are missing, infinite, below 0 or not numbers",
            expected="an encounter table as the ingest step writes it",
            change="Write the file with the ingest step.",
        )
    if table.empty or not table["segment"].map(lambda name: isinstance(name, str)).all():
        raise InputError(
            str(path),
            seen="no rows" if table.empty else "segments without a name",
            expected="an encounter table as the ingest step writes it",
            change="Write the file with the ingest step.",
        )
    return table


def segment_names(lead_speed_edges: Sequence[float]) -> list[str]:
    """Return the names of the segments between increasing edges [m/s], such as ``"5-15"``."""
    return [f"{low:g}-{high:g}" for low, high in pairwise(lead_speed_edges)]


def assign_segments(encounters: pd.DataFrame, lead_speed_edges: Sequence[float]) -> pd.DataFrame:
    """Add the column ``segment`` with the name of the segment of lead speed [m/s] of each row.

    Each segment includes its lower edge but not its upper one (section II of the paper). InputError is raised
    if a row lies below the first edge, or at or above the last one, or if a segment has no row.
    """
    names, speeds = segment_names(lead_speed_edges), encounters["lead_speed"].to_numpy()
    outside = ~((speeds >= lead_speed_edges[0]) & (speeds < lead_speed_edges[-1]))
    if outside.any():
        first = f"{speeds[outside][0]:g} m/s"
        raise InputError(
            f"segments between the lead speeds {' '.join(f'{edge:g}' for edge in lead_speed_edges)} m/s",
            seen=f"{outside.sum():,} of {len(encounters):,} rows outside, the first with {first}",
            expected=f"all rows in [{lead_speed_edges[0]:g}, {lead_speed_edges[-1]:g}) m/s",
            change="Choose edges that enclose the limits in filters.",
        )
    index = np.searchsorted(lead_speed_edges, speeds, side="right") - 1
    empty = [name for number, name in enumerate(names) if number not in index]
    if empty:
        raise InputError(
            f"segment {', '.join(empty)} m/s",
            seen=f"none of the {len(encounters):,} rows that passed the filters",
            expected="at least one row in each segment",
            change="Check the unit of the lead speed, the filters and segments.lead_speed_edges.",
        )
    return encounters.assign(segment=np.array(names)[index])


def require_rows(encounters: pd.DataFrame) -> None:
    """Check that there are enough encounters to fit a law.

    InputError is raised if a segment has fewer than `MINIMUM_ROWS` rows. Also if the range or the closing
    speed in all rows, or TTC^-1 in the rows of a segment, has fewer than `MINIMUM_VALUES` different values.
    """
    counts = segment_counts(encounters)
    few = counts[counts["rows"] < MINIMUM_ROWS]
    if len(few):
        raise InputError(
            f"segment {', '.join(few['segment'])} m/s",
            seen=f"{', '.join(map(str, few['rows']))} of {len(encounters):,} rows that passed the filters",
            expected=f"at least {MINIMUM_ROWS} rows in each segment, to which a law can be fitted",
            change="Add records (or raise data.sample), or join segments (segments.lead_speed_edges).",
        )
    different = {
        "the range in all segments": encounters["inverse_range"].nunique(),
        "the closing speed in all segments": encounters["closing_speed"].nunique(),
    }
    of_segments = encounters.groupby("segment", sort=False)["inverse_ttc"].nunique()
    different |= {f"TTC^-1 in segment {segment} m/s": count for segment, count in of_segments.items()}
    for what, count in different.items():
        if count < MINIMUM_VALUES:
            raise InputError(
                what,
                seen=f"{count} different {'value' if count == 1 else 'values'}",
                expected=f"at least {MINIMUM_VALUES}, to which a law can be fitted",
                change="Check the columns of the table, or join segments (segments.lead_speed_edges).",
            )


def segment_counts(encounters: pd.DataFrame) -> pd.DataFrame:
    """Count the ``rows`` of each segment, and their ``share`` of all rows, in order of lead speed."""
    order = encounters.groupby("segment")["lead_speed"].min().sort_values().index
    rows = encounters["segment"].value_counts().reindex(order)
    return pd.DataFrame({"segment": order, "rows": rows.to_numpy(), "share": (rows / rows.sum()).to_numpy()})
