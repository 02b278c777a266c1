"""Figures and tables of injuries: what they show is what the result tables say."""

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.answer.consequences.injuries.curves import FRONTAL, LEVELS
from accelerated_evaluation.answer.consequences.injuries.tables import injury_tables, tabulated_risks
from accelerated_evaluation.answer.ways.posterior import Posterior
from accelerated_evaluation.publishing.figures.injuries import fig32_injuries
from accelerated_evaluation.publishing.tables.exact import balance_digest, curves_digest, injuries_in_words

KEYS = list(tabulated_risks())
KNOWN, UNKNOWN = {"kilometres": 1000.0, "hours": None}, {"kilometres": None, "hours": None}


def made(exposure, scale=1.0):
    """Tables of two vehicles with made-up draws."""
    generator = np.random.default_rng(1)
    posteriors = {}
    for name, factor in (("under test", scale), ("other", 5.0)):
        crash = factor * 1e-6 * generator.lognormal(0, 0.4, 200)
        expected = crash[:, None] * np.linspace(0.01, 0.05, len(KEYS))
        posteriors[name] = Posterior(crash, generator.integers(2, size=200)), expected
    return injury_tables(posteriors, "under test", KEYS, 100, exposure, 0.2)


def drawn(tables):
    return fig32_injuries(tables["injuries"], tables["injuries_by_curve"], "made up")


@pytest.mark.parametrize("exposure", [KNOWN, UNKNOWN])
def test_the_figure_shows_the_medians_in_its_unit(exposure):
    tables = made(exposure)
    figure, data = drawn(tables)
    per = "million kilometres" if exposure is KNOWN else "cut-in"
    assert figure.axes[0].get_xlabel() == f"injured drivers, of both cars, per {per}"
    shown = data[data[FRONTAL].isna()].set_index(["vehicle", "level"])["median"]
    injuries = tables["injuries"]
    expected = injuries[injuries["per"] == per].set_index(["vehicle", "level"])["median"]
    pd.testing.assert_series_equal(shown.sort_index(), expected.sort_index())
    # The marks of single curves are in the same unit: those per cut-in, times the cut-ins in the distance.
    marks = data[data[FRONTAL].notna()]
    factor = 1e6 * 100.5 / 1000 if exposure is KNOWN else 1.0
    assert marks["median"].sum() == pytest.approx(factor * tables["injuries_by_curve"]["median"].sum())
    assert injuries_in_words(injuries, "fatal").endswith(f"per {per}")


def test_a_vehicle_without_crashes_has_no_row():
    tables = made(KNOWN, scale=0.0)
    _, data = drawn(tables)
    assert set(data.loc[data[FRONTAL].isna(), "vehicle"]) == {"other"}
    none = injury_tables({}, "under test", KEYS, 100, KNOWN, 0.2)
    figure, data = drawn(none)
    assert data.empty
    assert figure.axes[0].texts[0].get_text() == "no crash"
    assert injuries_in_words(none["injuries"], "fatal") == "not known"


def test_digests_for_a_reader():
    tables = made(KNOWN)
    assert [*balance_digest(tables["risk_balance"])] == ["reference", *LEVELS]
    assert len(curves_digest(tables["injury_curves"])) == len(tables["injury_curves"])
