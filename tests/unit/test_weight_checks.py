"""Checks of importance sampling, on a toy with a known probability and on the authors' experiments."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.answer.stored_experiments import (
    COLUMNS,
    authors_records,
    read_experiments,
    stored_experiments,
)
from accelerated_evaluation.answer.weight_checks import Experiment, crude_runs_needed, weight_table
from accelerated_evaluation.scenarios import SCENARIOS
from scipy.stats import norm

DATA = Path(__file__).resolve().parents[2] / "data"
PUBLISHED = DATA / "stored_experiments" / "published.csv"
NAMES = {
    "left_turn": ("sdv_speed_mps", "turning_speed_mps", "distance_to_conflict_m"),
    "pedestrian": ("vehicle_speed_mps", "pedestrian_speed_mps", "distance_m"),
}
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
    return weight_table(experiments, generator.standard_normal((3000, 2)), ("a", "b")).set_index("experiment")


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


def test_crude_runs_contradict_an_experiment_that_missed_a_part():
    generator = np.random.default_rng(2)
    wrong, right = toy((2.0,), generator), toy((0.0, 2.0, -2.0), generator)
    x = generator.standard_normal((3000, 2))
    events = int(happens(x).sum())
    assert wrong.crude_check(len(x), events) < 0.01 < right.crude_check(len(x), events)
    regions = [experiment.event_regions(x, happens(x), ("a", "b")) for experiment in (wrong, right)]
    assert regions[0]["p"].min() * len(regions[0]) < 0.01 < regions[1]["p"].min() * len(regions[1])
    assert regions[0].loc[regions[0]["p"].idxmin(), "low"] == -np.inf


def test_the_number_of_crude_runs_that_shows_an_error():
    runs = crude_runs_needed(5e-3, 1e-2)
    wrong = Experiment(np.zeros((100, 1)), np.full(100, 5e-3), np.ones(100, bool))
    assert wrong.crude_check(int(runs), round(runs * 1e-2)) < 0.01
    assert wrong.crude_check(int(runs / 2), round(runs / 2 * 1e-2)) > 0.01
    assert crude_runs_needed(1e-2, 1e-2) == np.inf


def test_an_experiment_without_an_event_has_no_estimate():
    row = Experiment(np.zeros((50, 1)), np.ones(50), np.zeros(50, bool)).row()
    assert row["probability"] == 0
    assert row["high95"] == 1
    assert row["effective_events"] == 0


@pytest.mark.parametrize("scenario", NAMES)
def test_a_third_of_the_stored_rows_agrees_with_the_published_estimates(scenario):
    published = pd.read_csv(PUBLISHED).query("scenario == @scenario").set_index("experiment")
    experiments = read_experiments(DATA / scenario / "verdicts.csv.gz", NAMES[scenario], 1.0)
    assert list(experiments) == list(published.index)
    for name, experiment in experiments.items():
        own = experiment.row()
        error = np.hypot(own["error"], published.loc[name, "error"])
        assert abs(own["probability"] - published.loc[name, "probability"]) < 3 * error
        share = own["events"] / published.loc[name, "events"]
        assert share == pytest.approx(own["simulations"] / 5000, abs=0.12)


def test_the_checks_warn_of_the_stored_experiments():
    records = experiments_as_records()
    paths = DATA / "left_turn" / "verdicts.csv.gz", PUBLISHED
    table = stored_experiments(*paths, "left_turn", records, NAMES["left_turn"])
    stored, doubled = (table[table["weights"] == weights] for weights in ("as stored", "doubled"))
    assert stored["warns_mean"].all()  # the weights are half of the right ones
    assert stored["mean_weight"].between(0.4, 0.6).all()
    assert doubled["warns_events"].all()
    assert doubled["warns_mean"].sum() == 2
    assert not doubled["converged"].any()
    assert (doubled["errors_off"] > 1).all()
    assert doubled["crude_runs"].between(500, 4000).all()


def test_the_authors_records_are_those_of_their_fit():
    left_turn, pedestrian = (
        authors_records(SCENARIOS[name], DATA.parent / SCENARIOS[name].records) for name in NAMES
    )
    assert left_turn.shape == (1000, 3)
    assert pedestrian.shape == (983, 3)
    table = stored_experiments(
        DATA / "left_turn" / "verdicts.csv.gz", PUBLISHED, "left_turn", left_turn, NAMES["left_turn"]
    )
    assert set(COLUMNS) <= set(table)
    assert table.loc[table["weights"] == "doubled", "warns_region"].sum() == 2


def experiments_as_records():
    """Stand in for the records: the rows of one experiment, resampled by their weights."""
    one = read_experiments(DATA / "left_turn" / "verdicts.csv.gz", NAMES["left_turn"], 2.0)["root123_3_raw_5"]
    chosen = np.random.default_rng(3).choice(len(one.x), 1000, p=one.weight / one.weight.sum())
    return one.x[chosen]
