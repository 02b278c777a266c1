"""Figures of the answer: laws, regions and worlds are in words, and only the rows that matter are drawn."""

from pathlib import Path

import pandas as pd
from accelerated_evaluation.answer.candidates.calibration import HOST
from accelerated_evaluation.publishing.figures.coverage import WORLDS, fig24_worlds
from accelerated_evaluation.publishing.figures.laws import fig22_calibration

RESULTS = Path(__file__).resolve().parents[3] / "benchmarks" / "results"


def test_every_kind_of_world_is_in_words_with_its_number_of_worlds():
    worlds = pd.read_csv(RESULTS / "worlds.csv")
    drawn, data = fig24_worlds(worlds)
    assert set(WORLDS) == set(worlds["kind"])
    ours = data[data["procedure"] == "this project"]
    written = [label.get_text() for label in drawn.axes[0].get_yticklabels()]
    assert written[: len(ours)] == ours["kind"].map(WORLDS).tolist()
    numbers = [text.get_text() for text in drawn.axes[-1].texts]
    assert numbers[:-1] == ours["worlds"].astype(str).tolist()


def test_the_fastest_cell_of_each_range_and_the_widest_near_misses_are_drawn():
    cells = [
        "R 0 to 5 m, 1 to 2 m/s",
        "R 0 to 5 m, above 2 m/s",
        "R 5 to 9 m, 3 to 4 m/s",
        "R 5 to 9 m, above 4 m/s",
    ]
    events = ["crash", "impact above 5 m/s", "range at most 1 m", "range at most 2 m", "TTC at most 1 s"]
    places = {"closing speed": cells, "replay": events, HOST: ["v_L 5 to 8 m/s, host above 9 m/s"]}
    rows = [
        (law, kind, where)
        for law in ("all", "other", "paper: x")
        for kind in places
        for where in places[kind]
    ]
    table = pd.DataFrame(rows, columns=["law", "counted", "where"])
    table = table.assign(recorded=1, expected=1.0, low=0, high=2)
    _, data = fig22_calibration(
        table[(table["law"] != "paper: x") | (table["counted"] != "replay")], "made up"
    )
    assert len(data) == 3 * 10 - 5  # all rows of the table
    shown = data[data["drawn"]]
    nearest = [cells[1], cells[3], "crash", "range at most 2 m", "TTC at most 1 s"]
    assert shown.loc[shown["law"] == "all", "where"].tolist() == nearest
    assert shown.loc[shown["law"] == "paper: x", "where"].tolist() == nearest[:2]
    assert not shown["law"].eq("other").any()
