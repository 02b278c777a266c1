"""Vehicles whose outcomes are draws of a probability: every method against closed forms, and its claims."""

import math
import sys
from pathlib import Path
from types import SimpleNamespace

import accelerated_evaluation as ae
import numpy as np
import pytest
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.cross_entropy.method import CrossEntropyMethod
from accelerated_evaluation.methods.surrogate import Surrogate
from accelerated_evaluation.track.weighted_set import draw_weighted_set
from accelerated_evaluation.vehicles.protocol import CRASH
from fewruns import SystemProblem
from law_folder import LAW as CUT_INS
from scipy.special import ndtr
from scipy.stats import binom
from test_export import exact as exact_by_map
from test_export import follow
from test_methods import LAW, Corner, estimates, exact, fits

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "benchmarks" / "samplers"))

from chance import Lapsing

DRAWN_BY_LAW = [name for name in METHODS if issubclass(METHODS[name], CrossEntropyMethod)]


class Never(Corner):
    """A vehicle that never crashes."""

    def simulate(self, lead_speed, range_, closing_speed):
        return super().simulate(lead_speed, range_ + 1e6, closing_speed)


def lapsing(rate, seed=1):
    """Return the vehicle that crashes in a corner, but for a share of its runs."""
    return Lapsing(Corner(), Never(), rate, np.random.default_rng(seed))


def noisy_half_space(spread, generator, *, deterministic=False, distance=3.5):
    def respond(z):
        score = distance - z @ [0.6, 0.8] + spread * generator.standard_normal(len(z))
        return score <= 0, score

    truth = float(ndtr(-distance / math.sqrt(1 + spread**2)))
    return SystemProblem(respond, 2, fingerprint="noisy", deterministic=deterministic), truth


@pytest.mark.parametrize("name", DRAWN_BY_LAW)
def test_importance_sampling_estimates_the_mean_over_chance(name):
    found = estimates(name, ae.Problem(ae.CUT_IN, lapsing(0.6), law=LAW))
    assert fits(found, 0.4 * exact())
    assert not fits(found, exact())  # of the vehicle that never lapses


def test_crude_monte_carlo_estimates_the_mean_over_chance():
    problem, truth = noisy_half_space(1.0, np.random.default_rng(2), distance=1.5)
    found = [
        METHODS["crude"]().estimate(problem, ae.Stopping(minimum_events=100), np.random.default_rng(seed))
        for seed in range(20)
    ]
    assert sum(each.covers(truth) for each in found) >= binom.ppf(1e-3, 20, 0.8)
    assert not any(each.covers(float(ndtr(-1.5))) for each in found)


def test_the_recipe_of_an_export_estimates_the_mean_over_chance(tmp_path):
    sets = [draw_weighted_set(CUT_INS, 300, 1.5, np.random.default_rng(seed)) for seed in range(60)]
    cars = [ae.load_vehicle(name) for name in ("acc_aeb", "acc_only")]
    (own, own_error), (other, other_error) = map(exact_by_map, cars)
    car = Lapsing(*cars, 0.3, np.random.default_rng(3))
    found = [follow(drawn, car, tmp_path) for drawn in sets]
    estimates = np.array([one["probability"] for one in found])
    variance = np.mean([one["variance"] for one in found]) / len(sets)
    reach = 3.5 * math.sqrt(variance + (0.7 * own_error) ** 2 + (0.3 * other_error) ** 2)
    assert abs(estimates.mean() - (0.7 * own + 0.3 * other)) < reach
    assert abs(estimates.mean() - own) > reach  # of the car that never lapses


def test_a_vehicle_that_crashes_in_thin_stripes_gets_no_number_that_claims_to_be_right():
    """From a distance the stripes look like chance, although the vehicle repeats itself."""
    vehicle = ae.load_vehicle("reg157")
    assert vehicle.deterministic
    problem = ae.Problem(ae.CUT_IN, vehicle, law=CUT_INS)
    assert problem.deterministic is False
    limited = ae.Stopping(minimum_events=1, maximum_simulations=150)
    found = Surrogate().estimate(problem, limited, np.random.default_rng(1))
    assert not found.converged
    assert found.diagnostics["differed"] == 0
    assert found.high > 0.01  # the truth is about 1.2 %


def test_a_replicate_without_an_estimate_is_described_next_to_one_with_an_estimate():
    problem = ae.Problem(ae.CUT_IN, Corner(), law=LAW)
    few = ae.Stopping(minimum_events=1, maximum_simulations=10)
    notes = {"estimate": Surrogate().estimate(problem, few, np.random.default_rng(1)), "not_ended": 0}
    notes |= {"failed": (1, 1e-7)}
    own = ae.SampledPosterior(np.geomspace(1e-7, 1e-6, 20), np.arange(20) % 2, np.full(20, 0.1), 10)
    answers = [
        ae.Answer(problem, ae.as_draws(LAW), {CRASH: posterior}, converged=posterior is not None, notes=notes)
        for posterior in (own, None)
    ]
    silent = SimpleNamespace(stop_lines=list, warning_lines=list, doubts=[], in_words="", per_km=None)
    silent.scenario = ae.CUT_IN
    silent.unseen, silent.replays = lambda probability: None, SimpleNamespace(replayed=0)
    found = ae.Estimated(answers, silent, silent, None, {}, ae.Request(replicates=2), silent)
    lines = found.lines()
    detailed = found.lines(verbose=True)
    assert set(lines) < set(detailed)
    for words in (
        "a part of the event that no run has met",
        "interval of the sampling alone",
        "repeats: none",
    ):
        assert sum(words in line for line in detailed) == 2
        # Without an estimate, the interval of the sampling alone is what is known.
        assert sum(words in line for line in lines) == (words == "interval of the sampling alone")
    assert sum(line.startswith("variance of the log probability") for line in detailed) == 1
    assert lines[0].startswith("NOT CONVERGED (replicate 1): ")
    assert [line.split()[0] for line in lines[1:5]] == ["crash", "converged", "crash", "not"]
    assert lines[3].split("  ")[-1].strip() == "not known from these runs"
