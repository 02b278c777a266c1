"""Crude Monte Carlo: a known probability, and the same counts however many batches follow."""

import math

import numpy as np
import pytest
from accelerated_evaluation import CUT_IN, Problem
from accelerated_evaluation.laws.distributions import BoundedExponential, Empirical
from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.methods.crude import crude_course, crude_estimates, simulate_batches
from accelerated_evaluation.vehicles.protocol import Outcomes

THRESHOLD = 0.3
SPEEDS = Empirical([10.0, 12.0])
LAW = IndependentLaw(
    "toy",
    {"slow": 600, "fast": 400},
    BoundedExponential(80.0, 1 / 75),
    {"slow": BoundedExponential(10.0), "fast": BoundedExponential(15.0)},
    {"slow": SPEEDS, "fast": SPEEDS},
)
SETTINGS = {"seed": 7, "batches": 12, "batch_size": 2000}


class Toy:
    """Crashes where TTC^-1 exceeds a threshold."""

    def simulate(self, lead_speed, range_, closing_speed):
        zeros = np.zeros(range_.size)
        return Outcomes(closing_speed / range_ > THRESHOLD, zeros, zeros, zeros)


def run(**settings):
    return simulate_batches(Problem(CUT_IN, Toy(), law=LAW), **(SETTINGS | settings))


def test_the_estimate_is_the_probability_within_its_error():
    table = crude_estimates(run(batch_size=50_000), 0.2).set_index("segment")
    exact = {"slow": math.exp(-10 * THRESHOLD), "fast": math.exp(-15 * THRESHOLD)}
    exact["all"] = 0.6 * exact["slow"] + 0.4 * exact["fast"]
    for segment, probability in exact.items():
        row = table.loc[segment]
        error = math.sqrt(probability * (1 - probability) / row["simulations"])
        assert abs(row["probability"] - probability) < 4 * error
    assert table.loc["all", "simulations"] == 600_000
    share = table.loc["slow", "simulations"] / 600_000
    assert abs(share - 0.6) < 4 * math.sqrt(0.6 * 0.4 / 600_000)


def test_it_can_be_extended_and_shortened():
    whole = run()
    assert run() == whole
    assert run(batches=5) == whole[:5]


def test_batches_differ():
    batches = [str(counts) for counts in run()]
    assert len(set(batches)) == len(batches)


def test_a_segment_without_a_crash_has_an_upper_bound_alone():
    table = crude_estimates([{"a": [600, 0], "b": [400, 3]}, {"a": [400, 0], "b": [600, 1]}], 0.2)
    safe, _, every = table.to_dict("records")
    assert (safe["simulations"], safe["crashes"], safe["probability"], safe["ci_low"]) == (1000, 0, 0, 0)
    assert safe["ci_high"] == pytest.approx(1 - 0.1 ** (1 / 1000), rel=1e-10)
    assert safe["ci95_high"] == pytest.approx(1 - 0.025 ** (1 / 1000), rel=1e-10)
    assert (every["segment"], every["simulations"], every["crashes"]) == ("all", 2000, 4)
    assert every["ci95_low"] < every["ci_low"] < every["probability"] < every["ci_high"] < every["ci95_high"]


def test_the_course_ends_at_the_estimate():
    batches = run()
    course, estimates = crude_course(batches, 0.2), crude_estimates(batches, 0.2)
    assert course["simulations"].tolist() == [2000 * k for k in range(1, 13)]
    assert course.iloc[-1].to_dict() == estimates.iloc[-1][course.columns].to_dict()
