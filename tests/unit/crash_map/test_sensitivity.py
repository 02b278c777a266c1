"""Refits for the crash probability alone, and the table of what it depends on."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import map_crashes
from accelerated_evaluation.crash_map.exact import ALL, exact_probabilities
from accelerated_evaluation.crash_map.sensitivity import (
    Levels,
    Refit,
    fit_for_crashes,
    is_repeated,
    study_cap,
    study_sensitivity,
)
from accelerated_evaluation.laws.distributions import BoundedExponential, BoundedNormal
from accelerated_evaluation.laws.paper.models import fit_paper_laws
from accelerated_evaluation.laws.paper.piecewise import PieceFamily
from accelerated_evaluation.records.segments import assign_segments
from accelerated_evaluation.vehicles import AccAeb
from builders import coarse_grid

CAP = 23.49
GRID = coarse_grid(speeds=(5, 15, 8), ranges=(75, 40), closing=(CAP, 120), refinement=6)
MODELS = {
    "inverse_range": {
        "pieces": "bounded exponential",
        "two_pieces": {"method": "quantiles", "quantiles": [0.8]},
        "three_pieces": {"method": "quantiles", "quantiles": [0.7, 0.9]},
    },
    "inverse_ttc": {
        "body": {"kind": "bounded normal", "components": 1},
        "tail": "bounded exponential",
        "knots": {"method": "quantiles", "quantiles": [0.95]},
    },
}
SETTINGS = {
    "inverse_ttc_knots": [0.9, 0.95],
    "inverse_range_knots": [0.8],
    "lead_speed_edges": [[5, 15]],
    "outlier_rows": [1],
}


@pytest.fixture(scope="module")
def encounters():
    generator = np.random.default_rng(1)
    n = 4000
    inverse_range = 1 / 75 + generator.exponential(0.012, n)
    inverse_ttc = np.abs(generator.normal(0, 0.06, n)) + (generator.random(n) < 0.1) * generator.exponential(
        0.06, n
    )
    table = pd.DataFrame(
        {
            "lead_speed": generator.uniform(5, 15, n),
            "range": 1 / inverse_range,
            "closing_speed": inverse_ttc / inverse_range,
            "inverse_range": inverse_range,
            "inverse_ttc": inverse_ttc,
        }
    )
    return assign_segments(table, [5, 10, 15])


@pytest.fixture(scope="module")
def crash_map():
    return map_crashes(AccAeb(), GRID, [], np.random.default_rng(1))


@pytest.fixture(scope="module")
def models(encounters):
    return fit_paper_laws(encounters, MODELS, 75.0, "test", CAP)


@pytest.mark.parametrize("variant", ["two_pieces", "three_pieces"])
def test_quick_refit_gives_the_probability_of_the_full_fit(encounters, crash_map, models, variant):
    full = exact_probabilities(crash_map, models[variant])[ALL].probability
    quick = Refit.by(crash_map, CAP).probability(encounters, Levels.of(models[variant])).probability
    # The levels are read off the weights, which ties and rounding move by less than one row.
    assert quick == pytest.approx(full, rel=2e-2)
    wrong = Refit.by(crash_map, CAP).probability(
        encounters, replace(Levels.of(models[variant]), inverse_ttc=0.9)
    )
    assert wrong.probability != pytest.approx(full, rel=2e-2)


def test_body_is_fitted_in_full_where_crashes_reach_into_it(encounters, models):
    levels = Levels.of(models["two_pieces"])
    quick = fit_for_crashes(encounters, levels, 75.0, smallest_inverse_ttc=0.5, closing_speed_max=CAP)
    full = fit_for_crashes(encounters, levels, 75.0, smallest_inverse_ttc=0.05, closing_speed_max=CAP)
    assert all(isinstance(law.components[0], BoundedExponential) for law in quick.inverse_ttc.values())
    assert all(isinstance(law.components[0], BoundedNormal) for law in full.inverse_ttc.values())


def test_levels_of_a_model(models):
    levels = Levels.of(models["three_pieces"])
    assert levels.inverse_range == pytest.approx((0.7, 0.9), abs=1e-3)
    assert levels.inverse_ttc == pytest.approx(0.95, abs=1e-3)
    assert levels.body == PieceFamily("bounded normal")
    assert levels.tail == levels.pieces_of_range == PieceFamily("bounded exponential")


def test_repeated_rows():
    table = pd.DataFrame({"lead_speed": [1.0, 1.0, 2.0, 1.0, 1.0], "range": [5.0, 5.0, 5.0, 5.0, 6.0]})
    assert is_repeated(table).tolist() == [False, True, False, False, False]


def test_table_of_choices(encounters, crash_map, models):
    table = study_sensitivity(crash_map, models, "two_pieces", encounters, SETTINGS)
    assert table.columns.tolist() == ["choice", "value", "probability", "standard_error"]
    assert table.groupby("choice", sort=False).size().to_dict() == {
        "model": 3,
        "knot of TTC^-1": 2,
        "knot of R^-1, two pieces": 1,
        "segments of v_L": 1,
        "repeated rows": 1,
        "outliers": 1,
    }
    assert (table["probability"] > 0).all()
    # Nothing repeats, so dropping what does changes nothing.
    chosen = table.set_index(["choice", "value"])["probability"]
    base = Refit.by(crash_map, CAP).probability(encounters, Levels.of(models["two_pieces"])).probability
    assert chosen["repeated rows", "drop"] == base


def test_without_outlier_rows_none_are_dropped(encounters, crash_map, models):
    table = study_sensitivity(crash_map, models, "two_pieces", encounters, SETTINGS | {"outlier_rows": []})
    assert "outliers" not in set(table["choice"])


def test_crashes_rise_with_the_cap(encounters, crash_map, models):
    generator = np.random.default_rng(2)
    table = study_cap(AccAeb(), crash_map, models["two_pieces"], [20.0, CAP], generator)
    assert table["value"].tolist() == ["20", "23.49"]
    low, high = table["probability"]
    assert low < high / 2
    base = exact_probabilities(crash_map, models["two_pieces"])[ALL]
    capped = replace(models["two_pieces"], closing_speed_max=20.0)
    refit = Refit.by(crash_map, 20.0).probability(encounters, Levels.of(capped))
    for same, error in ((exact_probabilities(crash_map, capped)[ALL], 0.0), (refit, 2e-2 * low)):
        error += 4 * np.hypot(same.standard_error, table["standard_error"].iloc[0])
        assert abs(same.probability - low) < error < 0.5 * low
    error = np.hypot(base.standard_error, table["standard_error"].iloc[1])
    assert abs(high - base.probability) < 4 * error
