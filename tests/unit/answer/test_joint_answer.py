"""The answer under joint laws: blocks, scores and weights, and posteriors from many runs and from few."""

from dataclasses import dataclass, replace

import accelerated_evaluation as ae
import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.answer.candidates.joint_family import (
    NEAR,
    Candidate,
    ClusteredRecords,
    JointFamily,
)
from accelerated_evaluation.answer.ways.by_few_runs import GOAL
from accelerated_evaluation.answer.ways.comparison import draws_table
from accelerated_evaluation.answer.ways.posterior import answer_row, count_limits
from accelerated_evaluation.answer.ways.replays import LEVEL, replay
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.scenarios.outcomes import FLAG, outcome
from normal_law import normal_law
from scipy.stats import truncnorm

BOX = ae.Box(("a_mps", "b_m"), (0.0, 0.0), (10.0, 10.0))
CANDIDATES = (
    Candidate("one normal", ae.LAWS["truncated_normals"], {"components": 1}),
    Candidate("independent", ae.LAWS["independent_variables"], {}),
)
LIMIT = 7.5  # of a, above which the toy crashes


@dataclass(frozen=True)
class Outcomes:
    crash: Array = outcome(FLAG, "whether there is a crash")
    distance: Array = outcome("", "distance to the crash, which is the score")


TOY = ae.Scenario(
    "toy",
    "Two variables, and a crash that is a function of them.",
    [ae.Variable(name, "", 0, 10, "") for name in BOX.names],
    Outcomes,
    [ae.Event.flag("crash", scored_by="distance")],
    {},
    "none",
)


@dataclass
class Car:
    respond: object
    deterministic: bool | None = True

    def simulate(self, a, b):
        return Outcomes(*self.respond(np.column_stack([a, b])))


def toy_law(mean=(4.0, 5.0), correlation=0.0, box=BOX):
    covariance = np.array([[4.0, 4 * correlation], [4 * correlation, 4.0]])
    return normal_law(mean, covariance, box)


def respond(x):
    """Crash above LIMIT of a; the score is the distance to it."""
    return x[:, 0] > LIMIT, LIMIT - x[:, 0]


def exact(law):
    """Return the probability of the toy's crash under an uncorrelated law of one component."""
    mean = law.normals.mean[0, 0]
    return truncnorm((0 - mean) / 2, (10 - mean) / 2, mean, 2).sf(LIMIT)


def answered(drawn, way, generator, respond=respond, deterministic=True):
    """Return the answer for a car that responds by a function of points."""
    problem = ae.Problem(TOY, Car(respond, deterministic), law=drawn.proposal)
    return ae.evaluate(problem, drawn, way, generator=generator)


def drawn_laws(*laws):
    return ae.DrawnLaws.of(laws, ["toy"] * len(laws), np.random.default_rng(25))


def drawn_from(family, generator, size):
    """Return draws of the only candidate, or of all with the weights of the bootstrap."""
    return ae.LawStudy.of_family(family, size, generator).draws(generator)


def records(generator, clusters=60, each=5, law=None):
    law = toy_law(correlation=0.8) if law is None else law
    x = law.draw(clusters * each, generator)
    return ClusteredRecords.of(x, np.repeat(np.arange(clusters), each), BOX)


def test_blocks_hold_whole_clusters_of_about_equal_size():
    generator = np.random.default_rng(1)
    cluster = generator.choice(12, p=np.arange(1, 13) / 78, size=600)
    own = ClusteredRecords.of(np.full((600, 2), 5.0), cluster, BOX)
    block = own.blocks(4)
    assert all(len(np.unique(block[own.cluster == k])) == 1 for k in range(own.clusters))
    sizes = np.bincount(own.cluster)
    assert np.ptp(np.bincount(block)) < sizes.max() / 3


def test_weights_of_a_bootstrap_are_equal_within_a_cluster():
    own = records(np.random.default_rng(2))
    weights = own.resampled(np.random.default_rng(3)).reshape(60, 5)
    assert np.all(weights == weights[:, :1])
    assert len(np.unique(weights[:, 0])) == 60


@pytest.fixture(scope="module")
def family():
    return JointFamily.of(records(np.random.default_rng(4)), respond, np.random.default_rng(5), CANDIDATES)


def test_the_law_that_is_true_has_the_better_held_out_scores(family):
    weights = ae.LawStudy.of_family(family, 200, np.random.default_rng(6)).weights
    table = family.table(weights).set_index("law")
    assert weights.sum(axis=1) == pytest.approx(1)
    assert table.loc["one normal", "gain"] > 4 * table.loc["one normal", "gain_error"]
    assert table.loc["one normal", "weight"] > 0.95
    assert table.loc["one normal", "parameters"] == 5


def test_scores_near_the_event_are_censored(family):
    own = family.records
    near = own.x[:, 0] >= np.quantile(own.x[:, 0], 1 - NEAR)
    assert near.mean() == pytest.approx(NEAR, abs=2 / len(own.x))
    assert np.array_equal(family.near_scores[:, near], family.log_scores[:, near])
    # Elsewhere, the score is the log probability outside of the region, here by many draws of each law.
    block, limit = own.blocks(), np.quantile(own.x[:, 0], 1 - NEAR)
    out = (block == 0) & ~near
    held = CANDIDATES[0].fit(own.only(block != 0), np.random.default_rng(7), start=family.laws[0])
    share = np.mean(held.draw(400_000, np.random.default_rng(8))[:, 0] < limit)
    assert family.near_scores[0, out] == pytest.approx(np.log(share), abs=0.01)
    # The unit of the bootstrap is the cluster, with the sum of the scores of its records.
    assert family.scores[:, 3] == pytest.approx(family.near_scores[:, own.cluster == 3].sum(axis=1))
    assert family.scores.shape == (2, own.clusters) == (2, family.resampled.sum())


def test_both_ways_find_the_probability_under_each_draw():
    drawn = drawn_laws(*(toy_law(mean) for mean in [(3.5, 5.0), (4.0, 4.0), (4.5, 6.0)]))
    truth = np.array([exact(law) for law in drawn.laws])
    many = answered(drawn, ae.Simulations(60_000), np.random.default_rng(9))
    few = answered(
        drawn, ae.FewRuns(replace(GOAL, maximum_simulations=150), share=0.1), np.random.default_rng(10)
    )
    assert few.simulations <= 150
    for posterior in (many.posterior, few.posterior):
        deviation = np.abs(posterior.probabilities / truth - 1) / posterior.errors
        assert np.all(deviation < 4)
        # Without the ratios of densities, all draws would have the probability of their mean.
        assert np.any(np.abs(truth.mean() / truth - 1) > 4 * posterior.errors)
    assert many.posterior.deviation < 0.05


def test_the_interval_is_that_of_the_clusters():
    """Repeating each record within its cluster adds no information, and must not narrow the interval."""
    generator = np.random.default_rng(11)
    x = toy_law().draw(40, generator)
    once = ClusteredRecords.of(x, np.arange(40), BOX)
    repeated = ClusteredRecords.of(np.repeat(x, 8, axis=0), np.repeat(np.arange(40), 8), BOX)
    ignored = ClusteredRecords.of(repeated.x, np.arange(320), BOX)
    widths = []
    for own in (once, repeated, ignored):
        family = JointFamily.of(own, respond, np.random.default_rng(12), CANDIDATES[:1])
        drawn = drawn_from(family, np.random.default_rng(13), 30)
        found = answered(drawn, ae.Simulations(5_000), np.random.default_rng(14))
        widths.append(np.log(found.posterior.probabilities).std())
    assert widths[1] == pytest.approx(widths[0], rel=0.35)
    assert widths[2] < 0.55 * widths[0]  # the clusters ignored: narrower by about the root of 8


def test_the_answer_has_intervals_and_a_budget(family):
    drawn = drawn_from(family, np.random.default_rng(15), 40)
    found = answered(drawn, ae.Simulations(20_000), np.random.default_rng(16))
    row = found.table().iloc[0]
    ends = ["low95", "low80", "low50", "median", "high50", "high80", "high95"]
    assert row[ends].is_monotonic_increasing
    truth = exact(toy_law())  # up to the limits of b, which cut off little of the correlated law
    assert row["low95"] < truth < row["high95"]
    assert found.budget().set_index("source")["variance_share"]["together"] == 1
    assert len(draws_table(found)) == 40


def test_a_law_without_mass_at_the_event_ends_with_one_message():
    box = ae.Box(BOX.names, (0.0, 0.0), (7.0, 10.0))
    drawn = ae.DrawnLaws.of([toy_law(box=box)], ["bounded too low"], np.random.default_rng(25))
    with pytest.raises(ae.InputError, match=r"bounded too low.*no crash in 50,000 encounters.*limits"):
        answered(drawn, ae.Simulations(2_000), np.random.default_rng(18))


def test_a_rare_event_is_simulated_in_rounds():
    drawn = drawn_laws(toy_law())

    def probability(limit):
        beyond = lambda x: (x[:, 0] > limit, limit - x[:, 0])  # noqa: E731
        return answered(drawn, ae.Simulations(2_000), np.random.default_rng(19), beyond).posterior

    def limit(share):
        return truncnorm((BOX.lower[0] - 4) / 2, (BOX.upper[0] - 4) / 2, 4, 2).isf(share)

    rare = probability(limit(0.01))
    assert 6_000 <= rare.batches <= 14_000  # until there are 100 events
    assert rare.probabilities[0] == pytest.approx(0.01, abs=4 * rare.errors[0] * 0.01)
    assert 0.05 < rare.errors[0] < 0.11  # those of one round would be about 0.22
    assert probability(limit(0.2)).batches == 2_000


def test_records_of_one_cluster_are_refused():
    with pytest.raises(ae.InputError, match="at least 2 clusters"):
        ClusteredRecords.of(np.full((5, 2), 5.0), np.zeros(5), BOX)


@pytest.mark.parametrize(("deterministic", "rate"), [(False, 0.03), (None, 0.0)])
def test_frequent_lapses_are_found_and_counted_under_each_draw(deterministic, rate):
    drawn = drawn_laws(*(toy_law((mean, 5.0)) for mean in (3.0, 4.0, 5.0)))
    truth, chance = np.mean([exact(law) for law in drawn.laws]), np.random.default_rng(23)

    def lapsing(x):
        happened, score = respond(x)
        return happened | (chance.random(len(x)) < rate), score

    way = ae.FewRuns(share=10.0)  # so that the runs end early
    found = answered(drawn, way, np.random.default_rng(24), lapsing, deterministic)
    row, estimate = found.table().iloc[0], found.notes["estimate"]
    assert found.converged  # as exactly as a share of 10 requires
    assert estimate.diagnostics["counted"] == (rate > 0)
    assert found.posterior.unseen_lapses == 0
    assert row["low80"] < truth + rate < row["high80"]
    if rate:
        assert len(found.crashes.x) == estimate.events


def test_the_records_contradict_few_runs_that_miss_a_part():
    """The event has a frequent part without a score that leads to it, and a rare one with such a score.

    The frequent part is too thin for the certificate, which few runs meet although they have missed it.
    """

    def misleading(x):
        happened = (np.abs(x[:, 1] - 6.2) < 0.02) | (x[:, 0] > 9.9)
        return happened, 9.9 - x[:, 0]

    drawn, few = drawn_laws(toy_law()), ae.FewRuns(replace(GOAL, maximum_simulations=150))
    truth = answered(
        drawn, ae.Simulations(20_000), np.random.default_rng(22), misleading
    ).posterior.probability
    x = toy_law().draw(5_000, np.random.default_rng(26))
    replays = replay(
        lambda x: misleading(x.T)[0], x.T, 9.9 - x[:, 0], np.random.default_rng(27), is_slow=False
    )
    for seed in range(2):
        found = answered(drawn, few, np.random.default_rng(seed), misleading)
        assert found.posterior.probability < truth / 3
        assert truth < found.posterior.probability + found.notes["estimate"].diagnostics["unseen_any"]
        assert replays.p_value(found.table()["high95"][0]) < LEVEL
    assert replays.p_value(truth) > LEVEL


def test_an_event_that_did_not_happen_has_exact_limits():
    """With n independent simulations without the event, (1 - high)^n is the probability of the upper tail."""
    row = answer_row(None, count_limits(0, 2000))
    for level in (0.5, 0.8, 0.95):
        assert row[f"low{100 * level:.0f}"] == 0
        assert (1 - row[f"high{100 * level:.0f}"]) ** 2000 == pytest.approx((1 - level) / 2)
    assert np.isnan([row["probability"], row["median"]]).all()
    assert np.isnan(list(answer_row(None).values())).all()


def test_left_turns_without_speeds_that_are_certainly_wrong():
    """Four recorded speeds are left out; the answer has rows for the encounters without them."""
    holds = ae.SCENARIOS["left_turn"].restrictions["turning speed 30 m/s or less"]
    speeds = pd.read_parquet(ae.SCENARIOS["left_turn"].records.file)["turning_speed_mps"].to_numpy()
    assert (~holds(np.column_stack([np.zeros(speeds.size), speeds, speeds]))).sum() == 4


def test_an_answer_by_simulations_bounds_events_that_did_not_happen():
    never = ae.Event.above("impact_speed", 60.0, scored_by="clearance")
    draws = ae.choose_draws("independent_variables", ae.read_records("left_turn"))
    found = ae.evaluate(ae.Problem("left_turn", "acc_aeb"), draws, ae.Simulations(5000), [never], generator=1)
    row = found.table().iloc[1]
    assert (1 - row["high80"]) ** found.simulations == pytest.approx(0.1)
    assert found.table().iloc[0]["low80"] > 0
