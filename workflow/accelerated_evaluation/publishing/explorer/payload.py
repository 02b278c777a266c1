"""The data of the explorer: what is text as JSON, and all arrays in one compressed block."""

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
from accelerated_evaluation.answer.weighted_family import WeightedLaws
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.laws.smooth.family import DistinctRecords

RATIO_STEP = 0.05  # of the stored logarithms
SPEED_STEP = 1 / 256  # [m/s], of the stored closing speeds
RECORDS, URGENT = 10_000, 300  # shown over the map: a random sample, and those of the smallest TTC
SHOWN_LINES = 6_000  # of the map of a vehicle that is not compiled
GAMMA_LEVELS = (np.arange(15) + 0.5) / 15  # quantiles that stand for the rate of cut-ins


@dataclass
class Payload:
    """Named arrays of numbers, and text.

    Attributes
    ----------
    text
        What the page reads as JSON. Its entry ``arrays`` says where each array is.
    """

    text: dict[str, Any]
    _blocks: list[bytes] = field(default_factory=list)

    def add(self, name: str, values: ArrayLike, kind: str) -> None:
        """Add an array of a NumPy type of numbers, little-endian: ``f4``, ``u2``, ``u1``."""
        array = np.ascontiguousarray(values, dtype=f"<{kind}")
        place = {"type": kind, "start": sum(map(len, self._blocks)), "shape": list(array.shape)}
        self.text.setdefault("arrays", {})[name] = place
        # Bytes of equal weight next to each other are compressed better.
        split = np.frombuffer(array.tobytes(), np.uint8).reshape(-1, array.itemsize).T
        self._blocks.append(split.tobytes())

    @property
    def block(self) -> str:
        """The arrays, compressed, as text. The same arrays give the same text."""
        return base64.b64encode(gzip.compress(b"".join(self._blocks), 9, mtime=0)).decode()

    @property
    def json(self) -> str:
        """The text as JSON that can stand in a page."""
        return json.dumps(self.text, allow_nan=False).replace("<", "\\u003c")


def add_lines(payload: Payload, lines: ExploredLines) -> None:
    """Add the lines and the mean law along them; closing speeds as differences between levels."""
    for name in ("lead_speed", "range_", "probability", "distance"):
        payload.add(name, getattr(lines, name), "f4")
    levels = np.round(np.minimum(lines.closing_speed, 240.0) / SPEED_STEP)
    payload.add("closing_speed", np.diff(levels, axis=1, prepend=0).T, "u2")
    hazards = np.arange(1, 4 * DEPTH + 1) / 4
    payload.add(
        "distance_at", np.append(0.0, np.where(hazards < np.log(2), 0.0, ndtri_exp(-hazards) ** 2)), "f4"
    )
    payload.text["lines"] = {"depth": DEPTH, "speed_step": SPEED_STEP}


def add_laws(payload: Payload, weighted: WeightedLaws, drawn: DrawnLaws, logs: Array) -> None:
    """Add the draws: their members, weights of the choices of a reader, and the log ratios at the nodes."""
    members = weighted.members
    payload.add("member", drawn.member, "u1")
    order = np.argsort(drawn.member, kind="stable")  # draws of one member are alike
    levels = np.round((logs[order] - LIMITS[0]) / RATIO_STEP).astype(int)
    # Differences modulo 2^16, along the levels and between draws.
    differences = np.diff(np.diff(levels, axis=-1, prepend=0), axis=0, prepend=0)
    payload.add("ratios", differences & 0xFFFF, "u2")
    for name, matrix in zip(("refine_speed", "refine_root", "refine_level"), refinements(), strict=True):
        payload.add(name, matrix, "f4")
    thresholds = sorted({member.level for member in members if member.level is not None})
    payload.text["laws"] = {
        "answered": drawn.answered,
        "order": order.tolist(),
        "members": [member.name for member in members],
        "weights": weighted.weights.mean(axis=0).tolist(),
        "thresholds": [
            {"level": level, "weights": weighted.weights_at(level).mean(axis=0).tolist()}
            for level in thresholds
        ],
        "coarse": [*COARSE, len(LEVELS)],
        "fine": [*FINE, DEPTH + 1],
        "ratio_step": RATIO_STEP,
        "ratio_low": LIMITS[0],
    }


def add_records(payload: Payload, records: DistinctRecords, generator: np.random.Generator) -> None:
    """Add recorded cut-ins to show: those nearest to a crash, and a random sample of the others."""
    order = np.argsort(-records.closing_speed / records.range_, kind="stable")
    drawn = generator.choice(order[URGENT:], min(RECORDS, max(records.size - URGENT, 0)), replace=False)
    shown = records.only(np.concatenate([order[:URGENT], drawn]))
    for name in ("lead_speed", "range_", "closing_speed"):
        payload.add(f"record_{name}", np.round(getattr(shown, name) * 256), "u2")


def add_map(
    payload: Payload, crash_map: CrashMap, events: Sequence[str], generator: np.random.Generator
) -> None:
    """Add lines of the crash map of a vehicle that the page cannot simulate, with their crashes."""
    intervals = next(values for event, values in crash_map.events.items() if event.quantity == events[0])
    count = intervals.line.size
    chosen = np.sort(generator.choice(count, min(count, SHOWN_LINES), replace=False))
    line = intervals.line[chosen]
    payload.add("map_lead_speed", crash_map.lead_speed[line], "f4")
    payload.add("map_range", 1 / crash_map.inverse_range[line], "f4")
    payload.add("map_start", intervals.start[chosen], "f4")
    payload.add("map_end", np.minimum(intervals.end[chosen], crash_map.grid.closing_speed_max), "f4")


def add_runs(payload: Payload, runs: pd.DataFrame) -> None:
    """Add the simulations of a slow vehicle: cut-ins, and whether they crashed. Repeats are left out."""
    once = runs[runs["phase"] != "repeat"]
    payload.add("run_lead_speed", once["lead_speed"], "f4")
    payload.add("run_range", 1 / once["inverse_range"], "f4")
    payload.add("run_closing_speed", once["inverse_ttc"] / once["inverse_range"], "f4")
    payload.add("run_crash", once["event"], "u1")


def exposure_of(cut_ins: int, exposure: Mapping[str, float | None]) -> dict[str, Any]:
    """Return rates of cut-ins per million kilometres: quantiles of equal weight; None if not known."""
    kilometres = exposure.get("kilometres")
    if kilometres is None:
        return {"cut_ins": cut_ins, "kilometres": None, "rates": None}
    rates = Rate(cut_ins, kilometres).law.ppf(GAMMA_LEVELS) * 1e6
    return {"cut_ins": cut_ins, "kilometres": kilometres, "rates": rates.tolist()}


def published_of(table: pd.DataFrame, key: str) -> list[dict[str, Any]]:
    """Return rows of a published table with numbers that JSON can hold; None where there is none."""
    columns = [key, "probability", "median", *(name for name in table if name.startswith(("low", "high")))]
    rows = table[[name for name in columns if name in table]].to_dict("records")
    return [{name: None if value != value else value for name, value in row.items()} for row in rows]
