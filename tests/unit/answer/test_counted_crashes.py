"""Counts of the 100-Car study by another reading of its table, exact Poisson limits, and verdicts by hand."""

import csv
import gzip
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.answer.consequences import counted_crashes as module
from accelerated_evaluation.answer.consequences.counted_crashes import (
    CUT_IN,
    LANE_CHANGE,
    SLOWED,
    STRUCK,
    compare_with_counts,
    contradictions,
    count_events,
    count_of,
    poisson_limits,
    predicted_rows,
    read_events,
    replayed_row,
)
from accelerated_evaluation.answer.ways.comparison import compared_table, vehicle_table
from accelerated_evaluation.answer.ways.posterior import Posterior
from accelerated_evaluation.answer.ways.words import ratio_row
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.publishing.figures.counted import GROUPS, fig31_counted_crashes
from accelerated_evaluation.scenarios.cut_in import CUT_IN as CUT_IN_SCENARIO
from accelerated_evaluation.scenarios.left_turn import LEFT_TURN
from scipy.stats import binom, gamma, poisson

FOLDER = Path(__file__).resolve().parents[3] / "data" / "crash_counts"
EVENTS = FOLDER / "hundred_car_events.tsv.gz"
PUBLISHED = pd.read_csv(FOLDER / "published_rates.csv")
VEHICLES = pd.DataFrame(
    {
        "vehicle": ["careful", "careless", "unknown"],
        "resolved": [True, True, False],
        "probability": [1e-6, 1e-3, np.nan],
        "low95": [5e-7, 5e-4, np.nan],
        "high95": [2e-6, 2e-3, np.nan],
    }
)
EXPOSURE = pd.DataFrame({"event": ["cut-in", "crash"], "per": "kilometre", "mean": [0.05, 1e-7]})


def by_hand(condition):
    """Count the rows of the table whose fields, counted from 1, meet a condition."""
    with gzip.open(EVENTS, "rt", encoding="latin-1", newline="") as file:
        return sum(condition(["", *row]) for row in csv.reader(file, delimiter="\t"))


def in_front(row):
    return row[13].startswith("Other vehicle lane change") and row[13].endswith("in front of subject")


def striking(row):
    return row[10] == "Rear-end, striking"


@pytest.mark.parametrize(
    ("what", "condition"),
    [
        (CUT_IN, in_front),
        (STRUCK, lambda row: in_front(row) and striking(row)),
        (LANE_CHANGE, lambda row: "Other vehicle lane change" in row[13]),
        (SLOWED, lambda row: "Other vehicle ahead" in row[13] and striking(row)),
    ],
)
@pytest.mark.parametrize(("severity", "coded"), [("crash", "Crash"), ("near-crash", "Near-Crash")])
def test_counts_are_those_of_another_reading_of_the_table(what, condition, severity, coded):
    counts = count_events(read_events(EVENTS))
    expected = by_hand(lambda row: row[5] == coded and condition(row))
    assert count_of(counts, what, severity) == expected
    assert not (severity == "near-crash" and expected == 0)


def test_the_limits_of_a_count_are_exact():
    for count in (0, 1, 7, 79):
        low, high = poisson_limits(count, 0.9)
        assert poisson.cdf(count, high) == pytest.approx(0.05)
        assert count == 0 or poisson.sf(count - 1, low) == pytest.approx(0.05)
        # The normal approximation, which is the wrong way for few events, does not pass.
        assert abs(poisson.cdf(count, count + 1.645 * count**0.5) - 0.05) > 0.003
    assert poisson_limits(0)[0] == 0


def test_predictions_and_verdicts_by_hand():
    rows = predicted_rows(VEHICLES, 0.05, 1).set_index("who")
    assert list(rows.index) == ["careful", "careless"]
    cut_ins = 0.05 * 1e6 * 1.609344
    assert rows.loc["careful", "per_million_miles"] == pytest.approx(1e-6 * cut_ins)
    assert rows.loc["careless", "in_hundred_car"] == pytest.approx(2 * 1e-3 * cut_ins)
    at_least = 2 * 5e-4 * cut_ins
    assert rows.loc["careless", "probability_of_so_few"] == pytest.approx((1 + at_least) * np.exp(-at_least))
    assert rows["verdict"].tolist() == ["compatible with the count", "more than were counted"]


def test_vehicles_that_counts_contradict_are_marked_wherever_they_are_a_reference():
    """The least rate with a mark is that of which at most one crash has a probability of 5 %."""
    distance, least = 2e6 * 1.609344 * 0.05, gamma.isf(0.05, 2)
    posteriors = {
        name: Posterior(np.full(9, rate / distance), np.zeros(9, int))
        for name, rate in {"own": 0.1, "below": 0.99 * least, "above": 1.01 * least}.items()
    }
    records = SimpleNamespace(scenario=CUT_IN_SCENARIO, per_km=0.05)
    found = contradictions({**posteriors, "unknown": None}, records)
    assert [*found] == ["above"]
    table = compared_table(posteriors, found)
    assert table["contradicted_by_counts"].tolist() == [False, True]
    remarks = [ratio_row(row)[2] for row in table.to_dict("records")]
    assert [remark.endswith("), contradicted by counts") for remark in remarks] == [False, True]
    rows = pd.DataFrame({"vehicle": [*posteriors], "scan": "none"})
    assert vehicle_table(rows, posteriors, {}, found)["contradicted_by_counts"].tolist() == [0, 0, 1]
    for scenario, rate in ((CUT_IN_SCENARIO, None), (LEFT_TURN, 0.05)):
        other = SimpleNamespace(scenario=scenario, per_km=rate)
        assert contradictions(posteriors, other) == {}


def test_near_crashes_that_were_replayed_have_exact_limits():
    (row,) = replayed_row(70).to_dict("records")
    assert row["in_hundred_car"] == pytest.approx(70 * 3 / 38)
    assert row["per_million_miles"] == pytest.approx(35 * 3 / 38)
    low, high = row["low95"] / 35, row["high95"] / 35
    assert binom.sf(2, 38, low) == pytest.approx(0.025)
    assert binom.cdf(3, 38, high) == pytest.approx(0.025)
    assert abs(binom.cdf(3, 38, 0.99 * high) - 0.025) > 0.001


def test_without_a_known_distance_only_counts_are_left():
    table = compare_with_counts(VEHICLES, EXPOSURE.iloc[:0], read_events(EVENTS), PUBLISHED)
    assert set(table["kind"]) == {"counted", "replayed"}
    together = compare_with_counts(VEHICLES, EXPOSURE, read_events(EVENTS), PUBLISHED)
    assert list(table.columns) == list(together.columns) == list(module.OUTPUT)
    rates = together.set_index("who")["per_million_miles"]
    assert rates["GES 1999"] == pytest.approx(539_000 / 2_691_335)
    assert together.set_index("who").loc["GES 1999", ["low95", "high95"]].isna().all()


@pytest.mark.parametrize("content", [b"1\t2\n", b"\t".join([b"Crush"] * 20) + b"\n", b"\x1f\x8b damaged"])
def test_another_table_is_refused(tmp_path, content):
    path = tmp_path / "events.tsv"
    path.write_bytes(content)
    with pytest.raises(InputError, match="Restore the file"):
        read_events(path)


def test_the_figure_has_every_row_once_and_says_what_it_shows(tmp_path):
    table = compare_with_counts(VEHICLES, EXPOSURE, read_events(EVENTS), PUBLISHED)
    drawn, data = fig31_counted_crashes(table, "made up")
    drawn.savefig(tmp_path / "31.png")
    assert len(data) == len(table)
    (arrow,) = (line for line in drawn.axes[0].get_lines() if line.get_marker() == "<")
    none = table[table["per_million_miles"] == 0]
    assert sorted(arrow.get_xdata()) == pytest.approx(sorted(none["high95"]))
    labels = [label.get_text() for label in drawn.axes[0].get_yticklabels()]
    assert set(GROUPS.values()) <= set(labels)
    assert drawn.get_supxlabel().startswith("Data: made up")
    only_counts = compare_with_counts(VEHICLES, EXPOSURE.iloc[:0], read_events(EVENTS), PUBLISHED)
    drawn, data = fig31_counted_crashes(only_counts, "made up")
    drawn.savefig(tmp_path / "without.png")
    assert set(data["kind"]) == {"counted", "replayed"}
