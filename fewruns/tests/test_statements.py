"""What the runs say against the direction of the scores, and against the statement of an upper set."""

import numpy as np
import pytest
from fewruns import estimate
from fewruns.statements import events_below_others, point_the_wrong_way


def disc(z):
    margin = np.hypot(z[:, 0] - 4.0, z[:, 1]) - 0.6
    return margin < 0, margin


def plane(z):
    return z[:, 0] > 4, 4 - z[:, 0]


def turned(z):
    return z[:, 0] > 4, z[:, 0] - 4


def test_a_changed_sign_of_the_scores_is_noticed_and_does_not_change_the_answer():
    found, usual = (estimate(event, 2, 0, deterministic=True) for event in (turned, plane))
    assert "scores of events are larger" in found.warning
    assert found.warning in str(found)
    assert not usual.warning
    assert "warning" not in str(usual)
    assert 0.5 < found.probability / usual.probability < 2


@pytest.mark.parametrize("score", [np.zeros(200), np.random.default_rng(0).normal(size=200)])
def test_scores_without_information_are_not_called_turned(score):
    assert not point_the_wrong_way(np.arange(200) < 40, score)
    assert not point_the_wrong_way(np.zeros(200, bool), score)
    assert not point_the_wrong_way(np.ones(200, bool), score)


def test_the_statement_of_an_upper_set_is_compared_with_the_runs():
    found, usual = (estimate(event, 2, 0, deterministic=True, upper_set=True) for event in (disc, plane))
    assert "upper_set was stated" in found.warning
    assert not usual.warning
    assert not estimate(disc, 2, 0, deterministic=True).warning  # nothing was stated


def test_an_upper_set_in_one_input_is_one_whatever_the_others_do():
    z = np.random.default_rng(1).normal(size=(300, 3))
    wave = z[:, 1] > np.sin(z[:, 0]) + 0.5 * z[:, 2] ** 2
    assert events_below_others(z, wave) == 0
    layer = wave & (z[:, 1] < np.sin(z[:, 0]) + 0.5 * z[:, 2] ** 2 + 0.5)
    above = z[layer] + [0.0, 3.0, 0.0]
    assert events_below_others(np.vstack([z, above]), np.append(layer, np.zeros(len(above), bool))) > 0
    line = np.linspace(-3, 3, 50)[:, None]
    assert events_below_others(line, line[:, 0] > 1) == 0
    between = (line[:, 0] > 1) & (line[:, 0] < 2)
    assert events_below_others(line, between) == between.sum()
