"""The table of credibility: every answer comes from the table that its row names."""

import inspect

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.publishing.tables import credibility as module
from accelerated_evaluation.publishing.tables.credibility import QUESTIONS, UNKNOWN, credibility

RESULTS = {
    "account": pd.DataFrame({"rows_in": ["5000", "4990"], "rows_kept": ["4990", "4321"]}),
    "scope": ("my_car", {"range_max": 70}),
    "seed": 77,
    "choices": pd.DataFrame({"choice": ["as in the answer", "one", "two"], "median": [2e-6, 1e-6, 7e-6]}),
    "near_miss_answer": pd.DataFrame({"largest": [100, 200], "median": [3e-6, 1.8e-6]}).assign(
        **dict.fromkeys(["probability", "low50", "high50", "low95", "high95"], 9e-6), low80=4e-7, high80=5e-6
    ),
    "data_quality": pd.DataFrame({"reading": ["as in the answer"], "median": [2e-6]}),
    "answer_budget": pd.DataFrame(
        {"source": ["data", "sampling", "together"], "variance_share": [0.25, 0.75, 1.0]}
    ),
    "extrapolation": pd.DataFrame({"part": ["all", "recorded"], "share": [1.0, 0.09]}),
    "numerical_error": pd.DataFrame(
        {"vehicle": ["under test", "b"], "steps": "fine", "ratio": [1.23, 9.0], "standard_error": 0.04}
    ),
    "fold_calibration": pd.DataFrame(
        {"law": ["all", "b"], "division": "halves", "outside": [41, 3], "cells": 128, "by_chance": 8.0}
    ),
    "scenario_agreement": pd.DataFrame({"kind": ["firm"], "agree": [1498], "verdicts": [1500]}),
    "all_cut_ins": pd.DataFrame(
        {
            "vehicle": "under test",
            "per": "closing cut-in",
            "part": ["closing, lead keeps its speed", "all"],
            "median": [2e-6, 5e-6],
            "upper95": [np.nan, 9e-6],
            "missing": "records of opening cut-ins",
        }
    ),
    "counted_crashes": pd.DataFrame(
        {"who": ["under test"], "kind": "predicted", "in_hundred_car": 0.96, "verdict": "compatible"}
    ),
    "criteria": pd.DataFrame(
        {
            "criterion": ["1e-6 per km", "1e-7 per hour"],
            "verdict": ["met under the models", "not known"],
            "encounters": ["all cut-ins", np.nan],
            "probability": 0.97,
            "weakest_choice": ["equal weights", np.nan],
            "weakest_probability": [0.96, np.nan],
            "upper95": 7e-7,
            "beyond": 0.96,
            "replayed_upper95": np.nan,
            "reason": ["", "it is not stated in how many hours the records were made"],
        }
    ),
}
REPORT = pd.DataFrame({"check": ["unit"], "verdict": ["fine"], "seen": ""}).assign(advice="", explained=False)
EXPECTED = {
    "encounters_account": "5,000 rows were read, and 4,321 are used",
    "config.json": "my_car",
    "choices": "(two)",
    "near_miss_answer": "without a law: median 1.8 × 10⁻⁶, 80 % interval 4 × 10⁻⁷ to 5 × 10⁻⁶",
    "data_quality": UNKNOWN,
    "answer_budget": "sampling 75 %, data 25 %",
    "extrapolation": "91 %",
    "numerical_error": "fine: times 1.23 ± 0.04",
    "fold_calibration": "halves: 41 of 128 counts outside their limits, 8 by chance",
    "agreement": "1,498 of 1,500 firm verdicts",
    "all_cut_ins": "missing: records of opening cut-ins",
    "counted_crashes": "0.96 crashes in two million miles: compatible",
    "provenance.json": "root seed 77",
    "criteria": "1e-6 per km: met under the models, for all cut-ins (met with probability 0.97",
}


def test_every_answer_is_from_its_table():
    table = credibility(**RESULTS).set_index("table")["answer"]
    assert set(table.index) == set(EXPECTED)
    for name, expected in EXPECTED.items():
        assert expected in table[name], name


@pytest.mark.parametrize(
    "name",
    [
        "answer_budget",
        "near_miss_answer",
        "extrapolation",
        "numerical_error",
        "all_cut_ins",
        "counted_crashes",
    ],
)
def test_results_without_rows_are_not_known(name):
    table = credibility(**{name: RESULTS[name].iloc[:0]})
    assert len(table) == 1
    assert table["answer"].iloc[0].startswith(UNKNOWN)


def test_every_question_is_asked_in_a_published_table():
    asked = {name for _, name, *_ in QUESTIONS}
    assert asked == {*inspect.signature(module.credibility_table).parameters}


def test_results_that_a_study_lacks_are_not_asked_for():
    needed = ("account", "scope", "seed", "records_report", "answer_budget", "extrapolation")
    table = module.credibility_table(**{name: RESULTS.get(name, REPORT) for name in needed})
    assert len(table) == len(needed)


def test_without_a_known_crash_nothing_is_known_of_the_extrapolation():
    table = credibility(extrapolation=pd.DataFrame(columns=["part"]))
    assert table["answer"].tolist() == [UNKNOWN]


def test_a_vehicle_that_never_crashes_has_no_number_where_none_is_known():
    none = {
        "extrapolation": RESULTS["extrapolation"].assign(share=float("nan")),
        "numerical_error": RESULTS["numerical_error"].assign(ratio=float("nan"), standard_error=float("nan")),
    }
    table = credibility(**none).set_index("table")["answer"]
    assert (table == UNKNOWN).all(), table.to_dict()
