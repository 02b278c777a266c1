"""Joint laws of users as candidates for cut-ins: their scores, and their draws with recorded lead speeds."""

from types import SimpleNamespace

import numpy as np
import pytest
from accelerated_evaluation import Box, DrawnLaws
from accelerated_evaluation.answer.candidates.cut_in_family import conditional_scores, scores_by_region
from accelerated_evaluation.answer.candidates.joint_family import ClusteredRecords, JointFamily
from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.candidates.scores import BLOCKS, contiguous_blocks
from accelerated_evaluation.laws.distributions import Empirical
from accelerated_evaluation.laws.joint.truncated import Normals
from accelerated_evaluation.laws.joint.truncated_normals import TruncatedNormalMixture
from accelerated_evaluation.laws.lead_speeds import with_lead_speeds
from scipy import stats

TOP, CORRELATION = 20.0, 0.6
MEAN, DEVIATION = np.array([40.0, 5.0]), np.array([15.0, 4.0])


def law_with(mean):
    """Return one bivariate normal distribution of range and closing speed, truncated to its limits."""
    product = CORRELATION * DEVIATION.prod()
    covariance = np.array([[DEVIATION[0] ** 2, product], [product, DEVIATION[1] ** 2]])
    box = Box(("range", "closing_speed"), (0.0, 0.0), (75.0, TOP))
    return TruncatedNormalMixture(np.ones(1), Normals(mean[None], covariance[None], box))


@pytest.fixture(scope="module")
def law():
    return law_with(MEAN)


def test_cut_ins_are_scored_by_the_closing_speed_given_the_range(law):
    x = law.draw(300, np.random.default_rng(1))
    boundary = 0.1 * x[:, 0]
    mean = MEAN[1] + CORRELATION * DEVIATION[1] * (x[:, 0] - MEAN[0]) / DEVIATION[0]
    deviation = DEVIATION[1] * np.sqrt(1 - CORRELATION**2)
    given = stats.truncnorm((0 - mean) / deviation, (TOP - mean) / deviation, mean, deviation)
    exact = np.where(x[:, 1] > boundary, given.logpdf(x[:, 1]), given.logcdf(boundary))
    assert 50 < (x[:, 1] > boundary).sum() < 250  # both kinds of score are compared
    np.testing.assert_allclose(conditional_scores(law, x, boundary), exact, rtol=1e-6, atol=1e-6)
    assert not np.allclose(law.log_density(x), exact, atol=0.1)  # the joint density is another score


def test_each_record_is_scored_by_the_law_without_its_block_in_every_region(law):
    x = law.draw(60, np.random.default_rng(5))
    mine = SimpleNamespace(
        name="mine", fit=lambda records, generator, start: law_with(records.x.mean(axis=0))
    )
    records = ClusteredRecords(x, np.arange(len(x)), law.box)
    everything = law_with(x.mean(axis=0))
    family = JointFamily(records, [mine], [everything], np.zeros((1, 60)), np.zeros((1, 60)))
    regions = {"critical": 0.2 * x[:, 0], "all": 0.05 * x[:, 0]}
    scores = scores_by_region(family, regions, np.random.default_rng(6))
    block = contiguous_blocks(len(x), BLOCKS)
    for name, boundary in regions.items():
        exact = np.empty(len(x))
        for number in range(BLOCKS):
            out = block == number
            held = law_with(x[~out].mean(axis=0))
            exact[out] = conditional_scores(held, x[out], boundary[out])
        np.testing.assert_allclose(scores["mine"][name], exact, rtol=1e-12)
        known = conditional_scores(everything, x, boundary)  # under a law that knows the record
        assert known.sum() > exact.sum() + 0.01


def test_without_added_laws_the_other_weights_are_relative_to_each_other():
    own, others = (SimpleNamespace(names=names) for names in (("a", "b"), ("mine",)))
    study = LawStudy(own, np.array([[0.2, 0.6, 0.2], [0.0, 0.0, 1.0]]), others)
    alone = study.without_added
    assert alone.names == ("a", "b")
    np.testing.assert_allclose(alone.weights, [[0.25, 0.75], [0.5, 0.5]])  # equal if all were 0
    assert alone.mean({"a": 1.0, "b": 3.0}) == pytest.approx(0.375 * 1 + 0.625 * 3)
    assert alone.without_added is alone


def test_draws_of_users_laws_get_recorded_lead_speeds(law):
    drawn = DrawnLaws.of([law, law], ("one", "another"), np.random.default_rng(2))
    speeds = np.array([10.0, 20.0, 35.0])
    cut_ins = with_lead_speeds(drawn, Empirical(speeds))
    x = cut_ins.draw_from_mean(3_000, np.random.default_rng(3))
    share = np.mean(x[:, :1] == speeds, axis=0)
    assert share.sum() == pytest.approx(1)
    assert share == pytest.approx(1 / 3, abs=5 * np.sqrt(2 / 9 / len(x)))
    assert cut_ins.names == drawn.names
    np.testing.assert_allclose(cut_ins.log_densities(x), drawn.log_densities(x[:, 1:]), rtol=1e-12)
    np.testing.assert_allclose(
        cut_ins.proposal.log_density(x), drawn.proposal.log_density(x[:, 1:]), rtol=1e-12
    )


def test_draws_get_the_cap_of_another_law_with_the_probability_of_all_larger_closing_speeds(law):
    """A campaign that drove its cut-ins under a law with a cap is reweighted to draws with the same cap."""
    cap = 8.0
    drawn = with_lead_speeds(DrawnLaws.of([law], ("one",), np.random.default_rng(2)), Empirical([10.0, 20.0]))
    draws = drawn + drawn
    capped = draws.with_cap_at(cap)
    x = np.array([[10.0, 20.0, 3.0], [20.0, 30.0, cap], [10.0, 60.0, cap]])
    mean = MEAN[1] + CORRELATION * DEVIATION[1] * (x[:, 1] - MEAN[0]) / DEVIATION[0]
    deviation = DEVIATION[1] * np.sqrt(1 - CORRELATION**2)
    given = stats.truncnorm((0 - mean) / deviation, (TOP - mean) / deviation, mean, deviation)
    exact = draws.log_densities(x)[0] + np.where(x[:, 2] < cap, 0.0, given.logsf(cap) - given.logpdf(cap))
    np.testing.assert_allclose(capped.log_densities(x), [exact, exact], rtol=1e-6)
    assert not np.allclose(draws.log_densities(x), exact, atol=0.1)  # without the cap
    some = capped.draw(5_000, np.random.default_rng(3))
    assert some[:, 2].max() == cap == capped.box.upper[2]
    same = capped.with_cap_at(np.inf)
    np.testing.assert_array_equal(same.log_densities(x), draws.log_densities(x))
