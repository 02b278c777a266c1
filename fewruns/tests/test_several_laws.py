"""Reweighted estimates: exact where the sampled law is normal, and the draws are normal laws elsewhere."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from fewruns import SeveralLaws, SystemProblem, combining, run_batches
from fewruns.crossfit import Control, cross_fitted
from fewruns.progress import LawDraws, Progress
from fewruns.several_laws import Ratios, reweight
from sampler_checks import STOPPING, drive, half_plane, new_sampler, standard_normal_event
from scipy.stats import norm

SHIFTS = np.array([-0.4, -0.2, 0.0, 0.2, 0.4])  # of the mean, along the direction of the event
DIRECTION, LEVEL = np.array([0.6, 0.8]), 4.0
EXACT = norm.sf(LEVEL - SHIFTS)
SEEDS = 60


def log_ratios(z):
    """Return log(f_k / f) of normal laws of unit variance with shifted means."""
    along = z @ DIRECTION
    return SHIFTS[:, None] * along - SHIFTS[:, None] ** 2 / 2


def laws():
    return SeveralLaws(log_ratios)


@pytest.fixture(scope="module")
def samplers():
    return [drive(new_sampler(seed=seed, upper_set=True), half_plane(LEVEL)).sampler for seed in range(SEEDS)]


@pytest.fixture(scope="module")
def posteriors(samplers):
    return [laws().estimate(sampler) for sampler in samplers]


def standardised(estimates):
    """Return how many standard errors the mean of the estimates is from the exact values."""
    estimates = np.array(estimates)
    return np.abs(estimates.mean(axis=0) - EXACT) / (estimates.std(axis=0) / np.sqrt(len(estimates)))


@pytest.mark.seeds
def test_every_draw_gets_its_own_probability(posteriors):
    assert standardised([posterior.probabilities for posterior in posteriors]).max() < 4.5


@pytest.mark.seeds
def test_a_control_variate_that_is_not_reweighted_is_wrong(samplers):
    wrong = []
    for sampler in samplers:
        progress, total = sampler.progress, []
        for batch, happened in counted(progress):
            ratios = Ratios(np.exp(log_ratios(batch.z)), np.ones((SHIFTS.size, len(batch.kept))))
            total.append(reweight(batch, ratios, happened, Control.own(batch))[0])
        wrong.append(np.mean(total, axis=0))
    assert standardised(wrong)[[0, -1]].min() > 4.5


def counted(progress):
    """Return the batches that count, with the flags of their runs."""
    number = len(combining.consistent_batches(progress.estimates))
    runs = sum(len(batch.z) for batch in progress.batches[-number:])
    flags = np.split(
        progress.happened[-runs:], np.cumsum([len(b.z) for b in progress.batches[-number:]])[:-1]
    )
    return zip(progress.batches[-number:], flags, strict=True)


@pytest.mark.seeds
def test_the_errors_are_those_of_the_estimates(posteriors):
    errors = np.array([np.log(posterior.probabilities / EXACT) for posterior in posteriors]).std(axis=0)
    claimed = np.array([posterior.errors for posterior in posteriors]).mean(axis=0)
    assert np.all(claimed > 0.7 * errors)
    assert np.all(claimed < 2.5 * errors)


@pytest.mark.seeds
def test_without_another_law_the_estimate_is_the_samplers(samplers, posteriors):
    for sampler, posterior in zip(samplers, posteriors, strict=True):
        own = combining.combine(combining.consistent_batches(sampler.progress.estimates)).probability
        assert posterior.probabilities[2] == pytest.approx(own, rel=1e-9)


def share(z):
    """Roughly the probability that the event of the level 4.3 happens where that of the level 4 does."""
    return norm.cdf((z @ DIRECTION - 4.25) / 0.1) if len(z) else np.empty(0)


@pytest.mark.seeds
def test_a_part_of_the_event_is_found_from_the_same_runs(samplers):
    part, estimates = norm.sf(4.3 - SHIFTS), []
    for sampler in samplers:
        progress = sampler.progress
        happened = (progress.z @ DIRECTION > 4.3).astype(float)
        batches = [batch for batch, _ in counted(progress)]
        controls = [Control(batch.control * share(batch.z), share(batch.kept)) for batch in batches]
        estimates.append(laws().estimate(sampler, happened, controls).probabilities)
    estimates = np.array(estimates)
    error = estimates.std(axis=0) / np.sqrt(SEEDS)
    assert np.all(np.abs(estimates.mean(axis=0) - part) < 4.5 * error)


@pytest.fixture(scope="module")
def cross(samplers):
    """Return the posteriors with cross-fitted control variates."""
    posteriors = []
    for sampler in samplers:
        controls = cross_fitted(sampler, len(combining.consistent_batches(sampler.progress.estimates)))
        posteriors.append(laws().estimate(sampler, controls=controls))
    return posteriors


@pytest.mark.seeds
def test_cross_fitted_control_variates_keep_the_mean_and_reduce_the_error(posteriors, cross):
    assert standardised([posterior.probabilities for posterior in cross]).max() < 4.5
    errors = [np.std([p.probabilities / EXACT for p in ps], axis=0) for ps in (posteriors, cross)]
    assert np.mean(errors[1]) < np.mean(errors[0])


@pytest.mark.seeds
def test_a_surrogate_that_has_seen_the_batch_itself_hides_the_error(samplers, cross, monkeypatch):
    """The wrong control variate: learnt from the runs that it is subtracted from."""
    whole = Progress.without
    monkeypatch.setattr(Progress, "without", lambda progress, left_out: whole(progress, left_out[:0]))
    wrong = []
    for sampler in samplers[:20]:
        controls = cross_fitted(sampler, len(combining.consistent_batches(sampler.progress.estimates)))
        batches = sampler.progress.batches[-len(controls) :]
        for control, batch, (_, happened) in zip(controls, batches, counted(sampler.progress), strict=True):
            wrong.extend((happened - control.runs)[batch.control > 0] ** 2)
    honest = []
    monkeypatch.setattr(Progress, "without", whole)
    for sampler in samplers[:20]:
        controls = cross_fitted(sampler, len(combining.consistent_batches(sampler.progress.estimates)))
        for control, (batch, happened) in zip(controls, counted(sampler.progress), strict=True):
            honest.extend((happened - control.runs)[batch.control > 0] ** 2)
    assert np.mean(wrong) < 0.8 * np.mean(honest)


def test_there_is_no_posterior_without_an_estimate():
    assert laws().estimate(new_sampler()) is None


@pytest.mark.seeds
def test_the_shared_error_is_that_of_the_mean_of_the_draws(samplers):
    # The tails of the differences are so heavy that 60 seeds do not give their spread.
    more = (
        drive(new_sampler(seed=seed, upper_set=True), half_plane(LEVEL)).sampler for seed in range(SEEDS, 260)
    )
    found = [
        laws().estimate(sampler, controls=[Control.own(batch) for batch, _ in counted(sampler.progress)])
        for sampler in (*samplers, *more)
    ]
    logs = np.array([np.log(posterior.probabilities / EXACT) for posterior in found])
    shared = np.mean([posterior.shared for posterior in found])
    own = np.mean([posterior.own for posterior in found], axis=0)
    assert 0.7 * logs[:, 1:-1].mean(axis=1).std() < shared < 2 * logs[:, 1:-1].mean(axis=1).std()
    apart = logs - logs[:, 1:-1].mean(axis=1, keepdims=True)
    assert np.all(own[[0, -1]] > 0.6 * apart.std(axis=0)[[0, -1]])
    assert np.all(own[[0, -1]] < 2 * apart.std(axis=0)[[0, -1]])
    assert np.all(np.hypot(shared, own) < 1.6 * np.mean([posterior.errors for posterior in found], axis=0))


@pytest.mark.seeds
def test_the_shared_error_is_at_least_that_predicted_before_the_runs(samplers):
    """Runs that agree with their control variate, because they missed the rest, must not look exact.

    The control variates of this test are the outcomes themselves, so that the runs show no second phase.
    """
    for sampler in samplers[:10]:
        batches = combining.consistent_batches(sampler.progress.estimates)
        importance = np.array([batch.importance for batch in batches])
        variations = np.array([batch.prediction.variation / batch.runs for batch in batches])
        predicted = np.sqrt((importance / importance.sum()) ** 2 @ variations)
        known = [
            Control(happened.astype(float), np.ones(len(batch.kept)))
            for batch, happened in counted(sampler.progress)
        ]
        found = laws().estimate(sampler, controls=known)
        assert found.shared == pytest.approx(predicted, rel=1e-9)
        assert found.own.max() < predicted  # from the runs alone, the errors would be 0


@pytest.mark.seeds
def test_any_emphasis_leaves_the_estimate_right_and_attracts_runs(samplers):
    def aside(z):
        return np.where(z @ [0.8, -0.6] > 0, 5.0, 0.2)

    def driven(seed):
        sampler = new_sampler(seed=seed, upper_set=True)
        sampler.emphasis = aside
        return drive(sampler, half_plane(LEVEL)).sampler

    emphasised = [driven(seed) for seed in range(12)]
    estimates = [laws().estimate(sampler).probabilities for sampler in emphasised]
    assert standardised(estimates).max() < 4.5
    shares = [
        np.mean(aside(np.vstack([batch.z[batch.aimed] for batch, _ in counted(sampler.progress)])) > 1)
        for part in (emphasised, samplers)
        for sampler in part
    ]
    assert np.mean(shares[:12]) > np.mean(shares[12:]) + 0.2


def noisy(generator):
    """The half-plane with noise, whose exact probabilities are those of a wider normal distribution."""

    def respond(z):
        score = LEVEL - z @ DIRECTION + 0.3 * generator.standard_normal(len(z))
        return score < 0, score

    return SystemProblem(respond, 2, fingerprint="half planes")


def test_a_noisy_system_has_an_estimate_under_every_draw():
    """Its batches count although a single run has a large variation, as in the estimate of the sampler."""
    stopping, exact = replace(STOPPING, beta=0.4), norm.sf((LEVEL - SHIFTS) / np.hypot(1, 0.3))
    for seed in range(2):
        sampler = new_sampler(seed=seed, upper_set=True, deterministic=False)
        for _ in run_batches(sampler, noisy(np.random.default_rng(seed)), stopping):
            pass
        found = laws().estimate(sampler)
        assert found.probabilities[2] == pytest.approx(sampler.estimate(stopping).probability, rel=1e-9)
        assert np.all(np.abs(np.log(found.probabilities / exact)) < 4 * found.errors)


def test_counted_events_are_reweighted_for_every_draw():
    generator, level = np.random.default_rng(5), 2.0
    sampler, estimates = new_sampler(deterministic=False), []
    sampler.progress.chance = True
    for _ in range(200):
        z = generator.standard_normal((400, 2))
        sampler.progress.law_draws = LawDraws(z, z @ DIRECTION > level)
        assert sampler.is_counted
        estimates.append(laws().estimate(sampler))
    found, exact = np.array([each.probabilities for each in estimates]), norm.sf(level - SHIFTS)
    error = found.std(axis=0) / np.sqrt(len(found))
    assert np.all(np.abs(found.mean(axis=0) - exact) < 4.5 * error)
    assert np.abs(found.mean(axis=0) - exact[2])[[0, -1]].min() > 4.5 * error.max()  # not reweighted
    claimed = np.mean([each.errors for each in estimates], axis=0)
    assert np.all(np.abs(claimed / (found.std(axis=0) / exact) - 1) < 0.3)
    part = laws().estimate(sampler, z @ DIRECTION > level + 9)
    assert part is None


FAR = np.array([-60.0, -20, -8, -5, -3, -2, -1, 0, 1, 2, 3, 4, 5, 6, 8, 20, 45])  # means of the first input


def far_from_the_runs(seed):
    """Return the estimates of P(z1 > 4.5) under N(m, 1) for all means in `FAR`, from runs under N(0, 1)."""
    event = standard_normal_event(lambda z: 4.5 - z[:, 0])
    sampler = drive(new_sampler(seed=seed), event).sampler
    return SeveralLaws(lambda z: np.outer(FAR, z[:, 0]) - FAR[:, None] ** 2 / 2).refined(sampler)


@pytest.mark.seeds
def test_laws_far_from_the_runs_are_estimated_or_unknown():
    """Exact: `norm.sf`. Wrong: all estimates raised to a thousandth of their mean, with the same errors."""
    truth, off, raised = norm.logsf(4.5 - FAR), [], []
    for seed in range(12):
        found = far_from_the_runs(seed)
        known = found.errors < 1
        assert known[FAR == 0].all()
        assert not known[np.isin(FAR, (-60, 8, 20, 45))].any()
        floor = np.maximum(found.probabilities, 1e-3 * found.probabilities.mean())
        for values, all_of in ((found.probabilities, off), (floor, raised)):
            all_of.extend((np.log(values[known]) - truth[known]) / found.errors[known])
    assert np.sqrt(np.mean(np.square(off))) < 1.6
    assert np.abs(off).max() < 6  # t-distributed, with few degrees of freedom
    assert np.abs(raised).max() > 20


def test_draws_of_the_law_without_enough_events_are_unknown():
    """Four events of equal weight under the first law, and 40 under the second one."""
    draws = LawDraws(np.arange(1000.0)[:, None], np.arange(1000) < 44)

    sampler = SimpleNamespace(is_counted=True, progress=SimpleNamespace(law_draws=draws))
    few = SeveralLaws(lambda z: np.log(np.array([z[:, 0] < 4, (z[:, 0] >= 4) * 1.0]) + 1e-300))
    found = few.estimate(sampler)
    assert found.probabilities == pytest.approx([0.004, 0.04])
    assert found.errors == pytest.approx([1.0, np.sqrt(0.96 / 40)])
