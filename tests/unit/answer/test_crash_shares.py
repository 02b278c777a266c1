"""Shares of the crashes by the size of a variable, against a law and a vehicle that are known exactly."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from accelerated_evaluation.answer.ways.crash_shares import crash_shares
from accelerated_evaluation.scenarios import SCENARIOS

PEDESTRIAN = replace(SCENARIOS["pedestrian"], divided_by=("pedestrian_speed_mps", (1.0, 3.0)))


@dataclass
class UniformLaw:
    """Pedestrian speeds from -4 to 4 m/s, all equally likely."""

    def draw(self, n, generator):
        return np.column_stack([np.full(n, 8.0), generator.uniform(-4, 4, n), np.full(n, 20.0)])


class SlowCrashes:
    """Crashes with all pedestrians below 1 m/s, and with those from 3 m/s up of one direction."""

    def simulate(self, speed, walking_speed, distance):
        crash = (np.abs(walking_speed) < 1) | (walking_speed < -3)
        none = np.zeros(len(crash), dtype=bool)
        return PEDESTRIAN.outcomes_of([crash, ~none, none, none, np.abs(walking_speed), none, none])


def test_shares_and_probabilities_are_those_of_the_law():
    n = 40_000
    table = crash_shares(PEDESTRIAN, UniformLaw(), SlowCrashes(), np.random.default_rng(1), simulations=n)
    error = 4 * np.sqrt(0.25 / n)
    assert table["at_least"].tolist() == [0, 1, 3]
    assert table["below"].tolist() == [1, 3, np.inf]
    assert table["encounters"].to_numpy() == pytest.approx([0.25, 0.5, 0.25], abs=error)
    assert table["crashes"].to_numpy() == pytest.approx([2 / 3, 0, 1 / 3], abs=2 * error)
    assert table["crash_probability"].to_numpy() == pytest.approx(
        [1, np.nan, 0.5], abs=2 * error, nan_ok=True
    )
    assert table["probability_above"].to_numpy() == pytest.approx([3 / 8, 1 / 6, 1 / 2], abs=2 * error)
    assert table["impact_speed"].to_numpy() == pytest.approx([0.5, np.nan, 3.5], abs=2 * error, nan_ok=True)
    expected = np.sqrt(3 / 8 * 5 / 8 / n)
    assert table["standard_error"][0] == pytest.approx(expected, rel=0.02)


def test_a_vehicle_without_crashes_has_no_shares():
    """Wrong: a probability of 0 with an error of 0."""

    class Fast(UniformLaw):
        def draw(self, n, generator):
            return super().draw(n, generator) * [1, 0, 1] + [0, 2, 0]

    table = crash_shares(PEDESTRIAN, Fast(), SlowCrashes(), np.random.default_rng(1), simulations=100)
    assert table["encounters"].tolist() == [0, 1, 0]
    assert table["crashes"].isna().all()
    assert table[["crash_probability", "probability_above", "standard_error"]].isna().all(axis=None)


def test_a_scenario_without_such_a_variable_has_no_rows():
    plain = replace(PEDESTRIAN, divided_by=None)
    table = crash_shares(plain, UniformLaw(), SlowCrashes(), np.random.default_rng(1))
    assert table.empty
    assert "crashes" in table
