"""Replays of records: how often the event happened there, and what that says about an estimate."""

import random
from dataclasses import fields, replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import CUT_IN, Answer, FewRuns, Posterior, Problem, as_draws, load_vehicle
from accelerated_evaluation.answer.ways import evidence as evidence_module
from accelerated_evaluation.answer.ways.evidence import (
    Evidence,
    checked_answers,
    evidence_on,
    known_runs,
    replays_of,
)
from accelerated_evaluation.answer.ways.replays import CONFIDENCE, FOLLOWED, LEVEL, SIZES, replay
from accelerated_evaluation.methods.problem import normal_scores
from accelerated_evaluation.scenarios.left_turn import LEFT_TURN
from accelerated_evaluation.vehicles import Outcomes
from accelerated_evaluation.vehicles.external.watched import WatchedVehicle
from accelerated_evaluation.vehicles.protocol import CRASH
from fewruns.problems import Predecessor
from law_folder import LAW
from normal_law import left_turn_law
from scipy.stats import binom, poisson

SIZE = 20_000


def records(generator, size=SIZE):
    """Return uniform points in a cube, shape (3, size); the first coordinate is how near they are."""
    return generator.uniform(size=(3, size))


def replayed(happens, seed=1, *, is_slow=True):
    generator = np.random.default_rng(seed)
    x = records(generator)
    return replay(happens, x, x[0], generator, is_slow=is_slow)


def test_a_slow_vehicle_replays_a_sample_of_each_stratum():
    found = replayed(lambda x: np.zeros(x.shape[1], bool))
    assert found.records.tolist() == [20, 180, 1800, 18_000]
    assert found.sampled.tolist() == [*SIZES]
    few = np.random.default_rng(2).uniform(size=(3, 1000))
    small = replay(lambda x: x[0] < 0.01, few, few[0], np.random.default_rng(3), is_slow=True)
    assert small.sampled.tolist() == [1, 9, 40, 50]  # a small stratum leaves its share to the last one
    nearness = found.encounters[0]
    ends = np.split(nearness, np.cumsum(SIZES)[:-1])
    assert all(nearer.max() < farther.min() for nearer, farther in pairwise(ends))
    assert (found.happened, found.replayed, found.p_value(1e-6)) == (0, sum(SIZES), 1.0)


def test_the_replayed_records_are_compared_with_what_the_estimate_allows_among_them():
    """All events may lie in the stratum of which most was replayed, here a tenth of 200 records."""
    few = replayed(lambda x: np.zeros(x.shape[1], bool))
    sample = replace(few, records=np.array([200, 19_800]), sampled=np.array([20, 80]))
    generator, size = np.random.default_rng(5), 40_000
    fault = generator.hypergeometric(20, 180, 20, size)  # 20 events, a probability of 0.001, in the first
    assert sample.allowed(1e-3) == pytest.approx(2.0)
    assert fault.mean() == pytest.approx(sample.allowed(1e-3), abs=4 * fault.std() / size**0.5)
    said = Evidence("crash", 1e-3, sample, None).in_words
    assert "replayed 100 of 20,000 distinct records, and 0 ended with crash" in said
    assert said.endswith("the estimate allows at most 2 among them")
    every = replace(sample, sampled=sample.records, replayed=20_000)
    assert "all 20,000 distinct records" in Evidence("crash", 1e-3, every, None).in_words
    assert every.allowed(1e-3) == pytest.approx(20.0)


def test_a_fast_vehicle_replays_all_records_and_guides_with_the_same_sample():
    fault = lambda x: (x[1] > 0.5) & (x[1] < 0.51)  # noqa: E731
    slow, fast = replayed(fault), replayed(fault, is_slow=False)
    np.testing.assert_array_equal(slow.encounters, fast.encounters)
    np.testing.assert_array_equal(slow.flags, fast.flags)
    assert fast.replayed == SIZE
    assert fast.happened == fault(records(np.random.default_rng(1))).sum()
    assert fast.p_value(1e-3) == pytest.approx(2 * poisson.sf(fast.happened - 1, 1e-3 * SIZE))


def test_records_similar_to_events_are_replayed_too():
    fault = lambda x: (np.abs(x - 0.02) < [[0.02], [0.2], [0.2]]).all(axis=0)  # noqa: E731
    found = replayed(fault)
    assert found.events.sum() > 0
    assert sum(SIZES) < found.replayed <= sum(SIZES) + FOLLOWED
    others = found.flags[sum(SIZES) :]
    assert others.mean() > 3 * found.events.sum() / sum(SIZES)
    assert len(np.unique(found.encounters.T, axis=0)) == found.replayed


def test_the_p_value_is_that_of_the_most_surprising_stratum_or_of_all_events():
    found = replayed(lambda x: (x[0] > 0.01) & (x[1] < 0.1))
    upper = 1e-5
    most = upper * SIZE
    strata = [
        binom.sf(k - 1, n, min(most / size, 1))
        for k, n, size in zip(found.events, found.sampled, found.records, strict=True)
    ]
    expected = 5 * min(*strata, poisson.sf(found.happened - 1, most))
    assert found.p_value(upper) == pytest.approx(min(expected, 1))
    assert found.p_value(0.5) == 1


@pytest.mark.parametrize("is_slow", [False, True])
def test_too_few_events_contradict_an_answer_that_is_too_high(is_slow):
    """By the binomial distribution of the records, or of the stratum that was sampled least."""
    found = replayed(lambda x: x[0] < 1e-4, is_slow=is_slow)
    events, sampled = (found.events[-1], found.sampled[-1]) if is_slow else (found.happened, SIZE)
    for lower in (1e-5, 1e-3, 0.2):
        inside = min(lower * SIZE / found.records[-1], 1)
        tests = len(found.records) + 2
        assert found.p_value(1.0, lower) == pytest.approx(min(tests * binom.cdf(events, sampled, inside), 1))
    assert found.p_value(1.0, 0.2) < LEVEL < found.p_value(1.0, 2e-4 if is_slow else 1e-5)
    (doubt,) = Evidence("crash", 1.0, found, None, lower=0.2).doubts
    assert "expected at least 4e+03 in all 20,000 records" in doubt


@pytest.mark.parametrize("where", ["everywhere", "far", "near"])
def test_the_share_that_replays_can_have_missed_covers_the_true_one(where):
    """The events are anywhere, or only among the records that are farthest from or nearest to the event."""
    fault = {
        "everywhere": lambda x: x[1] < 0.01,
        "far": lambda x: (x[0] > 0.1) & (x[1] < 0.02),
        "near": lambda x: x[0] < 0.005,
    }[where]
    covered, shares = [], []
    for seed in range(200):
        found = replayed(fault, seed)
        truth = fault(records(np.random.default_rng(seed))).mean()
        covered.append(found.share_at_most >= truth)
        shares.append(found.share_at_most)
    assert np.mean(covered) >= CONFIDENCE - 3 * np.sqrt(CONFIDENCE * (1 - CONFIDENCE) / 200)
    assert np.median(shares) < 0.2  # it is not covered by being useless


def test_the_share_that_replays_can_have_missed_is_exact():
    none = replayed(lambda x: np.zeros(x.shape[1], bool))
    level = (1 - CONFIDENCE) / 4
    limits = [1 - level ** (1 / size) for size in SIZES]  # the probability of no event in so many replays
    assert none.share_at_most == pytest.approx(np.average(limits, weights=none.records))
    fault = lambda x: x[1] < 0.01  # noqa: E731
    everything = replayed(fault, is_slow=False)
    assert everything.share_at_most == everything.happened / SIZE
    everywhere = replayed(lambda x: np.ones(x.shape[1], bool))
    assert everywhere.share_at_most == 1


class Lapses:
    """A car that crashes by a lapse in a small share of all encounters, and says that it is deterministic."""

    deterministic = True
    share = 7e-4

    def __init__(self, kind):
        self.kind, self.generator = kind, np.random.default_rng(9)

    def simulate(self, *columns):
        sizes = len(columns[0])
        if self.kind == "by chance":
            lapse = self.generator.random(sizes)
        elif self.kind == "seeded in each run":
            lapse = np.random.default_rng(sizes).random(sizes)
        else:  # by a hash of the inputs
            rows = np.column_stack(columns).tolist()
            lapse = np.array([random.Random(str(row)).random() for row in rows])
        found = never(CUT_IN, columns)
        return replace(found, crash=lapse < self.share, impact_speed=np.where(lapse < self.share, 1.0, 0.0))


@pytest.mark.parametrize("kind", ["by chance", "seeded in each run", "by a hash of the inputs"])
def test_an_answer_for_a_vehicle_with_rare_lapses_says_what_the_replays_can_have_missed(monkeypatch, kind):
    x = cut_ins()
    monkeypatch.setattr(evidence_module, "SlowVehicle", Lapses)
    vehicle = WatchedVehicle(Lapses(kind), CUT_IN)
    found = evidence_on(vehicle, replays_of(vehicle, x, CRASH, np.random.default_rng(1)), CRASH, upper=1e-5)
    share = found.replays.share_at_most
    assert share > Lapses.share
    text = found.unseen(6e-6)
    assert f"could have missed crash in a share of up to {share:.2g} of the records" in text
    assert f"{float(f'{share / 6e-6:.2g}'):,g} times the answer" in text
    assert "times the answer" not in found.unseen(np.nan)
    monkeypatch.setattr(evidence_module, "SlowVehicle", Blind)  # a fast vehicle replays all records
    replays = replays_of(vehicle, x, CRASH, np.random.default_rng(1))
    assert evidence_on(vehicle, replays, CRASH, upper=1e-5).unseen(6e-6) is None


@pytest.mark.parametrize("probability", [1e-4, 1e-2])
def test_a_right_estimate_is_rarely_contradicted(probability):
    """The event is where it is most surprising: in the stratum with the largest share of replays."""
    probabilities = []
    for seed in range(200):
        found = replayed(lambda x: x[0] < probability, seed)
        probabilities.append(found.p_value(probability))
        assert found.p_value(probability / 100) <= found.p_value(probability)
    assert np.mean(np.array(probabilities) < LEVEL) <= LEVEL + 3 * np.sqrt(LEVEL / 200)


class Blind:
    """A car that does not react below a closing speed; the default car crashes in no record."""

    deterministic = True

    def __init__(self, limit):
        self.limit = limit

    def simulate(self, lead_speed, range_, closing_speed):
        crash = (closing_speed < self.limit) & (range_ < 8 * closing_speed)
        return Outcomes(
            crash,
            np.where(crash, 0.0, range_),
            np.where(crash, range_ / np.maximum(closing_speed, 1e-9), 20.0),
            np.where(crash, closing_speed, 0.0),
        )


def cut_ins(size=20_000):
    """Return records of a made-up law, shape (size, 3), in which about 1 % close slowly and soon."""
    return LAW.from_normal_scores(np.random.default_rng(2).standard_normal((size, 3)))


@pytest.mark.parametrize("limit", [4.0, 3.25])
@pytest.mark.parametrize("is_slow", [False, True])
def test_a_fault_that_the_records_show_contradicts_an_estimate_that_missed_it(monkeypatch, limit, is_slow):
    x, car = cut_ins(), Blind(limit)
    if is_slow:
        monkeypatch.setattr(evidence_module, "SlowVehicle", Blind)
    vehicle = WatchedVehicle(car, CUT_IN)
    replays = replays_of(vehicle, x, CRASH, np.random.default_rng(1))
    share = car.simulate(*x.T).crash.mean()
    assert 1e-3 < share < 0.1
    assert (replays.replayed == len(x)) is not is_slow
    missed = evidence_on(vehicle, replays, CRASH, upper=share / 400)
    (doubt,) = missed.doubts
    assert "the records contradict the estimate" in doubt
    assert f"crash in {replays.happened:,} of {replays.replayed:,} replayed records" in doubt
    tables = missed.added_to(
        {"estimate": pd.DataFrame({"converged": [True]}), "runs": pd.DataFrame({"a": [1]})}
    )
    assert not tables["estimate"]["converged"].any()
    assert tables["replays"]["p_value"].iloc[-1] < LEVEL
    right = evidence_on(vehicle, replays, CRASH, upper=2 * share)
    assert right.doubts == []
    assert f"{replays.events.sum():,} ended with crash" in right.in_words
    assert right.added_to({"estimate": pd.DataFrame({"converged": [True]})})["estimate"]["converged"].all()


def test_a_difference_in_another_process_is_a_doubt():
    replays = replayed(lambda x: np.zeros(x.shape[1], bool))
    found = Evidence("crash", 1e-6, replays, "the vehicle differed")
    assert found.doubts == ["the vehicle differed"]
    assert not found.added_to({"answer": pd.DataFrame({"converged": [True]})})["answer"]["converged"].any()


@pytest.mark.parametrize("name", ["cut-ins", "left turns"])
def test_normal_scores_are_the_inverse_of_the_map_of_a_law(name):
    z = np.random.default_rng(3).standard_normal((50, 3))
    points = {"cut-ins": LAW, "left turns": left_turn_law()}[name].from_normal_scores
    x = points(z)
    found, is_found = normal_scores(points, x)
    assert is_found.all()
    np.testing.assert_allclose(points(found), x, rtol=1e-6)
    continuous = slice(1 if name == "cut-ins" else 0, None)  # the lead speed is drawn from recorded values
    np.testing.assert_allclose(found[:, continuous], z[:, continuous], atol=1e-4)
    assert not normal_scores(points, x + 1000)[1].any()


def test_replays_with_events_guide_the_sampler_and_others_do_not():
    points = left_turn_law().from_normal_scores
    x = points(np.random.default_rng(4).standard_normal((1_000, 3)))
    vehicle = WatchedVehicle(load_vehicle("acc_aeb", LEFT_TURN), LEFT_TURN)
    replays = replays_of(vehicle, x, LEFT_TURN.events[0], np.random.default_rng(1))
    known = known_runs(replays, points)
    assert replays.flags.any()
    np.testing.assert_allclose(points(known.z), replays.encounters.T, rtol=1e-6)
    np.testing.assert_array_equal(known.happened, replays.flags)
    assert known_runs(replayed(lambda x: np.zeros(x.shape[1], bool)), points) is None


def in_a_band(car, scenario, name, low, high, outcomes):
    """Return a car that also crashes in a thin band of one variable, to which no outcome leads."""
    place = scenario.names.index(name)

    def simulate(*columns):
        found = car.simulate(*columns)
        fails = (columns[place] > low) & (columns[place] < high)
        made = {key: np.where(fails, value, getattr(found, key)) for key, value in outcomes.items()}
        return replace(found, crash=found.crash | fails, **made)

    return SimpleNamespace(simulate=simulate, deterministic=True)


BANDS = {
    "left_turn": (LEFT_TURN, left_turn_law(), ("turning_speed_mps", 7.0, 7.1), {"clearance": -0.1}),
    "cut_in": (CUT_IN, LAW, ("closing_speed", 0.5, 0.51), {"min_range": 0.0, "impact_speed": 0.5}),
}


@pytest.mark.parametrize("name", BANDS)
def test_no_answer_that_the_records_contradict_has_converged(name, monkeypatch):
    """The sampler has found all events but those in a thin band, and says that it has converged."""
    scenario, law, band, outcomes = BANDS[name]
    x = law.from_normal_scores(np.random.default_rng(5).standard_normal((2000, 3)))
    sound = SimpleNamespace(simulate=lambda *columns: never(scenario, columns), deterministic=True)
    small = Posterior(np.array([1e-5]), np.zeros(1, int))

    def claimed(problem, draws, *_, **__):
        return Answer(problem, draws, {problem.event: small})

    monkeypatch.setattr(evidence_module, "evaluate", claimed)

    def checked(car):
        problem = Problem(scenario, car, scenario.events[0], law=law)
        streams = lambda name: np.random.default_rng(6)  # noqa: E731
        (answer,), found = checked_answers(
            problem, as_draws(law), SimpleNamespace(x=x), FewRuns(), (), streams
        )
        return answer.converged, found

    faulty = in_a_band(sound, scenario, *band, outcomes)
    converged, found = checked(faulty)
    assert not converged
    inside = x[:, scenario.names.index(band[0])]
    assert len(found.crashed) == np.count_nonzero((inside > band[1]) & (inside < band[2])) > 0
    assert found.crashed[band[0]].between(*band[1:]).all()
    assert scenario.described(found.crashed.iloc[0]) in found.doubts[0]
    assert checked(sound)[0]
    # Without the records in the band, nothing contradicts the answer.
    x = x[~((inside > band[1]) & (inside < band[2]))]
    assert checked(faulty)[0]


def never(scenario, columns):
    """Return the outcomes of encounters without a crash."""
    n = len(columns[0])
    flags = {"crash": np.zeros(n, bool), "ended": np.ones(n, bool)}
    names = [each.name for each in fields(scenario.outcome_type)]
    return scenario.outcome_type(**{each: flags.get(each, np.full(n, 5.0)) for each in names})


def test_replays_guide_the_sampler_in_addition_to_a_predecessor():
    points = left_turn_law().from_normal_scores
    x = points(np.random.default_rng(7).standard_normal((500, 3)))
    replays = replay(lambda x: x[1] > np.median(x[1]), x.T, x[:, 0], np.random.default_rng(8), is_slow=True)
    other = Predecessor(np.zeros((2, 3)), np.array([True, False]))
    found = known_runs(replays, points, other)
    np.testing.assert_array_equal(found.z[:2], other.z)
    assert found.happened.tolist() == [True, False, *replays.flags]
    assert known_runs(replayed(lambda x: np.zeros(x.shape[1], bool)), points, other) is other


@pytest.mark.parametrize(("ends", "upper"), [((0.1, None, 0.2), 0.2), ((None,), 1.0)])
def test_the_replays_are_compared_with_the_largest_known_end_of_the_replicates(monkeypatch, ends, upper):
    """A replicate that has met no event says nothing, and must not hide what contradicts the others."""
    problem, known = Problem(CUT_IN, Blind(4.0), law=LAW), iter(ends)

    def answered(problem, draws, *_, **__):
        end = next(known)
        posterior = None if end is None else Posterior(np.array([end]), np.zeros(1, int))
        return Answer(problem, draws, {problem.event: posterior})

    monkeypatch.setattr(evidence_module, "evaluate", answered)
    replicates = len(ends)
    streams = lambda name: np.random.default_rng(1)  # noqa: E731
    records = SimpleNamespace(x=cut_ins(2000))
    answers, found = checked_answers(problem, as_draws(LAW), records, FewRuns(), (), streams, replicates)
    assert len(answers) == replicates
    assert found.upper == upper
