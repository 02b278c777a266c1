"""Limits that are derived from the records, for the configuration keys whose value is ``auto``.

The default limits are those of the paper, and they fit the paper's records. In a study of other records, each
key in `AUTOMATIC` that the configuration does not state is ``auto``. Its limit is then chosen so that all
records are kept, except physically impossible ones.
"""

import json
import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.sections import AUTO
from accelerated_evaluation.records.ingest import Account, drop_invalid, no_number
from accelerated_evaluation.records.segments import MINIMUM_ROWS

AUTOMATIC = (
    "filters.lead_speed_min",
    "filters.lead_speed_max",
    "filters.range_max",
    "segments.lead_speed_edges",
    "models.closing_speed_max",
    "crash_map.grid.closing_speed_max",
    "answer.grid.closing_speed_max",
    "sensitivity.lead_speed_edges",
    "sensitivity.closing_speed_max",
)
FASTEST = 70.0  # [m/s], 252 km/h: manufacturers limit fast cars to 250 km/h
FARTHEST = 300.0  # [m]: no radar or camera of a car follows a target that is farther away
WIDTH = 10.0  # [m/s], width of a segment, as in the paper
SEGMENT_ROWS = 600  # smallest number of rows in a segment, so that its tail, the uppermost 5 %, has 30 rows
MARGIN = 1.05  # ratio of the cap to the largest recorded closing speed; it is 1.06 in the paper
NO_CHANGE = 45.0  # [m/s]; above this closing speed the outcomes of all cars of the study stay the same
CAPS = (0.75, 0.85, 0.95, 1.05, 1.25)  # multiples of the cap that the sensitivity study tries
LARGEST_SPEED = 100.0  # [m/s], the largest value that the configuration allows


def limits_of(raw: pd.DataFrame, stated: Mapping[str, Any], data: Mapping[str, Any]) -> dict[str, Any]:
    """Return a value for each key of `AUTOMATIC`; those that are ``stated`` and not ``auto`` are not changed.

    ``data`` is the section of the configuration that names the records, for an error.

    The values are computed from the closing cut-ins with physically possible speeds and ranges:

    - The limits of the lead speed are the smallest value, rounded down to 1 m/s, and the next whole number
      above the largest value. The limit of the range is the largest value, rounded up to 1 m.
    - The segments are about 10 m/s wide, like those of the paper. A segment with fewer than `SEGMENT_ROWS`
      rows is joined with a neighbour.
    - The cap on the closing speed, which the paper's laws need, is 5 % above the largest recorded closing
      speed, rounded up to 0.5 m/s. Crash maps reach up to the cap. The crash maps of the answer reach up to
      twice the cap, and at least up to `NO_CHANGE`.
    - The sensitivity study tries segments of several widths, and the multiples `CAPS` of the cap.

    InputError is raised if no row has three valid numbers, or if no lead speed is within the stated limits.
    """
    limits = {key: stated[key] for key in AUTOMATIC}

    def settle(key: str, value: Any) -> Any:  # noqa: ANN401
        limits[key] = value if limits[key] == AUTO else limits[key]
        return limits[key]

    rows = _possible(raw, data)
    low = settle("filters.lead_speed_min", math.floor(rows["lead_speed"].min()))
    high = settle("filters.lead_speed_max", math.floor(rows["lead_speed"].max()) + 1)
    # Rounding errors of a unit's factor must not add a metre.
    settle("filters.range_max", max(math.ceil(round(rows["range"].max(), 6)), 1))
    rows = rows[rows["lead_speed"].between(low, high, inclusive="left")]
    if rows.empty:
        raise InputError(
            "filters.lead_speed_min, filters.lead_speed_max",
            seen=f"[{low:g}, {high:g}) m/s, which contains the lead speed of no record",
            expected="limits between which there are records",
            change="Lower or widen the limits, or set them to auto.",
        )
    settle("segments.lead_speed_edges", edges_of(rows["lead_speed"], low, high, WIDTH, SEGMENT_ROWS))
    largest = max(rows["closing_speed"].max(), 0.5)
    cap = settle("models.closing_speed_max", min(math.ceil(2 * MARGIN * largest) / 2, LARGEST_SPEED))
    settle("crash_map.grid.closing_speed_max", cap)
    settle("answer.grid.closing_speed_max", min(max(NO_CHANGE, 2 * cap), LARGEST_SPEED))
    widths = (high - low, 1.5 * WIDTH, WIDTH / 2)
    tried = [edges_of(rows["lead_speed"], low, high, width, MINIMUM_ROWS) for width in widths]
    settle("sensitivity.lead_speed_edges", [list(edges) for edges in dict.fromkeys(map(tuple, tried))])
    caps = {min(round(2 * factor * cap) / 2, LARGEST_SPEED) for factor in CAPS}
    settle("sensitivity.closing_speed_max", sorted(cap for cap in caps if cap > 0))
    return limits


def edges_of(lead_speed: pd.Series, low: float, high: float, width: float, rows: int) -> list[float]:
    """Return edges [m/s] of segments of about equal width, joined until each segment has enough rows.

    If there is only one segment, it may have fewer.
    """
    inner = np.linspace(low, high, max(round((high - low) / width), 1) + 1)[1:-1].round()
    edges = [low, *(int(edge) for edge in np.unique(inner) if low < edge < high), high]
    speeds = np.sort(lead_speed)
    while len(edges) > 2:
        counts = [np.searchsorted(speeds, b) - np.searchsorted(speeds, a) for a, b in pairwise(edges)]
        fewest = int(np.argmin(counts))
        if counts[fewest] >= rows:
            break
        neighbours = [place for place in (fewest - 1, fewest + 1) if 0 <= place < len(counts)]
        other = min(neighbours, key=counts.__getitem__)
        del edges[max(fewest, other)]
    return edges


def limits_in_words(filters: Mapping[str, float], edges: Sequence[float], closing_speed_max: float) -> str:
    """Return a sentence with the limits within which records are kept, and the cap [m/s]."""
    speeds = f"{filters['lead_speed_min']:g} to {filters['lead_speed_max']:g} m/s"
    cap = f"{closing_speed_max:g} m/s"
    return (
        f"Limits: lead speeds of {speeds} in segments with the edges {json.dumps(edges)}, ranges up to "
        f"{filters['range_max']:g} m, closing speeds capped at {cap} in the paper's laws."
    )


def _possible(raw: pd.DataFrame, data: Mapping[str, Any]) -> pd.DataFrame:
    """Return the closing cut-ins with physically possible speeds and ranges.

    If there are none, all valid rows are returned, clipped to possible values. Limits can then be derived, so
    that the ingest step refuses the records with its account of the dropped rows, and the report on the
    records shows the cause.
    """
    rows = drop_invalid(raw, Account(len(raw)), policy="drop", where="the records")
    if rows.empty:
        source, (example, correction) = data["source"], no_number(raw)
        raise InputError(
            data[source]["path"],
            seen=f"{len(raw):,} rows, none of them with three valid numbers{example and f'; {example}'}",
            expected="valid cut-ins, from which limits can be derived",
            change=f"{correction}Check the columns and units under data.{source}.",
        )
    is_possible = (rows["lead_speed"] <= FASTEST) & (rows["range"] <= FARTHEST) & (rows["closing_speed"] > 0)
    if is_possible.any():
        return rows[is_possible]
    top = pd.Series({"lead_speed": FASTEST, "range": FARTHEST, "closing_speed": FASTEST})
    return rows[list(top.index)].abs().clip(upper=top, axis=1)
