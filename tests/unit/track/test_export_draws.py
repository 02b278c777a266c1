"""An exported set under a mean law: the table of weights under every draw, and the recipe that uses it."""

import re
from dataclasses import replace

import numpy as np
import pytest
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.track.export import page, table_of
from accelerated_evaluation.track.weighted_set import draw_weighted_set
from mean_law import braking_probabilities, encounters_, law_  # noqa: F401

CRASH = 4.0  # [m/s^2], constant deceleration from which a cut-in ends in a crash
SETS = 8


@pytest.fixture(scope="module")
def few(law):
    return replace(law.thinned(8), closing_speed_max=np.inf)


@pytest.fixture(scope="module")
def sets(few):
    return [draw_weighted_set(few, 300, 1.5, np.random.default_rng(seed)) for seed in range(SETS)]


def crashes(drawn):
    return drawn.table["closing_speed"] ** 2 / (2 * drawn.table["range"]) > CRASH


def test_the_weights_of_each_draw_give_its_probability(few, sets):
    found = np.array([drawn.draws.loc[crashes(drawn)].drop(columns="scenario").sum() for drawn in sets])
    error = found.std(axis=0) / np.sqrt(SETS)
    known = braking_probabilities(few, CRASH)
    assert np.all(np.abs(found.mean(axis=0) - known) < 6 * error)  # eight sets
    under_the_mean = np.array([drawn.table.loc[crashes(drawn), "weight"].sum() for drawn in sets]).mean()
    assert np.abs((under_the_mean - known) / error).max() > 12  # the wrong weights


def test_the_recipe_prints_the_intervals(sets, tmp_path, monkeypatch, capsys):
    drawn = sets[0]
    names = [f"scenario_{number:03d}" for number in drawn.table["scenario"]]
    table_of(drawn, names, CUT_IN).to_csv(tmp_path / "scenarios.csv", index=False)
    drawn.draws.to_csv(tmp_path / "weights.csv", index=False)
    outcomes = drawn.table[["scenario"]].assign(crash=crashes(drawn).astype(int))
    outcomes.to_csv(tmp_path / "outcomes.csv", index=False)
    scripts = re.findall(r"```python\n(.*?)```", page(drawn, {}, CUT_IN), re.DOTALL)
    monkeypatch.chdir(tmp_path)
    exec("".join(scripts), {})
    printed = capsys.readouterr().out
    median = float(re.search(r"records (\S+)", printed)[1])
    sums = drawn.draws.loc[crashes(drawn)].drop(columns="scenario").sum()
    assert median == pytest.approx(np.median(sums), rel=0.25)  # it includes the error of the set
    low, high = map(float, re.search(r"80% interval (\S+) to (\S+)\n95%", printed).groups())
    assert low < np.quantile(sums, 0.2) < np.quantile(sums, 0.8) < high
    assert len(scripts) == 2
    assert len(scripts[1].splitlines()) <= 20
