"""The page of the explorer: templates filled with the data of a study, which are one compressed block."""

import base64
import gzip
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.special import ndtri_exp

from accelerated_evaluation.answer.explored import (
    COARSE,
    DEPTH,
    FINE,
    LEVELS,
    LIMITS,
    ExploredLines,
    ExplorerDraws,
    explored_lines,
    log_ratios,
    refinements,
)
from accelerated_evaluation.answer.law_study import LawStudy
from accelerated_evaluation.answer.posterior import Rate
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import StudyError
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.strata import VARIABLES
from accelerated_evaluation.publishing.explorer.vehicles import (
    TITLES,
    described_vehicles,
    other_vehicles,
    pilots,
)
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.vehicles.protocol import events_from

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


def add_laws(payload: Payload, study: LawStudy, drawn: ExplorerDraws, logs: Array) -> None:
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
    payload.text["laws"] = {
        "answered": drawn.answered,
        "order": order.tolist(),
        "members": [member.name for member in members],
        "weights": study.mean_weights.tolist(),
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


LARGEST = 3_000_000  # largest size of a page in bytes
SHOWN_EVENTS = ("crash", "impact_speed")  # events of the page, whose lines are chosen for crashes
PLACES = {
    "/*STYLE*/": "explorer.css",
    "/*SIMULATOR*/": "simulator.js",
    "/*ENGINE*/": "engine.js",
    "/*VIEW*/": "view.js",
    "/*SETTINGS*/": "settings.js",
    "/*PAGE*/": "page.js",
}


@dataclass(frozen=True)
class Explored:
    """The results of a study from which a page is made."""

    name: str  # of the study
    tested: Mapping[str, Any]  # section of the configuration for the vehicle under test
    impact_speeds: Sequence[float]  # thresholds of the further events [m/s]
    study: LawStudy  # the laws with their weights
    drawn: ExplorerDraws  # random draws from the laws
    exposure: Mapping[str, float | None]  # ``kilometres`` and ``hours`` of the records
    answer: pd.DataFrame  # the published answer by event
    vehicles: pd.DataFrame  # the published answer by vehicle
    # of the vehicle under test, which the page shows if it cannot simulate the vehicle
    crash_map: CrashMap | None
    runs: pd.DataFrame | None  # ``laws/runs.csv`` of a slow vehicle under test

    @property
    def is_simulated(self) -> bool:
        """Whether the page can simulate the vehicle under test."""
        return self.tested["name"] in TITLES


def write_page(explored: Explored, templates: Path, path: Path, generator: np.random.Generator) -> None:
    """Write the explorer of a study: an HTML page on which a reader changes the vehicle.

    The random ``generator`` chooses the lines (pairs of lead speed and range on which vehicles are simulated)
    and the records that are shown. A page larger than `LARGEST` is a StudyError.
    """
    page = (templates / "explorer.html").read_text(encoding="utf-8")
    for place, name in PLACES.items():
        page = page.replace(place, (templates / name).read_text(encoding="utf-8"))
    payload = _payload(explored, generator)
    for place, text in {"/*DATA*/": payload.json, "/*ARRAYS*/": payload.block}.items():
        page = page.replace(place, text)
    size = len(page.encode())
    if size > LARGEST:
        raise StudyError(f"The explorer has {size:,} bytes, and at most {LARGEST:,} are allowed.")
    path.write_text(page, encoding="utf-8")


def _payload(explored: Explored, generator: np.random.Generator) -> Payload:
    """Return the data of the page."""
    records, drawn = explored.study.smooth.records, explored.drawn
    support = records.support
    _, *shown = events_from({"impact_speed": explored.impact_speeds})  # the page lists crashes itself
    payload = Payload(
        {
            "study": explored.name,
            "tested": explored.tested["name"],
            "reference": CUT_IN.references[""],
            "vehicles": described_vehicles(explored.tested),
            "others": other_vehicles(explored.vehicles["vehicle"], explored.tested["name"]),
            "events": [
                {"name": CUT_IN.event_in_words(event), "threshold": event.threshold} for event in shown
            ],
            "lead_speeds": list(support.lead_speeds),
            "range_max": support.range_max,
            "exposure": exposure_of(records.size, explored.exposure),
            "published": {
                "answer": published_of(explored.answer, "event"),
                "vehicles": published_of(explored.vehicles, "vehicle"),
            },
        }
    )
    add_lines(payload, explored_lines(drawn, records.lead_speed, support, pilots(), generator))
    add_laws(payload, explored.study, drawn, log_ratios(drawn, support))
    add_records(payload, records, generator)
    if not explored.is_simulated and explored.crash_map is not None:
        add_map(payload, explored.crash_map, SHOWN_EVENTS, generator)
    if not explored.is_simulated and explored.runs is not None:
        add_runs(payload, explored.runs)
    return payload
