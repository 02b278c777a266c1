"""Probabilities in the explorer and in Python at random settings of the sliders, and how long a change takes.

For every setting Python computes the crash map of the vehicle, checks it as in a study, and finds from it the
probability of the event under a sample of the draws of the law. The page, opened in Chromium, computes the
same from its own lines: a first result at once, and the settled one after the refinement.

    python benchmarks/explorer_agreement.py results/spmd benchmarks/results/explorer.csv
"""

import argparse
import json
import os
import shutil
import time
from pathlib import Path

import numpy as np
import pandas as pd
from accelerated_evaluation.answer.explored import DrawnLaws
from accelerated_evaluation.answer.law_study import LawStudy
from accelerated_evaluation.answer.smooth_family import read_family
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.checked import require_right_map
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.mapping import map_crashes
from accelerated_evaluation.crash_map.maps import Grid
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.splines import Support
from accelerated_evaluation.publishing.explorer.vehicles import SLIDERS
from accelerated_evaluation.records.segments import read_encounters
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.parameters import parameter_names
from accelerated_evaluation.vehicles.protocol import CRASH, VEHICLES
from playwright.sync_api import sync_playwright
from tqdm import tqdm

SETTINGS, DRAWS, SEED = 200, 100, 30
EVENTS = (CRASH, CUT_IN.event("impact_speed", 5.0), CUT_IN.event("impact_speed", 10.0))
KINDS = ("acc_aeb", "acc_aeb", "acc_aeb", "acc_only", "cc_human", "rss", "fsm")
SETTLED = "() => window.page && window.page.isSettled"
ASK = """([name, values, threshold]) => {
  const vehicle = explorer.vehicle(name), stops = vehicle.sliders.map((slider, k) =>
    slider.stops.findIndex((stop) => stop.value === values[k]));
  const event = page.meta.events.find((each) => each.name !== "crash" && each.threshold === threshold);
  Object.assign(page.state, { vehicle: name, stops, event: event ? event.name : "crash" });
  page.showControls();
  page.update();
  return Array.from(page.found.draws);
}"""
STARTS = "(name) => explorer.vehicle(name).sliders.map((slider) => slider.stops[slider.start].value)"
FOUND = "() => [Array.from(page.found.draws), page.milliseconds, page.settledMilliseconds]"


def main() -> None:
    """Compare the two at random settings, and write one row for each."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("results", type=Path, help="folder of a finished study")
    parser.add_argument("table", type=Path, help="CSV file to write")
    parser.add_argument("--page", type=Path, help="the explorer; by default that of the study's book")
    parser.add_argument("--family", type=Path, help="the family file; by default that of the study")
    parser.add_argument("--settings", type=int, default=SETTINGS, help="number of random settings")
    parser.add_argument("--first", type=int, default=0, help="number of the first setting")
    arguments = parser.parse_args()
    config = json.loads((arguments.results / "config.json").read_text())
    support = Support.configured(config)
    records = DistinctRecords.of(read_encounters(arguments.results / "encounters.parquet"), support)
    family = arguments.family or arguments.results / "laws/family.npz"
    seed = config["seed"]
    study = LawStudy.of_family(
        read_family(family, records), config["answer"]["draws"], child_generator(seed, "laws", "weigh")
    )
    draws = study.draws(child_generator(seed, "laws", "draws"))
    drawn = DrawnLaws.of(study, draws, child_generator(0, "none"))
    limits = config["filters"]
    grid = Grid(
        lead_speed_min=limits["lead_speed_min"],
        lead_speed_max=limits["lead_speed_max"],
        range_max=limits["range_max"],
        lead_speed_cells=30,
        range_cells=50,
        refinement=8,
        closing_speed_max=45.0,
        closing_speed_points=240,
    )
    rows = []
    page = arguments.page or arguments.results / "book/explorer.html"
    with sync_playwright() as driver:
        options = ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=options)
        opened = browser.new_page()
        opened.goto(page.resolve().as_uri())
        opened.wait_for_function(SETTLED)
        for number in tqdm(range(arguments.first, arguments.first + arguments.settings), desc="settings"):
            generator = child_generator(SEED, "settings", number)
            compared = _compared(opened, drawn, records, grid, support, generator)
            rows.append({"setting": number} | compared)
        browser.close()
    pd.DataFrame(rows).to_csv(arguments.table, index=False, float_format="%.6g")


def _compared(opened, drawn, records, grid, support, generator):
    """Return one row: a random setting, both probabilities, and the times that the page needed."""
    kind, event = KINDS[generator.integers(len(KINDS))], EVENTS[generator.integers(len(EVENTS))]
    vehicle_class = VEHICLES[kind]
    parameters = {name: getattr(vehicle_class(), name) for name in parameter_names(vehicle_class)}
    values = []
    for slider in SLIDERS[kind]:
        stops = slider.values(parameters[slider.parameter])
        value = stops[generator.integers(len(stops))]
        parameters = slider.parameters(parameters, value)
        values.append("published" if value is None else f"{value:g}")
    begin = time.perf_counter()
    vehicle = vehicle_class(**parameters)
    mapped = require_right_map(vehicle, map_crashes(vehicle, grid, [event], generator), generator)
    lines = CrashLines.of(mapped, records.lead_speed, event, support)
    chosen = np.arange(0, drawn.answered, max(1, drawn.answered // DRAWS))
    probabilities = np.array([lines.probability(*drawn.laws[k]) for k in chosen])
    spent = time.perf_counter() - begin
    threshold = None if event == CRASH else event.threshold
    # A new event needs the vehicle as in the study and the careful human, too; a slider that moves does not.
    starts = opened.evaluate(STARTS, kind)
    opened.evaluate(ASK, [kind, starts, threshold])
    opened.wait_for_function(SETTLED)
    first = np.array(opened.evaluate(ASK, [kind, values, threshold]))[chosen]
    opened.wait_for_function(SETTLED)
    settled, first_ms, settled_ms = opened.evaluate(FOUND)
    found = np.array(settled)[chosen]
    return {
        "vehicle": kind,
        "sliders": " ".join(values),
        "event": CUT_IN.event_in_words(event),
        "python": probabilities.mean(),
        "page": found.mean(),
        "ratio_first": first.mean() / probabilities.mean(),
        "ratio": found.mean() / probabilities.mean(),
        "ratio_low10": np.quantile(found, 0.1) / np.quantile(probabilities, 0.1),
        "ratio_high90": np.quantile(found, 0.9) / np.quantile(probabilities, 0.9),
        "first_ms": first_ms,
        "settled_ms": settled_ms,
        "python_s": spent,
    }


if __name__ == "__main__":
    main()
