"""The diagnostics of importance ratios, against tails and numbers that are known."""

import math

import numpy as np
import pytest
from fewruns import SeveralLaws
from fewruns.results import event_ratios
from fewruns.weights import (
    PRIOR_RATIOS,
    PRIOR_SHAPE,
    effective_number,
    largest_pareto_k,
    pareto_k,
    pareto_shape,
)
from sampler_checks import drive, half_plane, new_sampler
from scipy.stats import genpareto

REPEATS, SIZE = 60, 2000
TAIL = math.ceil(3 * math.sqrt(SIZE))


def mean_and_error(values):
    return np.mean(values), np.std(values) / math.sqrt(len(values))


@pytest.mark.parametrize("shape", [0.1, 0.4, 0.8])
def test_pareto_k_of_a_known_tail(shape):
    generator = np.random.default_rng(1)
    drawn = genpareto.rvs(shape, size=(REPEATS, SIZE), random_state=generator)
    mean, error = mean_and_error([pareto_k(ratios) for ratios in drawn])
    # A tail of a generalised Pareto distribution has the same shape, and the prior moves its estimate. The
    # bias of the estimate of Zhang and Stephens is of the order of 1 / TAIL.
    expected = (TAIL * shape + PRIOR_RATIOS * PRIOR_SHAPE) / (TAIL + PRIOR_RATIOS)
    assert mean == pytest.approx(expected, abs=4 * error + 1 / TAIL)
    # The asymptotic standard error of the shape is (1 + k) / sqrt(n).
    assert error * math.sqrt(REPEATS) == pytest.approx((1 + shape) / math.sqrt(TAIL), rel=0.4)


def test_the_tail_has_to_be_measured_from_its_beginning():
    generator = np.random.default_rng(2)
    drawn = np.sort(genpareto.rvs(0.4, size=(REPEATS, SIZE), random_state=generator))[:, -TAIL:]
    mean, error = mean_and_error([pareto_shape(tail) for tail in drawn])
    assert abs(mean - 0.4) > 10 * error  # the wrong variant: the ratios themselves, without subtraction
    mean, error = mean_and_error([pareto_shape(tail[1:] - tail[0]) for tail in drawn])
    assert mean == pytest.approx(0.4, abs=4 * error + 1 / TAIL)


@pytest.mark.parametrize(("variance", "reliable"), [(0.1, False), (2.0, True)])
def test_a_proposal_that_is_too_narrow_is_noticed(variance, reliable):
    z = np.random.default_rng(3).normal(scale=math.sqrt(variance), size=SIZE)
    ratios = np.exp(-z * z / 2 * (1 - 1 / variance))  # their tail has the shape 1 - variance, or an end
    assert (pareto_k(ratios) <= largest_pareto_k(SIZE)) == reliable


def test_the_threshold_depends_on_the_number_of_ratios():
    # The values of Vehtari and others (2024) for 100 and for more than 2,154 ratios.
    assert largest_pareto_k(100) == pytest.approx(0.5)
    assert largest_pareto_k(10**6) == 0.7
    assert largest_pareto_k(2154) < 0.7 <= largest_pareto_k(2155)
    assert math.isnan(largest_pareto_k(1))


@pytest.mark.parametrize("ratios", [np.ones(1000), np.arange(1.0, 21.0), np.empty(0)])
def test_without_a_tail_there_is_no_shape(ratios):
    assert math.isnan(pareto_k(ratios))


def test_the_effective_number_of_known_weights():
    assert effective_number(np.ones((2, 7))) == pytest.approx([7, 7])
    assert effective_number(np.array([3.0, 1.0])) == pytest.approx(16 / 10)
    assert effective_number(np.empty(0)) == 0


def test_an_estimate_reports_the_health_of_its_weights():
    course = drive(new_sampler(), half_plane())
    progress, found = course.sampler.progress, course.result.diagnostics
    one_law = SeveralLaws(lambda z: np.zeros((1, len(z))))
    assert found["effective_events"] == pytest.approx(one_law.effective_events(progress)[0])
    ratios = event_ratios(progress)
    assert 1 < found["effective_events"] < len(ratios) < course.result.events
    assert found["pareto_k"] == pytest.approx(pareto_k(ratios), nan_ok=True)
    assert found["pareto_k_limit"] == largest_pareto_k(len(ratios))
    # A single event with a dominating weight makes the effective number 1.
    end = len(progress.z)
    for batch in reversed(progress.batches):
        events = np.flatnonzero(progress.happened[end - len(batch.z) : end] & (batch.weight > 0))
        end -= len(batch.z)
        if len(events):
            batch.weight[events[-1]] *= 1e6
            break
    assert effective_number(event_ratios(progress)) == pytest.approx(1, rel=1e-3)
