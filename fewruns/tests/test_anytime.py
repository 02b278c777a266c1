"""Intervals that are checked after every batch: the boundary, and how often any of them misses the truth."""

import math

import numpy as np
import pytest
from fewruns.combining import BatchEstimate, anytime_interval, boundary, combine, reach_of_goal
from fewruns.two_phase import Prediction

ALPHA, BETA, RUNS, VARIATION = 0.2, 0.2, 5, 2.25
FIRST = 10  # checks that do not count


@pytest.mark.parametrize("alpha", [0.05, 0.2])
def test_a_brownian_motion_leaves_the_boundary_as_often_as_it_should(alpha):
    """On a fine grid of times; the continuous motion leaves it a little more often."""
    generator, steps, paths = np.random.default_rng(1), 2000, 4000
    walk = np.cumsum(generator.standard_normal((paths, steps)), axis=1) / math.sqrt(steps)
    left = (np.abs(walk).max(axis=1) > boundary(alpha)).mean()
    assert abs(left - alpha) < 4 * math.sqrt(alpha / paths) + 0.02


def test_the_goal_is_the_half_width():
    reach = reach_of_goal(BETA)
    assert (1 / (1 - reach) - 1 / (1 + reach)) / 2 == pytest.approx(BETA)


def batch(generator):
    """Return a batch of runs whose mean is 1, of skewed law; the prediction is right."""
    runs = generator.exponential(math.sqrt(VARIATION), RUNS) + 1 - math.sqrt(VARIATION)
    prediction = Prediction(1.0, VARIATION)
    return BatchEstimate(float(runs.mean()), float(runs.var(ddof=1)) / RUNS, RUNS, prediction, False)


def follow(generator):
    """Check one course until the anytime interval is narrow; return which kinds missed the truth."""
    batches, missed, narrow = [batch(generator)], {"usual": False, "anytime": False}, False
    while not narrow:
        batches.append(batch(generator))
        usual = combine(batches)
        found, ends = anytime_interval(batches, ALPHA, BETA)
        for kind, (low, high) in {"usual": usual.interval(ALPHA), "anytime": ends}.items():
            missed[kind] |= len(batches) > FIRST and not low <= 1 <= high
        narrow = (ends[1] - ends[0]) / 2 <= BETA * found.probability * (1 + 1e-12)
    return missed["usual"], missed["anytime"], len(batches)


def test_no_check_misses_the_truth_more_often_than_promised():
    """The usual interval, checked as often, does."""
    generator = np.random.default_rng(2)
    courses = np.array([follow(generator) for _ in range(150)])
    usual, anytime, _ = courses.mean(axis=0)
    assert anytime < ALPHA
    assert usual > ALPHA + 0.04


def test_the_interval_stays_as_it_was_when_the_goal_was_met():
    generator = np.random.default_rng(3)
    batches = [batch(generator) for _ in range(200)]
    first, ends = anytime_interval(batches[:100], ALPHA, BETA)
    again, same = anytime_interval(batches, ALPHA, BETA)
    assert ends == same
    assert first == again
    assert first.batches < 100
    assert (ends[1] - ends[0]) / 2 == pytest.approx(BETA * first.probability)
    early = anytime_interval(batches[:5], ALPHA, BETA)[1]
    assert early[0] < ends[0]
    assert early[1] > ends[1]
