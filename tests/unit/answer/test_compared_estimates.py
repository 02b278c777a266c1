"""Two vehicles under the same draws: their ratio is far better known than the quotient of two intervals."""

from dataclasses import replace
from types import SimpleNamespace

import accelerated_evaluation as ae
import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import Posterior, SampledPosterior, compare
from accelerated_evaluation.answer.study_tables import UNDER_TEST
from accelerated_evaluation.answer.ways.by_few_runs import runs_to_begin_with
from accelerated_evaluation.answer.ways.comparison import (
    draws_table,
    posterior_of,
    vehicle_row,
    vehicle_table,
)
from accelerated_evaluation.answer.ways.posterior import answer_row
from scipy.stats import norm

SIZE = 3000
LAW = np.random.default_rng(1).normal(0, 0.6, SIZE)  # the same for both vehicles
MEMBER = np.random.default_rng(3).integers(0, 2, SIZE)
OWN = np.random.default_rng(2).normal(0, 0.1, SIZE)


def posterior(logs, error):
    return SampledPosterior(np.exp(logs), np.zeros(SIZE, int), np.full(SIZE, error), 1000)


def test_the_ratio_has_the_error_of_both_samplings_and_not_that_of_the_law():
    found = compare(posterior(LAW + OWN - 0.2, 0.1), posterior(LAW, 0.05))
    deviation = np.sqrt(0.1**2 + 0.1**2 + 0.05**2)
    width = np.log(found["ratio_high80"] / found["ratio_low80"])
    assert np.log(found["ratio"]) == pytest.approx(-0.2, abs=0.02)
    assert width == pytest.approx(2 * norm.isf(0.1) * deviation, rel=0.06)
    assert found["safer"] == pytest.approx(norm.cdf(0.2 / deviation), abs=0.02)
    unpaired = compare(posterior(LAW + OWN - 0.2, 0.1), posterior(LAW[::-1], 0.05))  # other draws: wrong
    assert np.log(unpaired["ratio_high80"] / unpaired["ratio_low80"]) > 3 * width


def test_lapses_that_no_run_has_shown_are_in_the_ratio():
    """With the bound 0.5 the first vehicle may crash more often than the second in every draw."""
    own, other = posterior(LAW - 5, 0.1), posterior(LAW - 3, 0.1)
    without = compare(own, other)
    found = compare(replace(own, unseen_lapses=0.5), other)
    assert without["safer"] > 0.999 > 0.1 > found["safer"]
    assert (found["ratio"], found["ratio_low80"]) == (without["ratio"], without["ratio_low80"])
    expected = np.quantile((own.probabilities + 0.5) / other.probabilities, 0.9)
    assert found["ratio_high80"] == pytest.approx(expected, rel=0.05)
    turned = compare(other, replace(own, unseen_lapses=0.5))
    assert turned["ratio_low80"] == pytest.approx(1 / found["ratio_high80"], rel=0.01)
    assert turned["safer"] == pytest.approx(1 - without["safer"], abs=0.001)


def test_lapses_that_no_run_has_shown_are_in_the_table_of_a_slow_vehicle():
    own = posterior(LAW - 5, 0.1)
    human = Posterior(np.exp(LAW - 3), np.zeros(SIZE, int))
    without, found = (tabulated(each, human) for each in (own, replace(own, unseen_lapses=0.5)))
    pd.testing.assert_frame_equal(found.drop(index=UNDER_TEST), without.drop(index=UNDER_TEST))
    row, before = found.loc[UNDER_TEST], without.loc[UNDER_TEST]
    for name in ("high50", "high80", "high95"):
        assert row[name] == pytest.approx(before[name] + 0.5)
    for name in ("low80", "median", "ratio", "ratio_low80"):
        assert row[name] == before[name]
    assert before["safer"] > 0.999 > 0.1 > row["safer"]
    assert row["ratio_high80"] > 5 > before["ratio_high80"]


def tabulated(own, human):
    """Return the table of two vehicles, indexed by their names."""
    posteriors = {UNDER_TEST: own, "cc_human": human}
    answers = {k: SimpleNamespace(posterior=v, replayed=None, notes={}) for k, v in posteriors.items()}
    rows = pd.DataFrame([vehicle_row(name, answer) for name, answer in answers.items()])
    return vehicle_table(rows, posteriors, {"": "cc_human"}).set_index("vehicle")


@pytest.mark.parametrize("own", [None, np.full(SIZE, 0.02)])
def test_a_posterior_is_read_back_from_the_table_of_its_draws(own):
    """Studies compare vehicles by this table, and must get the ratios of the answer itself."""
    shared = np.nan if own is None else 0.08
    sampled = SampledPosterior(np.exp(LAW), MEMBER, np.full(SIZE, 0.1), 12, shared, own, 0.003)
    for known in (sampled, Posterior(np.exp(LAW), MEMBER)):
        names = tuple(np.array(["a", "b"])[MEMBER])
        drawn = SimpleNamespace(size=SIZE, names=names)
        table = draws_table(SimpleNamespace(posterior=known, draws=drawn, simulations=150))
        again = posterior_of(table)
        assert type(again) is type(known)
        assert again.member.tolist() == MEMBER.tolist()
        assert answer_row(again) == answer_row(known)
        assert compare(again, sampled) == compare(known, sampled)
    assert (
        posterior_of(draws_table(SimpleNamespace(posterior=None, draws=SimpleNamespace(size=0, names=()))))
        is None
    )


class Careful:
    """A vehicle that is safe in all encounters."""

    deterministic = True

    def __init__(self, vehicle):
        self.vehicle = vehicle

    def simulate(self, *columns):
        found = self.vehicle.simulate(*columns)
        return replace(found, crash=np.zeros_like(found.crash))


def test_the_ratio_to_an_earlier_version_is_that_of_many_simulations():
    """A version that brakes harder; its runs show where to begin, unless the vehicle is safe there."""
    old = {"name": "acc_aeb", "parameters": {"acc_limit": 1.0}}
    config = {"study": "new", "scenario": {"name": "left_turn"}, "compared_vehicles": {"old": old}}
    request = ae.Request(law="independent_variables", against="old", criteria=["1 x old"])
    found = ae.estimate(config, request)
    row, answer = found.compared().iloc[0], found.answers[0]
    law = answer.draws.proposal
    x, numbers = law.draw(400_000, np.random.default_rng(4)), answer.problem
    others = ae.load_vehicle("acc_aeb", "left_turn", acc_limit=1.0)
    flags = [numbers.event.happens(each.simulate(*x.T)) for each in (numbers.vehicle, others)]
    exact = flags[0].mean() / flags[1].mean()
    assert row["ratio_low80"] / 1.3 < exact < 1.3 * row["ratio_high80"]
    assert not row["ratio_low80"] / 1.3 < 1 / exact < 1.3 * row["ratio_high80"]  # the quotient, turned round
    assert [answer.converged, row["other_converged"]] == [True, True]
    assert found.tables["criteria"]["verdict"].iloc[0].startswith("met") == (exact < 1)
    assert f"{row['other_simulations']:,} simulations of old" in repr(found)
    other = found.references["old"]
    assert runs_to_begin_with(other, numbers).happened.sum() == other.tables["runs"]["event"].sum()
    assert runs_to_begin_with(other, replace(numbers, vehicle=Careful(numbers.vehicle))) is None
