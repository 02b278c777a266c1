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

from accelerated_evaluation.answer.consequences.rates import Rate
from accelerated_evaluation.answer.study_tables import WHOLE
from accelerated_evaluation.answer.ways.explored import (
    FINE,
    LIMITS,
    ExploredLines,
    Sections,
    Simulate,
    explored_lines,
    log_ratios,
    refinements,
)
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import StudyError
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.publishing.explorer.vehicles import (
    TITLES,
    described_vehicles,
    other_vehicles,
    pilots,
)
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.protocol import Vehicle, events_of

RATIO_STEP = 0.05  # step to which the logarithms of ratios are rounded
STEPS = 61_440  # number of steps of the variable along lines, to which its values are rounded
RECORD_STEP = 1 / 256  # step to which the variables of records are rounded, in their units
RECORDS, URGENT = 10_000, 300  # records on the page: a random sample, and those nearest to a crash
FARTHEST = 200.0  # largest value of a variable without limits that can be replayed
PLOTTED = 0.999  # share of the records that are within the axes
SHOWN_LINES = 6_000  # largest number of lines of a crash map that the page contains
GAMMA_LEVELS = (np.arange(15) + 0.5) / 15  # levels of the quantiles that represent the rate of cut-ins
# Families of laws in words, by the beginning of the names of their members.
FAMILIES = {
    "exponential": "Exponential tails",
    "generalised": "Generalised Pareto tails",
    "two kinds": "Tails of two kinds of drivers",
    "hazard": "A smooth hazard without a tail",
    "truncated normals": "Mixtures of truncated normal distributions",
    "Gaussian copula": "A Gaussian copula",
    "independent": "Independent variables",
    "kernel": "A kernel around each record",
}
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


def add_lines(payload: Payload, law: Sections, lines: ExploredLines) -> None:
    """Add the lines of the explorer, along which only one variable varies.

    The base law on a line is given by the values of this variable at `Sections.nodes`. They are counted in
    steps from the value with the hazard 0, and stored as differences of successive values.
    """
    for name, values, node in zip(("first", "second"), lines.cells.point, lines.positions, strict=True):
        payload.add(f"line_{name}", values, "f4")
        if not law.by_line:
            payload.add(f"line_{name}_node", node, "f4")
    for name in ("probability", "distance"):
        payload.add(f"line_{name}", getattr(lines, name), "f4")
    step = float(law.grid[-1] - law.grid[0]) / STEPS
    levels = np.round((lines.along - law.grid[0]) / step)
    payload.add("along", np.diff(levels, axis=1, prepend=0).T, "u2")
    hazards = np.arange(1, 4 * law.depth + 1) / 4
    payload.add(
        "distance_at", np.append(0.0, np.where(hazards < np.log(2), 0.0, ndtri_exp(-hazards) ** 2)), "f4"
    )
    payload.text["lines"] = {
        "depth": law.depth,
        "origin": float(law.grid[0]),
        "step": step,
        "limits": sorted([float(law.grid[0]), float(law.grid[-1])]),
        "upper_set": law.is_upper_set,
    }


def add_laws(payload: Payload, law: Sections, lines: ExploredLines) -> None:
    """Add the law of each draw, and its log ratios to the base law where they are stored."""
    logs = log_ratios(law, lines)
    payload.add("member", law.member, "u1")
    order = np.argsort(law.member, kind="stable")  # draws of one law are similar, so differences are small
    levels = np.round((logs[order] - LIMITS[0]) / RATIO_STEP).astype(int)
    # Differences modulo 2^16, along the levels and between draws, are compressed better than the values.
    differences = np.diff(np.diff(levels, axis=-1, prepend=0), axis=0, prepend=0)
    payload.add("ratios", differences & 0xFFFF, "u2")
    for name, matrix in zip(("first", "second", "level"), refinements(law), strict=True):
        payload.add(f"refine_{name}", matrix, "f4")
    payload.text["laws"] = {
        "answered": law.answered,
        "order": order.tolist(),
        "members": [{"name": name, "family": family_in_words(name)} for name in law.names],
        "weights": list(law.weights),
        "by_line": law.by_line,
        "coarse": logs.shape[1:],
        "fine": [*(logs.shape[1:3] if law.by_line else FINE), law.depth + 1],
        "ratio_step": RATIO_STEP,
        "ratio_low": LIMITS[0],
    }


def family_in_words(name: str) -> str:
    """Return the family of a law in words, or the name of a law that is not known here."""
    return next((words for begin, words in FAMILIES.items() if name.startswith(begin)), name)


def add_records(
    payload: Payload, scenario: Scenario, x: Array, known: Vehicle, generator: np.random.Generator
) -> None:
    """Add records x, shape (n, d), to the data of the page, which shows them.

    These are the records that are nearest to a crash of a known vehicle, and a random sample of the others.
    """
    score = scenario.events[0].score(known.simulate(*x.T))
    order = np.argsort(score, kind="stable")
    drawn = generator.choice(order[URGENT:], min(RECORDS, max(len(x) - URGENT, 0)), replace=False)
    shown = x[np.concatenate([order[:URGENT], drawn])]
    payload.add("records", np.round(shown.T / RECORD_STEP), "u2")
    payload.text["record_step"] = RECORD_STEP


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
    payload.add("map_first", crash_map.lead_speed[line], "f4")
    payload.add("map_second", 1 / crash_map.inverse_range[line], "f4")
    payload.add("map_start", intervals.start[chosen], "f4")
    payload.add("map_end", np.minimum(intervals.end[chosen], crash_map.grid.closing_speed_max), "f4")


def add_runs(payload: Payload, scenario: Scenario, runs: pd.DataFrame) -> None:
    """Add the simulations of a slow vehicle, ``laws/runs.csv``, without repeated ones."""
    once = runs[runs["phase"] != "repeat"]
    payload.add("runs", once[list(scenario.names)].to_numpy().T, "f4")
    payload.add("run_crash", once["event"], "u1")


def rate_quantiles(cut_ins: int, exposure: Mapping[str, float | None]) -> dict[str, Any]:
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


@dataclass(frozen=True)
class Explored:
    """The results of a study from which a page is made."""

    name: str  # of the study
    scenario: Scenario
    tested: Mapping[str, Any]  # section of the configuration for the vehicle under test
    impact_speeds: Sequence[float]  # thresholds of the further events [m/s]
    law: Sections  # random draws from the laws
    x: Array  # the records, (n, 3)
    exposure: Mapping[str, float | None]  # ``kilometres`` and ``hours`` of the records
    answer: pd.DataFrame  # the published answer by event
    vehicles: pd.DataFrame  # the published answer by vehicle
    # of the vehicle under test, which the page shows if it cannot simulate the vehicle
    crash_map: CrashMap | None
    runs: pd.DataFrame | None  # ``laws/runs.csv`` of a slow vehicle under test

    @property
    def is_simulated(self) -> bool:
        """Whether the page can simulate the vehicle under test."""
        return self.tested["name"] in TITLES and self.tested["name"] in self.scenario.vehicles

    @property
    def axes(self) -> list[dict[str, Any]]:
        """The variables with their axes: that of the slider, and the horizontal and vertical ones of the map.

        The axes reach as far as the records, unless the law says otherwise.
        """
        order = [k for k in range(self.scenario.dimension) if k != self.law.scanned] + [self.law.scanned]
        reach = np.ceil(np.quantile(self.x, PLOTTED, axis=0) / 5) * 5
        axes = []
        for place, k in enumerate(order):
            each = self.scenario.variables[k]
            low, high = (self.law.plane.low, self.law.plane.high) if place < 2 else ((), ())
            axes.append(
                {
                    "variable": k,
                    "name": each.in_title.replace("sdv", "vehicle"),
                    "unit": each.unit,
                    "low": float(low[place]) if place < 2 else 0.0,
                    "high": float(min(high[place], reach[k]) if place < 2 else self.law.shown or reach[k]),
                    "limits": [max(each.low, 0.0), min(each.high, FARTHEST)],
                }
            )
        return axes


def write_page(explored: Explored, templates: Path, path: Path, generator: np.random.Generator) -> None:
    """Write the explorer of a study: an HTML page on which a reader changes the vehicle.

    The random ``generator`` chooses the lines (pairs of two variables on which vehicles are simulated) and
    the records that are shown. A page larger than `LARGEST` is a StudyError.
    """
    page = (templates / "explorer.html").read_text(encoding="utf-8")
    for place, name in PLACES.items():
        page = page.replace(place, (templates / name).read_text(encoding="utf-8"))
    payload = _payload(explored, generator)
    noun, (slider, horizontal, vertical) = explored.scenario.noun, (axis["name"] for axis in explored.axes)
    texts = {"noun": noun, "nouns": f"{noun}s", "slider": _capital(slider), "slider_name": slider}
    texts |= {"horizontal": horizontal, "vertical": vertical}
    for name, text in texts.items():
        page = page.replace(f"{{{{{name}}}}}", text)
    for place, text in {"/*DATA*/": payload.json, "/*ARRAYS*/": payload.block}.items():
        page = page.replace(place, text)
    size = len(page.encode())
    if size > LARGEST:
        raise StudyError(f"The explorer has {size:,} bytes, and at most {LARGEST:,} are allowed.")
    path.write_text(page, encoding="utf-8")


def _payload(explored: Explored, generator: np.random.Generator) -> Payload:
    """Return the data of the page."""
    scenario, law = explored.scenario, explored.law
    reference = scenario.references.get("")
    answer = explored.answer
    if "encounters" in answer:
        answer = answer[answer["encounters"] == WHOLE]
    faster = [
        event
        for event in events_of(scenario, {"impact_speed": explored.impact_speeds})
        if event.quantity == "impact_speed"
    ]
    payload = Payload(
        {
            "study": explored.name,
            "noun": scenario.noun,
            "axes": explored.axes,
            "scanned": law.scanned,
            "tested": explored.tested["name"],
            "reference": reference,
            "vehicles": described_vehicles(scenario, explored.tested),
            "others": other_vehicles(explored.vehicles["vehicle"], explored.tested["name"]),
            "events": [
                {"name": scenario.event_in_words(event), "threshold": event.threshold} for event in faster
            ],
            "exposure": rate_quantiles(len(explored.x), explored.exposure),
            "published": {
                "answer": published_of(answer, "event"),
                "vehicles": published_of(explored.vehicles, "vehicle"),
            },
        }
    )
    tried = [_crashes_of(vehicle) for vehicle in pilots(scenario)]
    lines = explored_lines(law, tried, generator)
    add_lines(payload, law, lines)
    add_laws(payload, law, lines)
    known = scenario.known_vehicle()
    add_records(payload, scenario, explored.x, known, generator)
    if not explored.is_simulated and explored.crash_map is not None:
        add_map(payload, explored.crash_map, SHOWN_EVENTS, generator)
    if not explored.is_simulated and explored.runs is not None:
        add_runs(payload, scenario, explored.runs)
    return payload


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]


def _crashes_of(vehicle: Vehicle) -> Simulate:
    return lambda *columns: vehicle.simulate(*columns).crash
