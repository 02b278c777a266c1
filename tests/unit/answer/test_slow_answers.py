"""Answers from few runs of a slow vehicle: runs that fail, and batches that are pending together."""

import threading
from concurrent.futures import Executor, Future
from pathlib import Path
from types import SimpleNamespace

import accelerated_evaluation as ae
import numpy as np
import pytest
from accelerated_evaluation.answer.ways.by_few_runs import Runs
from accelerated_evaluation.answer.ways.posterior import answer_row
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.vehicles.external.slow import SlowVehicle
from accelerated_evaluation.vehicles.external.store import Store
from accelerated_evaluation.vehicles.external.workers import Workers
from fewruns import Sampler, SeveralLaws, Stopping, run_batches
from scipy.stats import norm

SCENARIO = SCENARIOS["left_turn"]
CAR = """
import numpy as np
from accelerated_evaluation import load_vehicle


class Car:
    def __init__(self, fails="never"):
        self.fails, self.car = fails, load_vehicle("acc_aeb", "left_turn")
        self.generator = np.random.default_rng(3)

    def simulate(self, *columns):
        lost = self.generator.random(len(columns[0])) if self.fails == "at random" else columns[1] * 50 % 1
        if (lost < {"never": 0.0, "at random": 0.04, "by place": 0.02}[self.fails]).any():
            raise RuntimeError("no licence")
        return self.car.simulate(*columns)
"""


class Shuffled(Executor):
    """Workers whose runs end in another order for each seed."""

    def __init__(self, seed):
        self.generator = np.random.default_rng(seed)

    def submit(self, function, *arguments):
        future, seconds = Future(), 0.02 * self.generator.random()
        try:
            result = function(*arguments)
        except Exception as error:
            threading.Timer(seconds, future.set_exception, [error]).start()
        else:
            threading.Timer(seconds, future.set_result, [result]).start()
        return future


@pytest.fixture(scope="module")
def draws():
    return ae.choose_draws("independent_variables", ae.read_records("left_turn"))


@pytest.fixture
def answered(draws, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("car.py").write_text(CAR)

    def answered(seed, fails="never", pending=1, generator=1):
        executor, store = Shuffled(seed), Store(f"{seed} {fails}.sqlite", SCENARIO)
        given = "car.py:Car", {"fails": fails}, "car", store, Workers(executor, executor, 6)
        car = SlowVehicle(*given, retries=0, scenario=SCENARIO, deterministic=True, sets_aside=True)
        return ae.evaluate(ae.Problem(SCENARIO, car), draws, ae.FewRuns(pending=pending), generator=generator)

    return answered


def test_pending_batches_give_the_same_whatever_run_ends_first(answered):
    first, second = answered(1, pending=12), answered(2, pending=12)
    assert first.tables["runs"].equals(second.tables["runs"])
    assert first.posterior.probabilities.tolist() == second.posterior.probabilities.tolist()
    assert first.simulations > answered(1).simulations  # they were designed with fewer outcomes


@pytest.mark.parametrize(("fails", "pending", "seeds"), [("at random", 1, [2]), ("by place", 12, [1, 3, 7])])
def test_failed_runs_are_counted_and_bounded(answered, draws, fails, pending, seeds):
    """The exact answer is that of 200,000 runs; with crashes of all failed runs, at most 4 % are added.

    A failed run far from the other events may add so much that an estimate does not converge.
    """
    exact = ae.evaluate(ae.Problem(SCENARIO, "acc_aeb"), draws, ae.Simulations(200_000), generator=1)
    all_found = [answered(1, fails, pending, generator=seed) for seed in seeds]
    assert np.mean([found.converged for found in all_found]) > 0.6
    bounds = 0.0
    for found in all_found:
        (failed, added), row = found.notes["failed"], answer_row(found.posterior)
        assert failed == (found.tables["runs"]["phase"] == "failed").sum() > 0
        assert found.posterior.unseen_lapses == pytest.approx(added)
        assert row["low95"] < exact.posterior.probability < row["high95"] - added
        without = answer_row(found.posterior.__class__(**{**vars(found.posterior), "unseen_lapses": 0.0}))
        assert row["high80"] == pytest.approx(without["high80"] + added)
        bounds += added
    assert bounds > 0


def test_failed_runs_are_bounded_under_each_draw():
    """Under draw k the crash x > 4 has the probability Phi(m_k - 4), and a fifth of the crashes fail."""
    means = np.array([-0.6, 0.0, 0.6])

    def simulate(z, again=False):
        last = np.where((z[:, 0] > 4) & (np.abs(z[:, 1]) < norm.isf(0.4)), np.nan, 4 - z[:, 0])
        return ae.Outcomes(last <= 0, last, last, last)

    event = SimpleNamespace(happens=lambda found: found.crash, score=lambda found: found.min_range)
    law = SimpleNamespace(from_normal_scores=lambda z: z)
    problem = SimpleNamespace(simulate=simulate, law=law, event=event, graded=True)
    laws = SeveralLaws(lambda z: np.outer(means, z[:, 0]) - means[:, None] ** 2 / 2)
    sampler = Sampler(2, np.random.default_rng(1), deterministic=True)
    runs = Runs(problem, SimpleNamespace(size=3, member=np.zeros(3, int)), sampler, laws)
    list(run_batches(sampler, runs, Stopping(maximum_simulations=250), lambda: False))
    found, exact = runs.refined(), norm.sf(4 - means)
    assert found.probabilities == pytest.approx(0.8 * exact, rel=0.25)
    assert found.unseen_lapses == pytest.approx(0.2 * exact, rel=0.5)
    # The upper end of a draw contains the answer if all failed runs are crashes.
    assert found.probabilities + found.unseen_lapses == pytest.approx(exact, rel=0.25)
