"""The posterior of a probability from estimates under draws of the law: what the sampling adds to it."""

from dataclasses import replace
from types import SimpleNamespace

import accelerated_evaluation as ae
import numpy as np
import pytest
from accelerated_evaluation.answer.ways.posterior import SampledPosterior, counted_posterior, shrunk_estimates
from accelerated_evaluation.vehicles.protocol import CRASH
from scipy.stats import norm


def test_the_sampling_error_widens_the_interval():
    generator = np.random.default_rng(1)
    exact = np.exp(generator.normal(0, 0.6, 4000))
    posterior = SampledPosterior(exact, np.zeros(4000, int), np.full(4000, 0.2), 1000)
    low, high = posterior.whole.interval(0.8)
    expected = 2 * norm.isf(0.1) * np.hypot(0.6, 0.2)
    assert np.log(high / low) == pytest.approx(expected, rel=0.04)
    assert posterior.share_of_sampling == pytest.approx(np.hypot(0.6, 0.2) / 0.6 - 1, abs=0.015)
    exactly = SampledPosterior(exact, np.zeros(4000, int), np.zeros(4000), 1000)
    assert exactly.share_of_sampling == pytest.approx(0, abs=1e-12)
    assert exactly.whole.interval(0.8) == pytest.approx(exactly.alone.interval(0.8), rel=1e-3)


def test_estimates_drawn_together_scatter_as_the_probabilities_do():
    generator = np.random.default_rng(8)
    logs, own = generator.normal(-13, 0.6, 4000), np.full(4000, 0.3)
    estimates = np.exp(logs + generator.normal(0, own))
    drawn = np.log(shrunk_estimates(estimates, own))
    error = 0.6 / np.sqrt(2 * 4000)
    assert drawn.std() == pytest.approx(0.6, abs=4 * error)
    assert np.log(estimates).std() > 0.6 + 4 * error  # without it: too wide
    assert np.median(drawn) == pytest.approx(np.median(np.log(estimates)))
    assert shrunk_estimates(estimates, 0 * own) == pytest.approx(estimates)


def test_a_draw_that_is_not_known_takes_the_median():
    generator = np.random.default_rng(9)
    estimates, own = np.exp(generator.normal(-13, 0.6, 400)), np.full(400, 0.05)
    estimates[0] *= 1e-3  # no event was met under this draw
    own[0] = 50.0
    drawn = shrunk_estimates(estimates, own)
    assert drawn[0] == pytest.approx(np.median(estimates), rel=0.1)
    assert np.log(drawn[1:]) == pytest.approx(np.log(estimates[1:]), abs=0.02)


def test_runs_that_know_too_little_do_not_end():
    """Draws that scatter by their errors alone span a wide interval, which these errors hardly widen."""
    scattered = np.exp(np.random.default_rng(10).normal(-13, 4.0, 4000))
    unknown = SampledPosterior(scattered, np.zeros(4000, int), np.full(4000, 0.7), 5)
    widths = [np.log(np.divide(*part.interval(0.8)[::-1])) for part in (unknown.alone, unknown.whole)]
    assert widths[1] < 1.05 * widths[0]  # which would be enough to stop
    assert unknown.share_of_sampling == np.inf
    known = SampledPosterior(scattered, np.zeros(4000, int), np.full(4000, 0.2), 20)
    assert known.share_of_sampling < 0.05


def partly_known(within=None):
    """Return a posterior of 400 draws, 40 of which have no estimate; these are the least probable ones."""
    probabilities = np.exp(np.linspace(-20, -10, 400))
    errors = np.where(np.arange(400) < 40, 1.0, 0.1)
    own = np.where(errors < 1, 0.01, 1.0)
    return SampledPosterior(probabilities, np.zeros(400, int), errors, 1000, 0.1, own, within=within)


def test_draws_without_an_estimate_enter_no_lower_end():
    """The lower end of the 95 % interval depends on them, that of the 50 % interval and the median do not."""
    posterior = partly_known()
    assert posterior.whole.interval(0.95)[0] == 0
    wrong = replace(posterior, errors=np.minimum(posterior.errors, 0.999))  # all count as estimates
    assert wrong.whole.interval(0.95)[0] > 0
    low, high = posterior.whole.interval(0.5)
    assert np.log([low, high]) == pytest.approx([-17.5, -12.5], abs=0.1)
    assert np.log(posterior.probability) == pytest.approx(-15, abs=0.1)
    assert np.isfinite(posterior.share_of_sampling)
    few = SampledPosterior(posterior.probabilities, posterior.member, np.full(400, 1.0), 1000)
    assert np.isnan(few.probability)


def test_a_part_of_an_event_is_never_above_it():
    """With its larger error, the upper end of the part alone exceeds that of the whole event."""
    event = partly_known()
    part = SampledPosterior(
        0.9 * event.probabilities, event.member, np.full(400, 0.6), 5, 0.6, np.full(400, 0.3)
    )
    assert part.whole.interval(0.95)[1] > event.whole.interval(0.95)[1]
    coherent = replace(part, within=event)
    assert np.all(coherent.with_sampling <= event.with_sampling)
    assert coherent.whole.interval(0.95)[1] <= event.whole.interval(0.95)[1]
    rare = replace(part, probabilities=1e-3 * part.probabilities)  # nothing to limit
    assert replace(rare, within=event).with_sampling == pytest.approx(rare.with_sampling)


def test_an_answer_limits_the_parts_of_an_event():
    """A faster impact is a part of a slower one. An unknown event has the limits of the next larger one."""
    crash, slow, fast = CRASH, ae.CUT_IN.event("impact_speed", 5.0), ae.CUT_IN.event("impact_speed", 10.0)
    near = ae.CUT_IN.event("min_range", 1.0)
    event = partly_known()
    larger = replace(event, probabilities=2 * event.probabilities)
    smaller = replace(event, probabilities=0.1 * event.probabilities)
    problem = SimpleNamespace(event=crash, scenario=ae.CUT_IN)
    answer = ae.Answer(problem, None, {crash: event, fast: larger, slow: smaller, near: larger})
    assert answer.posteriors[fast].probabilities == pytest.approx(smaller.probabilities)
    assert answer.posteriors[fast].within.probabilities == pytest.approx(smaller.probabilities)
    assert answer.posteriors[near].probabilities == pytest.approx(larger.probabilities)
    unknown = ae.Answer(problem, None, {crash: event, fast: None, slow: smaller, near: None})
    table = unknown.table().set_index("event")
    upper, lower = ["high50", "high80", "high95"], ["low50", "low80", "low95"]
    assert table.loc["impact above 10 m/s", upper].tolist() == table.loc["impact above 5 m/s", upper].tolist()
    assert table.loc["impact above 10 m/s", lower].tolist() == [0, 0, 0]
    assert np.isnan(table.loc["impact above 10 m/s", ["probability", "median"]].astype(float)).all()
    assert table.loc["range at most 1 m", ["median", *upper]].isna().all()  # no part


def test_few_weighted_occurrences_are_no_estimate():
    """Four occurrences of equal weight are too few, six are enough; one large weight makes many few."""
    member = np.zeros(1, int)
    assert counted_posterior(np.full((1, 4), 1e-3), 1000, member) is None
    six = counted_posterior(np.full((1, 6), 1e-3), 1000, member)
    assert six.probabilities[0] == pytest.approx(6e-3)
    assert six.errors[0] == pytest.approx(np.sqrt(0.994 / 6), rel=1e-6)
    assert counted_posterior(np.array([[1e-3] * 20 + [0.1]]), 1000, member) is None
    both = counted_posterior(np.array([[1e-3] * 6 + [0.0] * 6, [0.0] * 11 + [1e-3]]), 1000, np.zeros(2, int))
    assert both.unknown.tolist() == [False, True]
