"""The adaptive sampler against events of known probability."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from fewruns import Cover
from fewruns.certificate import BY_DEFAULT
from fewruns.constants import IN_VAIN, REACH
from fewruns.exclusion import Exclusion
from fewruns.wide_laws import bound_without_event, draw_wide
from sampler_checks import (
    HALF_PLANE,
    STOPPING,
    courses,
    estimate,
    half_plane,
    new_sampler,
    standard_normal_event,
)
from scipy.stats import binom, norm, ttest_1samp

TWO = norm.sf(4.0), norm.sf(4.3)


def two_half_planes():
    """Return an event of two regions, the second of a fifth of the probability."""
    return standard_normal_event(lambda z: np.minimum(4.0 - z[:, 0], 4.3 + z[:, 1]))


def either():
    return TWO[0] + TWO[1] - TWO[0] * TWO[1]


def probabilities(of):
    return np.array([course.result.probability for course in of])


def is_unbiased(estimates, truth):
    """Whether Student's t test lets the mean be the truth.

    Twelve estimates, whose coefficient of variation is 0.1, show a bias of a fifth with certainty.
    """
    return ttest_1samp(estimates, truth).pvalue > 1e-3


@pytest.fixture(scope="module")
def half_planes():
    return courses(half_plane(), 12)


# ---- estimates


@pytest.mark.seeds
def test_half_plane_is_estimated_without_bias(half_planes):
    estimates = probabilities(half_planes)
    assert is_unbiased(estimates, HALF_PLANE)
    assert (abs(np.log(estimates / HALF_PLANE)) < math.log(2)).all()
    assert not is_unbiased([course.flags for course in half_planes], HALF_PLANE)
    # without the control variate's share taken off the runs
    assert not is_unbiased([course.twice_controlled for course in half_planes], HALF_PLANE)


@pytest.mark.seeds
def test_half_plane_takes_few_simulations_and_is_covered(half_planes):
    results = [course.result for course in half_planes]
    assert all(result.converged and result.events > 0 for result in results)
    assert np.mean([result.simulations for result in results]) < 300
    for result in results:
        half_width = (result.high - result.low) / 2
        assert 2 / result.probability == pytest.approx(1 / result.low + 1 / result.high)
        assert half_width <= STOPPING.beta * result.probability * (1 + 1e-12)
    covered = sum(result.low <= HALF_PLANE <= result.high for result in results)
    assert covered >= binom.ppf(1e-3, len(results), 1 - STOPPING.alpha)
    # the same intervals about 1.5 P would not do
    assert sum(result.low <= 1.5 * HALF_PLANE <= result.high for result in results) < 6


@pytest.mark.seeds
def test_the_smaller_of_two_regions_is_not_lost():
    of = courses(two_half_planes(), 12)
    estimates = probabilities(of)
    assert is_unbiased(estimates, either())
    assert not is_unbiased(estimates, TWO[0])
    assert (abs(np.log(estimates / either())) < math.log(2)).all()
    for course in of:
        z = course.sampler.progress.z[course.sampler.progress.happened]
        assert (z[:, 0] > 4).any()
        assert (z[:, 1] < -4.3).any()


@pytest.mark.seeds
def test_flags_alone_are_enough():
    of = courses(half_plane(graded=False), 2)
    assert (abs(np.log(probabilities(of) / HALF_PLANE)) < math.log(2)).all()
    assert all((course.sampler.progress.score == 0).all() for course in of)


@pytest.mark.seeds
@pytest.mark.parametrize("outside", [False, True])
def test_a_frequent_event_is_estimated_without_bias(outside):
    """A probability of 0.3 beyond a line, and outside a circle, about which there is no single direction."""
    radius = math.sqrt(-2 * math.log(0.3))
    circle = standard_normal_event(lambda z: radius - np.hypot(*z.T))
    found = courses(circle if outside else half_plane(norm.isf(0.3)), 40, 5)
    assert is_unbiased([course.result.probability for course in found], 0.3)
    assert not is_unbiased([course.flags for course in found], 0.3)
    assert not is_unbiased([course.twice_controlled for course in found], 0.3)


@pytest.mark.seeds
def test_half_of_everything():
    of = courses(half_plane(0.0), 4)
    assert (abs(probabilities(of) / 0.5 - 1) < 0.5).all()
    assert all(0 <= course.result.low < course.result.high <= 1 for course in of)


def test_a_probability_is_at_most_1():
    found = [estimate(half_plane(-3.0), seed) for seed in range(2)]
    assert all(result.low <= result.probability <= result.high == 1 for result in found)
    assert all(abs(result.probability - norm.cdf(3.0)) < 0.2 for result in found)


def test_event_everywhere():
    result = estimate(half_plane(-99.0), 1, replace(STOPPING, maximum_simulations=60))
    assert result.events > 0
    assert not result.converged
    assert (result.probability, result.high, result.simulations) == (1.0, 1.0, 60)
    assert result.low == pytest.approx(1 - bound_without_event(60, STOPPING.alpha))


@pytest.mark.parametrize(
    ("size", "dimension", "certificate"),
    [
        (25, 2, None),
        pytest.param(500, 6, None, marks=pytest.mark.seeds),
        pytest.param(500, 10, Cover.by_default(10), marks=pytest.mark.seeds),
    ],
)
def test_large_batches_end_with_an_estimate(size, dimension, certificate):
    """Pools grow with the batch, or their own variance would outweigh what so many runs say."""
    event = standard_normal_event(lambda z: 4.0 - z.sum(1) / math.sqrt(dimension), dimension=dimension)
    most = replace(STOPPING, maximum_simulations=4000)
    found = estimate(event, 1, most, batch_size=size, certificate=certificate)
    assert found.converged
    runs_of_batch = np.bincount(found.tables["runs"]["batch"])[1:]
    assert runs_of_batch.max() == size  # those of the search, and those that exclude other parts, are smaller
    assert found.simulations < size * len(runs_of_batch)
    assert found.low / 1.5 < HALF_PLANE < found.high * 1.5


@pytest.mark.parametrize("maximum", [0, 9, 27, 60])
def test_the_limit_of_calls_holds(maximum):
    calls = []
    event = standard_normal_event(lambda z: (calls.append(len(z)), 4.0 - z[:, 0])[1])
    result = estimate(event, 1, replace(STOPPING, maximum_simulations=maximum))
    assert result.simulations == sum(calls)
    assert max(maximum - 5, -1) < result.simulations <= maximum  # batches of a cover may be smaller than 5
    assert not result.converged


# ---- no event


@pytest.mark.parametrize(
    ("dimension", "narrow_at", "most"),
    [(2, 70, 150), (3, 200, 300), (4, 100, 320), (4, 300, 450), (6, 100, 480)],
)
def test_the_certificate_takes_a_limited_number_of_runs(dimension, narrow_at, most):
    """Half of the runs until the interval was narrow, or 80; with many inputs 80 for each input in total."""
    progress = replace(new_sampler(dimension).progress, narrow_at=narrow_at)
    for runs, is_late in ((most - 1, False), (most, True)):
        known = replace(progress, z=np.zeros((runs, dimension)))
        assert Exclusion(known, None, 5).is_late == is_late
        assert not Exclusion(known, BY_DEFAULT, 5).is_late  # no scores are followed


@pytest.mark.parametrize("graded", [True, False])
def test_without_an_event_there_is_a_bound(graded):
    event = half_plane(99.0, graded=graded)
    result = estimate(event, 1, replace(STOPPING, maximum_simulations=50))
    assert (result.probability, result.low, result.simulations) == (0.0, 0.0, 50)
    assert result.events == 0
    assert not result.converged
    assert 0 < result.high <= 1


def test_the_bound_holds_and_shrinks():
    """Rarest seen by the wide law is an event about the origin: a ball, seen n times by none in alpha."""
    bounds = []
    for calls in (50, 100, 300):
        stopping = replace(STOPPING, alpha=0.1, maximum_simulations=calls)
        result = estimate(half_plane(99.0, graded=False), 1, stopping)
        bound = bound_without_event(calls, 0.1)
        # After this number of runs, some are draws of the law, which make the bound smaller.
        assert result.high == pytest.approx(bound) if calls <= IN_VAIN * REACH else result.high < bound
        bounds.append(bound)
        square = -2 * math.log1p(-bound)  # the ball of that probability, in two dimensions
        z = draw_wide(2000 * calls, 2, np.random.default_rng(2))
        missed = ~((z * z).sum(1) < square).reshape(2000, calls).any(1)
        assert abs(missed.mean() - 0.1) < 4 * math.sqrt(0.1 * 0.9 / 2000)
    assert bounds == sorted(bounds, reverse=True)
    assert bounds[0] > 0.9 > 0.4 > bounds[-1] > 0.1 ** (1 / 300) * 0.3
    assert bounds[-1] == pytest.approx(1 - math.exp(-REACH * (1 - 0.1 ** (1 / 300))))


@pytest.mark.seeds
def test_the_estimate_tells_of_all_runs(half_planes):
    for course in half_planes[:5]:
        result, progress = course.result, course.sampler.progress
        runs = pd.DataFrame(result.tables["runs"])
        assert list(runs) == ["run", "batch", "phase", "z_1", "z_2", "event", "score"]
        assert runs.groupby("batch").size().tolist() == progress.sizes.tolist()
        outcomes = np.column_stack([progress.z, progress.score])
        np.testing.assert_array_equal(runs[["z_1", "z_2", "score"]], outcomes)
        assert runs["event"].sum() == result.events
        phases = runs["phase"].drop_duplicates().tolist()
        assert phases == [phase for phase in ("search", "learn", "estimate", "cover") if phase in phases]
        search = runs[runs["phase"] == "search"]
        assert search["batch"].max() >= runs.loc[runs["event"], "batch"].min()
        assert (runs["phase"] == "estimate").sum() == result.estimating
        errors = result.diagnostics["observed_error"], result.diagnostics["predicted_error"]
        assert result.diagnostics["batches"] == runs.loc[runs["phase"] == "estimate", "batch"].nunique()
        assert 0 < max(errors) < STOPPING.beta


def test_minimum_events_are_waited_for():
    plain = estimate(half_plane(2.0), 0)
    result = estimate(half_plane(2.0), 0, replace(STOPPING, minimum_events=plain.events + 20))
    assert result.converged
    assert result.events >= plain.events + 20
    assert result.simulations > plain.simulations
