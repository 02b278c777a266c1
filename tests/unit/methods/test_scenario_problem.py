"""Problems of any scenario: against an exact probability, by every method that needs only normal scores."""

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import CUT_IN, Box, Event, InputError, Problem, Stopping, write_law
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.normal_mixture import DEFENSIVE, NormalMixture
from accelerated_evaluation.methods.problem import read_law_of
from accelerated_evaluation.methods.study import with_encounters
from accelerated_evaluation.scenarios.left_turn import LEFT_TURN
from accelerated_evaluation.scenarios.pedestrian import PEDESTRIAN
from accelerated_evaluation.study.configuration import load
from law_folder import LAW as CUT_INS
from normal_law import left_turn_law, normal_law
from scipy.stats import binom, truncnorm

LIMIT = 15.5  # m/s, the turning speed from which on the toy crashes


class Fast:
    """Crashes where the turning car is faster than LIMIT."""

    deterministic = True

    def simulate(self, speed, turning_speed, distance):
        columns = {name: np.maximum(LIMIT - turning_speed, 0) for name in LEFT_TURN.outcome_names}
        flags = {"crash": turning_speed >= LIMIT, "ended": np.ones(len(speed), bool)}
        return LEFT_TURN.outcome_type(**columns | flags)


PROBLEM = Problem(LEFT_TURN, Fast(), law=left_turn_law())
EXACT = truncnorm((0 - 7) / 3, (60 - 7) / 3, 7, 3).sf(LIMIT)  # turning speeds of the law
METHODS_OF_SCORES = ("crude", "normal_mixture", "surrogate")


def intervals(name, problem=PROBLEM, runs=8):
    method, stopping = (
        METHODS[name].configured(load()),
        # Half as precise, crude Monte Carlo needs a quarter of the simulations.
        Stopping(minimum_events=1, maximum_simulations=100_000, beta=0.4 if name == "crude" else 0.2),
    )
    return [method.estimate(problem, stopping, np.random.default_rng((7, k))) for k in range(runs)]


@pytest.mark.parametrize("name", METHODS_OF_SCORES)
def test_methods_of_normal_scores_cover_the_exact_probability(name):
    found = intervals(name)
    assert all(estimate.converged for estimate in found)
    needed = binom.ppf(1e-3, len(found), 0.8)
    assert sum(estimate.covers(EXACT) for estimate in found) >= needed
    wrong = 3 if name == "crude" else 2  # its intervals are twice as wide
    assert sum(estimate.covers(wrong * EXACT) for estimate in found) < needed


def test_a_mixture_without_the_right_ratio_misses_the_probability(monkeypatch):
    def wrong(self, z):
        return right(self, z) + np.log(2)

    right = NormalMixture.log_ratio
    monkeypatch.setattr(NormalMixture, "log_ratio", wrong)
    found = intervals("normal_mixture")
    assert sum(estimate.covers(EXACT) for estimate in found) < binom.ppf(1e-3, len(found), 0.8)


def test_the_ratios_of_a_mixture_have_a_bound_and_the_mean_one():
    generator = np.random.default_rng(3)
    points = generator.normal((1, 2), 0.3, (200, 2))
    mixture = NormalMixture.fitted(points, np.ones(200), generator)
    ratio = np.exp(mixture.log_ratio(mixture.sample(100_000, generator)))
    assert ratio.max() <= (1 + 1e-12) / DEFENSIVE
    assert abs(ratio.mean() - 1) < 4 * ratio.std() / np.sqrt(len(ratio))


def test_the_mixture_needs_fewer_simulations_than_crude_monte_carlo():
    stopping = Stopping(minimum_events=1, maximum_simulations=1_000_000)
    needed = {
        name: METHODS[name]().estimate(PROBLEM, stopping, np.random.default_rng(1)).simulations
        for name in ("crude", "normal_mixture")
    }
    assert needed["normal_mixture"] < needed["crude"] / 3


def test_runs_are_listed_by_the_variables_of_the_scenario():
    method = METHODS["surrogate"].configured(load())
    found = method.estimate(PROBLEM, Stopping(minimum_events=1), np.random.default_rng(1))
    runs = with_encounters(pd.DataFrame(found.tables["runs"]), PROBLEM)
    z = runs[[f"z_{name}" for name in LEFT_TURN.names]].to_numpy()
    assert runs[list(LEFT_TURN.names)].to_numpy() == pytest.approx(PROBLEM.law.from_normal_scores(z))
    assert ((runs["turning_speed_mps"] >= LIMIT) == runs["event"]).all()


BEYOND = left_turn_law(upper=[99, 60, 150])
OTHER = normal_law((14, 7, 60), np.eye(3), Box(("a", "b", "c"), (0, 0, 0), (30, 60, 150)))


@pytest.mark.parametrize(
    ("scenario", "law", "message"),
    [
        (
            LEFT_TURN,
            BEYOND,
            "sdv_speed_mps from 0 to 99, .*expected limits within sdv_speed_mps from 0 to 35",
        ),
        (LEFT_TURN, OTHER, "left_turn: seen a from 0 to 30"),
        (LEFT_TURN, CUT_INS, "left_turn: seen lead_speed from 0 to inf, range from 0 to 75"),
        (CUT_IN, left_turn_law(), "cut_in: seen sdv_speed_mps from 0 to 35"),
        (PEDESTRIAN, left_turn_law(), "pedestrian: seen sdv_speed_mps from 0 to 35"),
    ],
)
def test_a_law_beyond_the_limits_or_of_another_scenario_is_refused(scenario, law, message, tmp_path):
    with pytest.raises(InputError, match=message):
        Problem(scenario, Fast(), law=law)
    with pytest.raises(
        InputError, match=r"seen an event scored by 'gap'; expected an outcome of .*: crash, "
    ):
        Problem(scenario, Fast(), Event.flag("crash", scored_by="gap"))
    if law is not CUT_INS:
        write_law(tmp_path / "law.json", law)
        with pytest.raises(InputError, match=message):
            read_law_of(scenario, tmp_path / "law.json")
