"""Tests of regulations, and the numerical error of a simulation, against vehicles whose crashes are known."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from accelerated_evaluation.answer.candidates.smooth_family import SmoothFamily
from accelerated_evaluation.answer.ways.numerical_error import STEPS, numerical_errors
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.mapping import map_crashes
from accelerated_evaluation.laws.distributions import Empirical
from accelerated_evaluation.laws.smooth.draws import SmoothDraws
from accelerated_evaluation.laws.smooth.family import members_at
from accelerated_evaluation.laws.smooth.mean import MeanLaw
from accelerated_evaluation.scenarios.cut_in import EU_2022_1426
from accelerated_evaluation.scenarios.prescribed import PrescribedTest, prescribed_table
from accelerated_evaluation.vehicles import Outcomes
from accelerated_evaluation.vehicles.loading import load_vehicle
from builders import coarse_grid
from rate_car import exponential_records

ALL = {10, 20, 30, 40, 50, 60}  # [km/h], closing speeds of the tests


@pytest.mark.parametrize(
    ("vehicle", "failed"), [("acc_aeb", set()), ("acc_only", {40, 50, 60}), ("cc_human", ALL)]
)
def test_cut_ins_of_the_european_regulation(vehicle, failed):
    x = np.concatenate([test.encounters for test in EU_2022_1426])
    table = prescribed_table(EU_2022_1426, {vehicle: load_vehicle(vehicle).simulate(*x.T).crash})
    speeds = table["test"].str.extract(r"^(\d+)")[0].astype(int)
    assert set(speeds) == ALL
    assert set(speeds[~table["passed"]]) == failed


def test_the_times_are_those_of_the_formula():
    """The regulation rounds v / (2 x 6 m/s^2) + 0.25 s to hundredths."""
    for test in EU_2022_1426:
        lead, range_, closing = test.encounters.T
        np.testing.assert_allclose(range_ / closing, closing / 12 + 0.25, atol=0.0051)
        assert np.unique(lead).size == lead.size


def test_one_crash_fails_a_test():
    tests = (PrescribedTest("a", "b 1", np.zeros((2, 3))), PrescribedTest("c", "b 2", np.zeros((3, 3))))
    table = prescribed_table(tests, {"car": np.array([False, False, False, True, False])})
    assert table["passed"].tolist() == [True, False]
    assert table["crashes"].tolist() == [0, 1]


@dataclass(frozen=True)
class Car:
    """Crashes above a closing speed that falls with the step of the motion."""

    time_step: float = 0.1
    per_step: float = 20.0  # [m/s per s]

    @property
    def limit(self):
        return 6.0 + self.per_step * self.time_step

    def at_steps(self, time_step, decision_step):
        return replace(self, time_step=time_step)

    def simulate(self, lead_speed, range_, closing_speed):
        crash = closing_speed > self.limit
        none = np.zeros(crash.size)
        return Outcomes(
            crash, np.where(crash, 0.0, range_), np.where(crash, 0.5, 2.0), none + closing_speed * crash
        )


class Fixed:
    """A vehicle whose steps cannot be changed."""

    def simulate(self, lead_speed, range_, closing_speed):
        return Car().simulate(lead_speed, range_, closing_speed)


def test_the_ratio_of_crash_probabilities():
    """Excesses are exponential with a known mean, so the ratio for a lower limit has a closed form."""
    records = exponential_records(6000, 2.0)
    family = SmoothFamily.of(records, members_at((0.9,)), blocks=2)
    speeds = family.speeds("exponential 0.9")
    crash_map = map_crashes(
        Car(),
        coarse_grid(speeds=(5, 35, 4), ranges=(75, 10)),
        [],
        np.random.default_rng(1),
    )
    lines = CrashLines.of(crash_map, records.lead_speed, support=records.support)
    of_lead = {"all": Empirical(records.lead_speed)}
    alone = SmoothDraws.of_laws(family.family.ranges, [speeds])
    law = MeanLaw("made up", {"all": records.size}, alone, of_lead)
    table = numerical_errors({"car": Car(), "fixed": Fixed()}, lines, law, np.random.default_rng(2))
    assert table["steps"].tolist() == list(STEPS)
    for row in table.itertuples():
        low, high = (
            replace(lines, start=np.full(lines.row.size, limit)).masses(law).sum()
            for limit in (Car(0.02).limit, Car().limit)
        )
        assert row.ratio == pytest.approx(low / high, abs=4 * row.standard_error)
        assert (
            abs(row.ratio - 1) > 10 * row.standard_error
        )  # a table that compares a car with itself would fail
        assert row.fewer == 0
        assert row.more > 0
