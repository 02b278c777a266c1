"""The sampler as a method of the study: the same numbers, one kind of error, and its sentences."""

import math
from dataclasses import replace

import numpy as np
import pytest
from accelerated_evaluation import CUT_IN, InputError, Problem, load_vehicle
from accelerated_evaluation.methods import METHODS, Estimate
from accelerated_evaluation.methods.surrogate import (
    Surrogate,
    assumption_in_words,
    chance_in_words,
    checks_in_words,
    configured_sampler,
    rules_for,
    unseen_in_words,
    weights_in_words,
)
from accelerated_evaluation.scenarios.left_turn import LEFT_TURN
from fewruns import Predecessor, Sampler, Stopping, SystemProblem, run_batches
from fewruns.constants import ENOUGH_DRAWS
from normal_law import left_turn_law
from test_methods import LAW, Corner

GOAL = Stopping(minimum_events=1, maximum_simulations=1000)
HALF_PLANE = SystemProblem(lambda z: (z[:, 0] > 4, 4 - z[:, 0]), 2, fingerprint="half", deterministic=True)


def test_the_method_is_registered_and_gives_the_numbers_of_the_sampler():
    method = METHODS["surrogate"].configured({"surrogate": {"batch_size": 10}})
    assert method == Surrogate(batch_size=10)
    found = [method.estimate(HALF_PLANE, GOAL, np.random.default_rng(seed)) for seed in (0, 1)]
    sampler = Sampler(2, np.random.default_rng(0), 10, deterministic=True)
    for _ in run_batches(sampler, HALF_PLANE, GOAL):
        pass
    assert found[0].row() == sampler.estimate(GOAL).row() != found[1].row()


def test_an_event_that_may_have_several_parts_has_a_strict_certificate():
    crash = LEFT_TURN.events[0]
    problem = Problem(LEFT_TURN, load_vehicle("acc_aeb", LEFT_TURN), crash, law=left_turn_law())
    strict, usual = (
        configured_sampler(each, np.random.default_rng(0))
        for each in (problem, Problem(CUT_IN, Corner(), law=LAW))
    )
    assert strict.certificate == rules_for(LEFT_TURN, crash)["certificate"]
    assert (strict.certificate.share, strict.certificate.filled) == (3.0, crash.filled)
    assert (strict.frequent, usual.frequent) == (True, False)
    assert (
        usual.certificate
        == Sampler(2, np.random.default_rng(0), upper_set=True).certificate
        != strict.certificate
    )


def test_errors_of_the_sampler_become_errors_of_the_study(tmp_path):
    (tmp_path / "state.json").write_text("no state")
    no_event = Predecessor(np.zeros((3, 2)), np.zeros(3, bool))
    for method, message in (
        (Surrogate(state_file=tmp_path / "state.json"), "seen no state of a sampler"),
        (Surrogate(predecessor=no_event), "seen no event in its runs"),
    ):
        with pytest.raises(InputError, match=message):
            method.estimate(HALF_PLANE, GOAL, np.random.default_rng(1))


def test_a_vehicle_that_says_nothing_is_drawn_from_the_law_and_one_that_says_so_is_not():
    silent, said = Corner(), Corner()
    silent.deterministic, said.deterministic = None, True
    for vehicle, draws in ((silent, ENOUGH_DRAWS), (said, 0)):
        found = Surrogate().estimate(Problem(CUT_IN, vehicle, law=LAW), GOAL, np.random.default_rng(1))
        assert found.converged
        assert found.diagnostics["law_draws"] == draws


def test_sentences_name_the_weights_and_what_the_runs_cannot_exclude():
    assert "as informative as 23.4 events" in weights_in_words({"effective_events": 23.44})
    bounds = {"unseen_mode": 0.002, "unseen_any": 0.9}
    words = unseen_in_words(1e-3, bounds)
    assert "at most 0.002 if a half-space, 0.9 if of any shape" in words
    assert "these are 2 and 9e+02 times the estimate" in words
    assert "times" not in unseen_in_words(math.nan, bounds)
    known = {"repeats": 0, "differed": 0, "law_draws": 0, "law_events": 0, "counted": 0, "drift": 0}
    stated = [chance_in_words(known, each) for each in (True, False, None)]
    parts = ["stated to be deterministic", "stated to be random", "not stated"]
    assert [[part in words for part in parts] for words in stated] == np.eye(3, dtype=bool).tolist()
    assert assumption_in_words(known) == []
    known |= {"repeats": 200, "law_draws": 300, "law_events": 4}
    assert "more than 1.5% of the repeated runs" in chance_in_words(known, None)
    assert "counted by plain simulation" in chance_in_words(known | {"counted": 1}, None)
    assert "drift: " in chance_in_words(known | {"drift": 1}, None)
    known |= {"differed": 3, "unseen_lapses": 0.03}
    words = chance_in_words(known, None)
    assert "draws of the law itself: 300, of which 4 ended in the event" in words
    assert "rare lapses can add up to 0.03 (95% confidence, without any assumption" in words
    for absent in ("exclude", "counted", "drift"):
        assert absent not in words
    assert "at least 12,345 draws" in chance_in_words(known | {"settling_runs": 12_345.0}, None)


def test_the_answer_says_how_many_runs_were_checks_and_what_saves_them():
    known = {"repeats": 350, "differed": 0, "law_draws": 300, "counted": 0}
    found = Estimate(1e-5, 0, 2e-5, 0.2, 870, 0, 20, True, known)
    (line,) = checks_in_words(found)
    assert line.startswith("650 of the 870 simulations checked whether the vehicle is deterministic")
    assert "`vehicle: {deterministic: true}`" in line
    for other in ({"repeats": 0}, {"differed": 1}, {"counted": 1}):  # stated, or not deterministic
        assert checks_in_words(replace(found, diagnostics=known | other)) == []
