"""Few records: fits fall back to simpler pieces and say so; too few are refused before any work."""

import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import InputError, LawStudy
from accelerated_evaluation.answer.candidates import law_table as law_scores
from accelerated_evaluation.answer.candidates.smooth_family import SmoothFamily, named
from accelerated_evaluation.base.errors import ConvergenceError
from accelerated_evaluation.crash_map.sensitivity import Levels
from accelerated_evaluation.laws.distributions import BoundedExponential
from accelerated_evaluation.laws.paper.models import choose_knots, fit_paper_laws, refit, simpler_pieces
from accelerated_evaluation.laws.paper.piecewise import EXPONENTIAL, PieceFamily, fit_piecewise, usable_knots
from accelerated_evaluation.laws.smooth.family import FEWEST, LEVELS, DistinctRecords, Member
from accelerated_evaluation.publishing.figures.records import fig26_sample_size
from accelerated_evaluation.records.segments import MINIMUM_ROWS, assign_segments, require_rows
from accelerated_evaluation.study.configuration import load
from accelerated_evaluation.vehicles import AccAeb

RECORDS = Path(__file__).parents[3] / "data/spmd/cut_ins.parquet"
NORMALS = PieceFamily("bounded normal", 2)


@pytest.fixture(scope="module")
def recorded():
    rows = pd.read_parquet(RECORDS)
    rows["closing_speed"] = rows["inverse_ttc"] / rows["inverse_range"]
    return assign_segments(rows, [5, 15, 25, 35])


@pytest.fixture
def models():
    """Section models of the default configuration, its fits of R^-1 on a grid that takes less time."""
    models = load()["models"]
    for variant in ("two_pieces", "three_pieces"):
        models["inverse_range"][variant]["profile"]["points"] = 12
    return models


def rising(size=200):
    """Return values on [0, 0.2) whose density rises, which no normal with mean 0 has."""
    return BoundedExponential(-30.0, 0.0, 0.2).ppf((np.arange(size) + 0.5) / size)


def test_a_family_that_cannot_be_fitted_gives_way_to_a_simpler_one():
    x = rising()
    with pytest.raises(ConvergenceError):
        NORMALS.fit(x, 0.0, 0.2)
    assert NORMALS.fit_or_simpler(x, 0.0, 0.2) == EXPONENTIAL.fit(x, 0.0, 0.2)
    falling = 0.2 - x
    assert NORMALS.fit_or_simpler(falling, 0.0, 0.2) == NORMALS.fit(falling, 0.0, 0.2)


@pytest.mark.parametrize(
    ("knots", "expected"),
    [
        ([4.5], [4.5]),  # enough on both sides: not moved
        ([9.5], [8.0]),  # one value above: moved down to leave two
        ([99.0], [8.0]),
        ([-1.0], [2.0]),
        ([9.2, 9.5], [6.0, 8.0]),
        ([0.0, 0.5], [2.0, 4.0]),
    ],
)
def test_knots_leave_two_different_values_in_each_piece(knots, expected):
    assert usable_knots(np.repeat(np.arange(10.0), 3), knots) == expected


def test_too_few_different_values_for_the_pieces_are_refused():
    with pytest.raises(InputError, match="seen 3 different values; expected at least 4"):
        usable_knots(np.repeat([1.0, 2.0, 3.0], 50), [2.0])


def test_moved_knots_and_another_choice_of_knots_are_told():
    x = np.concatenate([rising(), [0.3, 0.4]])
    with pytest.warns(UserWarning, match=r"knots .* moved to .* to leave two values"):
        choose_knots(x, 0.0, [EXPONENTIAL] * 2, {"method": "values", "values": [0.35]})
    profile = {"method": "profile", "profile": {"low": 0.5, "high": 0.9, "points": 3}}
    with pytest.warns(UserWarning, match="chosen for exponential pieces"):
        (knot,) = choose_knots(rising(), 0.0, [PieceFamily("bounded normal"), EXPONENTIAL], profile)
    assert 0 < knot < 0.2


@pytest.mark.parametrize("size", [150, 500, 1000])
def test_any_sample_of_real_records_is_fitted(recorded, models, size):
    generator = np.random.default_rng(size)
    for _ in range(3 if size == 150 else 1):  # a small sample has most that can be simpler
        rows = np.sort(generator.choice(len(recorded), size, replace=False))
        with warnings.catch_warnings(record=True) as reported:
            warnings.simplefilter("always")
            laws = fit_paper_laws(recorded.iloc[rows], models, 75, "sample", 23.49)
        law = laws["two_pieces"]
        assert all(np.isfinite(segment.mean()) for segment in law.inverse_ttc.values())
        assert {str(warning.message) for warning in reported} >= set(simpler_pieces(law, models))
        assert Levels.of(law).tail == EXPONENTIAL


def test_simpler_pieces_name_variable_and_segment(recorded, models):
    fitted = fit_paper_laws(recorded.iloc[:: len(recorded) // 300], models, 75, "sample", 23.49)["two_pieces"]
    asked = models | {
        "inverse_ttc": models["inverse_ttc"] | {"body": {"kind": NORMALS.kind, "components": 9}}
    }
    reported = simpler_pieces(fitted, asked)
    assert len(reported) == 3
    assert all("TTC^-1 in segment" in line and "mixture of 9 bounded normals" in line for line in reported)


def test_errors_of_fits_name_variable_and_segment(recorded, models):
    flat = recorded.iloc[:: len(recorded) // 300].copy()
    flat.loc[flat["segment"] == "15-25", "inverse_ttc"] = 0.05
    with pytest.raises(
        InputError, match=r"TTC\^-1 in segment 15-25 m/s, sample of .* seen 1 different values"
    ):
        fit_paper_laws(flat, models, 75, "sample", 23.49)


def test_a_law_of_all_segments_is_refitted_to_one_that_has_nothing_beyond_its_last_knot():
    x = np.concatenate([rising(), [0.5, 0.6, 0.7]])
    law = fit_piecewise(x, 0.0, [0.1, 0.5], [EXPONENTIAL] * 3)
    assert refit(law, x) == law
    near = x[x < 0.2]
    assert refit(law, near).knots == (0.1, np.sort(near)[-2])


def test_a_segment_with_too_few_rows_is_refused_with_its_count(recorded):
    fast = recorded[recorded["segment"] == "25-35"]
    enough = pd.concat([recorded[recorded["segment"] != "25-35"], fast.iloc[:MINIMUM_ROWS]])
    require_rows(enough)
    with pytest.raises(InputError, match=r"segment 25-35 m/s: seen 29 of .* expected at least 30"):
        require_rows(enough.iloc[:-1])


@pytest.mark.parametrize(
    ("column", "what"),
    [
        ("inverse_range", "the range in all segments"),
        ("closing_speed", "the closing speed in all segments"),
        ("inverse_ttc", r"TTC\^-1 in segment .* m/s"),
    ],
)
def test_a_variable_that_hardly_varies_is_refused(recorded, column, what):
    rows = recorded.iloc[:: len(recorded) // 600]
    require_rows(rows)
    with pytest.raises(InputError, match=rf"{what}: seen 5 different values; expected at least 6"):
        require_rows(rows.assign(**{column: np.arange(len(rows)) % 5 + 1.0}))


def test_laws_of_few_records_have_tails_above_thresholds_that_some_exceed(recorded):
    rows = recorded.iloc[:: len(recorded) // 200].assign(range=lambda table: 1 / table["inverse_range"])
    smooth = SmoothFamily.of(DistinctRecords.of(rows))
    study = LawStudy.of_family(smooth, 20, np.random.default_rng(1))
    levels = {named()[name].level for name in study.names} - {None}
    assert levels < set(LEVELS)
    assert all(smooth.family.exceedances[level].index.size >= FEWEST for level in levels)
    assert np.isfinite(smooth.scores).all()
    assert study.weights.sum(axis=1) == pytest.approx(1)


def test_another_law_whose_fit_overflows_has_no_scores(recorded, monkeypatch):
    class Overflown:
        def given(self, places):
            return self

        def cumulative(self, closing_speed):
            return np.full(closing_speed.size, np.nan)

        log_density = cumulative

    rows = recorded.iloc[:: len(recorded) // 200].assign(range=lambda table: 1 / table["inverse_range"])
    smooth = SmoothFamily.of(DistinctRecords.of(rows), (Member(),))
    study = LawStudy.of_family(smooth, 20, np.random.default_rng(1))
    monkeypatch.setattr(law_scores, "regions", lambda records, _: {"all": np.zeros(records.size)})
    with pytest.warns(
        UserWarning, match="a regression cannot be fitted, and has no scores: .* parameters that overflow"
    ):
        scores = law_scores.score_laws(study, AccAeb(), {"a regression": lambda _: Overflown()})
    assert set(scores) == set(study.names)


def test_records_of_one_lead_speed_on_the_edge_of_a_cell_are_drawn():
    encounters = pd.DataFrame({"lead_speed": 20.0, "range": np.linspace(20, 60, 50)})
    _, data = fig26_sample_size(encounters, "data")
    assert data["records"].sum() == len(encounters)
    assert (data["lead_speed_high_m_per_s"] > data["lead_speed_low_m_per_s"]).all()


def test_differences_of_scores_have_the_error_of_a_sum_of_independent_terms():
    best, other = np.array([3.0, 1.0, 2.0, 5.0]), np.array([1.0, 2.0, 1.0, 1.0])  # differences 2, -1, 1, 4
    error = law_scores.difference_error(best - other)
    assert error == pytest.approx(np.sqrt(4 * 3.25))
    assert law_scores.errors_behind(best, other) == pytest.approx(6 / error)
    assert law_scores.errors_behind(best, best) == 0
    assert np.isnan(law_scores.difference_error(best - np.array([1.0, -np.inf, 1.0, 1.0])))
