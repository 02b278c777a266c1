"""The data of the explorer: names and single numbers as JSON, and all arrays in one compressed block."""

import base64
import gzip
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.special import ndtri_exp

from accelerated_evaluation.answer.explored import DEPTH, DrawnLaws, ExploredLines
from accelerated_evaluation.answer.explored_ratios import COARSE, FINE, LEVELS, LIMITS, refinements
from accelerated_evaluation.answer.exposure import Rate
from accelerated_evaluation.answer.law_study import LawStudy
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.strata import VARIABLES

RATIO_STEP = 0.05  # step to which the logarithms of ratios are rounded
SPEED_STEP = 1 / 256  # [m/s], step to which closing speeds are rounded
RECORDS, URGENT = 10_000, 300  # records on the page: a random sample, and those with the smallest TTC
SHOWN_LINES = 6_000  # largest number of lines of a crash map that the page contains
GAMMA_LEVELS = (np.arange(15) + 0.5) / 15  # levels of the quantiles that represent the rate of cut-ins


@dataclass
class Payload:
    """The data of a page: a dictionary, and named arrays of numbers."""

    # read as JSON by the page; its entry ``arrays`` has type, shape and position of each array
    text: dict[str, Any]
    _blocks: list[bytes] = field(default_factory=list)

    def add(self, name: str, values: ArrayLike, kind: str) -> None:
        """Add an array of numbers as the little-endian NumPy type ``f4``, ``u2`` or ``u1``."""
        array = np.ascontiguousarray(values, dtype=f"<{kind}")
        place = {"type": kind, "start": sum(map(len, self._blocks)), "shape": list(array.shape)}
        self.text.setdefault("arrays", {})[name] = place
        # First bytes of all numbers, then second bytes, and so on: this order is compressed better.
        split = np.frombuffer(array.tobytes(), np.uint8).reshape(-1, array.itemsize).T
        self._blocks.append(split.tobytes())

    @property
    def block(self) -> str:
        """All arrays, compressed with gzip, in Base64. The same arrays always give the same text."""
        return base64.b64encode(gzip.compress(b"".join(self._blocks), 9, mtime=0)).decode()

    @property
    def json(self) -> str:
        """The dictionary as JSON in which "<" is escaped, so that it can be part of an HTML page."""
        return json.dumps(self.text, allow_nan=False).replace("<", "\\u003c")


def add_lines(payload: Payload, lines: ExploredLines) -> None:
    """Add the lines of the explorer, along which only the closing speed varies.

    The mean law on a line is given by the closing speeds at equidistant values of the cumulative hazard.
    They are rounded to `SPEED_STEP`, and stored as differences of successive values.
    """
    for name in ("lead_speed", "range_", "probability", "distance"):
        payload.add(name, getattr(lines, name), "f4")
    levels = np.round(np.minimum(lines.closing_speed, 240.0) / SPEED_STEP)
    payload.add("closing_speed", np.diff(levels, axis=1, prepend=0).T, "u2")
    hazards = np.arange(1, 4 * DEPTH + 1) / 4
    payload.add(
        "distance_at", np.append(0.0, np.where(hazards < np.log(2), 0.0, ndtri_exp(-hazards) ** 2)), "f4"
    )
    payload.text["lines"] = {"depth": DEPTH, "speed_step": SPEED_STEP}


def add_laws(payload: Payload, study: LawStudy, drawn: DrawnLaws, logs: Array) -> None:
    """Add the law of each draw, and its log ratios to the mean law at the nodes of `explored_ratios`."""
    members = study.smooth.members
    payload.add("member", drawn.member, "u1")
    order = np.argsort(drawn.member, kind="stable")  # draws of one law are similar, so differences are small
    levels = np.round((logs[order] - LIMITS[0]) / RATIO_STEP).astype(int)
    # Differences modulo 2^16, along the levels and between draws, are compressed better than the values.
    differences = np.diff(np.diff(levels, axis=-1, prepend=0), axis=0, prepend=0)
    payload.add("ratios", differences & 0xFFFF, "u2")
    for name, matrix in zip(("refine_speed", "refine_root", "refine_level"), refinements(), strict=True):
        payload.add(name, matrix, "f4")
    thresholds = sorted({member.level for member in members if member.level is not None})
    payload.text["laws"] = {
        "answered": drawn.answered,
        "order": order.tolist(),
        "members": [member.name for member in members],
        "weights": study.mean_weights.tolist(),
        "thresholds": [
            {"level": level, "weights": study.only(study.smooth.at_level(level)).mean_weights.tolist()}
            for level in thresholds
        ],
        "coarse": [*COARSE, len(LEVELS)],
        "fine": [*FINE, DEPTH + 1],
        "ratio_step": RATIO_STEP,
        "ratio_low": LIMITS[0],
    }


def add_records(payload: Payload, records: DistinctRecords, generator: np.random.Generator) -> None:
    """Add recorded cut-ins to the data of the page, which shows them.

    These are the cut-ins with the smallest time to collision, and a random sample of the others.
    """
    order = np.argsort(-records.closing_speed / records.range_, kind="stable")
    drawn = generator.choice(order[URGENT:], min(RECORDS, max(records.size - URGENT, 0)), replace=False)
    shown = records.only(np.concatenate([order[:URGENT], drawn]))
    for name in ("lead_speed", "range_", "closing_speed"):
        payload.add(f"record_{name}", np.round(getattr(shown, name) * 256), "u2")


def add_map(
    payload: Payload, crash_map: CrashMap, events: Sequence[str], generator: np.random.Generator
) -> None:
    """Add a random sample of the crash map of a vehicle that the page cannot simulate.

    It contains intervals of the first event: lead speed and range of the line, and the closing speeds between
    which the event occurs.
    """
    intervals = next(values for event, values in crash_map.events.items() if event.quantity == events[0])
    count = intervals.line.size
    chosen = np.sort(generator.choice(count, min(count, SHOWN_LINES), replace=False))
    line = intervals.line[chosen]
    payload.add("map_lead_speed", crash_map.lead_speed[line], "f4")
    payload.add("map_range", 1 / crash_map.inverse_range[line], "f4")
    payload.add("map_start", intervals.start[chosen], "f4")
    payload.add("map_end", np.minimum(intervals.end[chosen], crash_map.grid.closing_speed_max), "f4")


def add_runs(payload: Payload, runs: pd.DataFrame) -> None:
    """Add the simulations of a slow vehicle, ``laws/runs.csv``, without repeated ones."""
    once = runs[runs["phase"] != "repeat"]
    for name in VARIABLES:
        payload.add(f"run_{name}", once[name], "f4")
    payload.add("run_crash", once["event"], "u1")


def exposure_of(cut_ins: int, exposure: Mapping[str, float | None]) -> dict[str, Any]:
    """Return cut-ins, kilometres and quantiles of the rate per million kilometres, or None if not known."""
    kilometres = exposure.get("kilometres")
    if kilometres is None:
        return {"cut_ins": cut_ins, "kilometres": None, "rates": None}
    rates = Rate(cut_ins, kilometres).law.ppf(GAMMA_LEVELS) * 1e6
    return {"cut_ins": cut_ins, "kilometres": kilometres, "rates": rates.tolist()}


def published_of(table: pd.DataFrame, key: str) -> list[dict[str, Any]]:
    """Return the rows of a published table with the column ``key`` and the probabilities, for JSON.

    JSON has no NaN, which is replaced by None.
    """
    columns = [key, "probability", "median", *(name for name in table if name.startswith(("low", "high")))]
    rows = table[[name for name in columns if name in table]].to_dict("records")
    return [{name: None if value != value else value for name, value in row.items()} for row in rows]
