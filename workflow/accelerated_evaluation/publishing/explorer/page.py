"""The page of the explorer: the templates in ``workflow/explorer``, filled with the data of a study."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.explored import DrawnLaws, explored_lines
from accelerated_evaluation.answer.explored_ratios import log_ratios
from accelerated_evaluation.answer.law_study import LawStudy
from accelerated_evaluation.base.errors import StudyError
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.publishing.explorer import payload as parts
from accelerated_evaluation.publishing.explorer.vehicles import TITLES, described_vehicles, pilots
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.vehicles.events import events_from

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

    config: Mapping[str, Any]
    study: LawStudy  # the laws with their weights
    drawn: DrawnLaws  # random draws from the laws
    exposure: Mapping[str, float | None]  # ``kilometres`` and ``hours`` of the records
    answer: pd.DataFrame  # the published answer by event
    vehicles: pd.DataFrame  # the published answer by vehicle
    # of the vehicle under test, which the page shows if it cannot simulate the vehicle
    crash_map: CrashMap | None
    runs: pd.DataFrame | None  # ``laws/runs.csv`` of a slow vehicle under test

    @property
    def tested(self) -> Mapping[str, Any]:
        """Section ``vehicle`` of the configuration, the vehicle under test."""
        return self.config["vehicle"]

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


def _payload(explored: Explored, generator: np.random.Generator) -> parts.Payload:
    """Return the data of the page."""
    records, drawn = explored.study.smooth.records, explored.drawn
    support, events = records.support, explored.config["answer"]["events"]
    _, *shown = events_from({"impact_speed": events.get("impact_speed", [])})  # the page lists crashes itself
    payload = parts.Payload(
        {
            "study": explored.config["study"],
            "tested": explored.tested["name"],
            "reference": CUT_IN.references[""],
            "vehicles": described_vehicles(explored.tested),
            "events": [
                {"name": CUT_IN.event_in_words(event), "threshold": event.threshold} for event in shown
            ],
            "lead_speeds": list(support.lead_speeds),
            "range_max": support.range_max,
            "exposure": parts.exposure_of(records.size, explored.exposure),
            "published": {
                "answer": parts.published_of(explored.answer, "event"),
                "vehicles": parts.published_of(explored.vehicles, "vehicle"),
            },
        }
    )
    parts.add_lines(payload, explored_lines(drawn, records.lead_speed, support, pilots(), generator))
    parts.add_laws(payload, explored.study, drawn, log_ratios(drawn, support))
    parts.add_records(payload, records, generator)
    if not explored.is_simulated and explored.crash_map is not None:
        parts.add_map(payload, explored.crash_map, SHOWN_EVENTS, generator)
    if not explored.is_simulated and explored.runs is not None:
        parts.add_runs(payload, explored.runs)
    return payload
