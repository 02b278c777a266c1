"""Checks of importance sampling, on a toy with a known probability and on the authors' experiments."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.answer.calibration import mid_p
from scipy.stats import norm

sys.path.append(str(Path(__file__).resolve().parents[2] / "benchmarks"))

from stored_experiments import (
    NAMES,
    PUBLISHED,
    Experiment,
    authors_records,
    crude_runs_needed,
    read_experiments,
    stored_experiments,
)

pytestmark = pytest.mark.studies
RESULTS = Path(__file__).resolve().parents[2] / "benchmarks/results/stored_experiments.csv"
LIMITS = 2.0, -2.3  # the toy's event is beyond either of them, in the first variable
EXACT = norm.sf(LIMITS[0]) + norm.cdf(LIMITS[1])


def happens(x):
    return (x[:, 0] > LIMITS[0]) | (x[:, 0] < LIMITS[1])


def toy(means, generator, n=5000, factor=1.0):
    """Draw from equal parts of normal distributions about means; f is standard normal in two dimensions."""
    x = generator.standard_normal((n, 2))
    x[:, 0] += generator.choice(means, n)
    proposal = np.mean([norm.pdf(x[:, 0] - mean) for mean in means], axis=0)
    return Experiment(x, factor * norm.pdf(x[:, 0]) / proposal, happens(x))


@pytest.fixture(scope="module")
def table():
    generator = np.random.default_rng(1)
    experiments = {
        "right": toy((0.0, 2.0, -2.0), generator),
        "one part": toy((0.0, 2.0, -2.0), generator, factor=0.5),
        "half missed": toy((2.0,), generator),
    }
    reference = generator.standard_normal((3000, 2))
    rows = {name: experiment.checked(reference, ("a", "b")) for name, experiment in experiments.items()}
    return pd.DataFrame(rows).T


def test_a_good_experiment_passes_all_checks(table):
    row = table.loc["right"]
    assert abs(row["probability"] - EXACT) < 4 * row["error"]
    assert row["low95"] < EXACT < row["high95"]
    assert not row[["warns_events", "warns_mean", "warns_region"]].any()
    assert row["mean_weight"] == pytest.approx(1, abs=4 * row["mean_weight_error"])


def test_halved_weights_show_in_their_mean(table):
    row = table.loc["one part"]
    assert row["warns_mean"]
    assert row["probability"] == pytest.approx(EXACT / 2, rel=0.2)


def test_a_missed_part_shows_in_a_control_region_and_not_in_the_standard_error(table):
    row = table.loc["half missed"]
    assert row["probability"] < EXACT - 5 * row["error"]  # confident, and wrong
    assert row["effective_events"] > 100
    assert row["warns_region"]
    assert row["region"].startswith("a from -")
    assert row["weighted"] < row["share"] / 2


def test_the_number_of_crude_runs_that_shows_an_error():
    runs = crude_runs_needed(5e-3, 1e-2)
    assert mid_p(round(runs * 1e-2), runs * 5e-3) < 0.01
    assert mid_p(round(runs / 2 * 1e-2), runs / 2 * 5e-3) > 0.01
    assert crude_runs_needed(1e-2, 1e-2) == np.inf


def test_an_experiment_without_an_event_has_no_estimate():
    row = Experiment(np.zeros((50, 1)), np.ones(50), np.zeros(50, bool)).row()
    assert row["probability"] == 0
    assert row["high95"] == 1
    assert row["effective_events"] == 0


@pytest.mark.parametrize("scenario", NAMES)
def test_a_third_of_the_stored_rows_agrees_with_the_published_estimates(scenario):
    published = pd.read_csv(PUBLISHED).query("scenario == @scenario").set_index("experiment")
    experiments = read_experiments(scenario)
    assert list(experiments) == list(published.index)
    for name, experiment in experiments.items():
        own = experiment.row()
        error = np.hypot(own["error"], published.loc[name, "error"])
        assert abs(own["probability"] - published.loc[name, "probability"]) < 3 * error
        share = own["events"] / published.loc[name, "events"]
        assert share == pytest.approx(own["simulations"] / 5000, abs=0.12)


def test_the_published_table_is_that_of_the_stored_files_and_warns():
    left_turn, pedestrian = map(authors_records, NAMES)
    assert left_turn.shape == (1000, 3)
    assert pedestrian.shape == (983, 3)
    table = stored_experiments("left_turn", left_turn)
    published = pd.read_csv(RESULTS)
    own = published[published["scenario"] == "left_turn"]
    pd.testing.assert_frame_equal(table, own, rtol=1e-9, check_dtype=False)
    stored, doubled = (table[table["weights"] == weights] for weights in ("as stored", "doubled"))
    assert stored["warns_mean"].all()  # the weights are half of the right ones
    assert stored["mean_weight"].between(0.4, 0.6).all()
    assert doubled["warns_events"].all()
    assert doubled[["warns_mean", "warns_region"]].sum().tolist() == [2, 2]
    assert not doubled["converged"].any()
    assert (doubled["errors_off"] > 1).all()
    assert doubled["crude_runs"].between(500, 4000).all()
