"""What may be unseen: the bound holds for parts of known probability, and a bolder one does not."""

import math

import numpy as np
import pytest
from accelerated_evaluation.methods.surrogate.certificate import BY_DEFAULT, Certificate, Unseen, _cap
from accelerated_evaluation.methods.surrogate.constants import REACH, UNSEEN_ALPHA
from accelerated_evaluation.methods.surrogate.two_phase import reach_of
from accelerated_evaluation.methods.surrogate.wide_laws import draw_at, rarity
from sampler_checks import drive, estimate, new_sampler, standard_normal_event
from scipy.stats import binom, norm

HIDDEN_CURVATURE = 0.4


def in_mode(z, distance, curvature):
    """Whether points are in the mode along the first axis: a half-space, or the ball that touches it."""
    if curvature == 0:
        return z[:, 0] > distance
    z = z - np.eye(z.shape[1])[0] * (distance + 1 / curvature)
    return (z * z).sum(1) < curvature**-2


@pytest.mark.parametrize("dimension", [1, 2, 3, 6])
@pytest.mark.parametrize("curvature", [0.0, HIDDEN_CURVATURE])
def test_share_of_the_directions_of_a_mode(dimension, curvature):
    generator, n = np.random.default_rng(dimension), 40_000
    for distance, radius in ((2.0, 3.0), (2.0, 6.0), (4.0, 3.0)):
        at = -np.log(np.full(n, 0.5))
        z = draw_at(at, dimension, generator)
        z *= radius / np.linalg.norm(z, axis=1, keepdims=True)
        share = in_mode(z, distance, curvature).mean()
        exact = float(_cap(np.array([radius]), distance, dimension, curvature)[0])
        assert abs(share - exact) < 5 * math.sqrt(exact * (1 - exact) / n) + 1e-9


@pytest.mark.parametrize("curvature", [0.0, HIDDEN_CURVATURE])
def test_the_bound_of_a_mode_fails_as_seldom_as_it_says(curvature):
    """The mode just at the bound is missed in a share alpha of the trials; a bound from half as many draws
    of the mode, which would be smaller, is exceeded more often.
    """
    generator, trials, reach = np.random.default_rng(1), 1500, 15.0
    looks = np.array([[30.0, REACH], [150.0, reach]])
    bound = Unseen.after(looks, 3, reach, curvature).mode
    bolder = Unseen.after(looks * [2, 1], 3, reach, curvature).mode
    assert bolder < bound < 0.3

    def missed(probability):
        distance = norm.isf(probability)
        met = np.zeros(trials, bool)
        for number, cut in looks:
            for _ in range(int(number)):
                z = draw_at(generator.uniform(0, cut, trials), 3, generator)
                met |= in_mode(z, distance, curvature) & (rarity(z) <= reach)
        return (~met).sum()

    assert abs(missed(bound) - UNSEEN_ALPHA * trials) < 5 * math.sqrt(UNSEEN_ALPHA * trials)
    assert missed(bolder) > binom.isf(1e-6, trials, UNSEEN_ALPHA)


def test_any_set_at_the_bound_is_missed_as_seldom_as_it_says():
    generator, trials = np.random.default_rng(2), 2000
    looks = np.array([[20.0, REACH], [30.0, 20.0]])
    bound = Unseen.after(looks, 2, 20.0, 0.0).anything
    missed = np.ones(trials, bool)
    for number, cut in looks:
        rarities = generator.uniform(0, cut, (trials, int(number)))
        missed &= (rarities > -math.log1p(-bound)).all(1)  # beyond the ball of that probability
    assert abs(missed.mean() - UNSEEN_ALPHA) < 5 * math.sqrt(UNSEEN_ALPHA / trials)


def test_more_draws_leave_less_unseen():
    bounds = [Unseen.after(np.array([[n, 20.0]]), 3, 20.0, 0.2) for n in (1.0, 50.0, 200.0, 1000.0)]
    assert [bound.mode for bound in bounds] == sorted((bound.mode for bound in bounds), reverse=True)
    assert bounds[0].mode == 0.5
    assert bounds[-1].mode < 1e-4
    assert all(bound.mode <= bound.anything for bound in bounds[1:])
    assert Unseen.after(np.empty((0, 2)), 3, 20.0, 0.2).anything > 0.999


def test_runs_are_worth_the_draws_that_are_claimed():
    """A far half-plane that is no part of the event is met as often as the claimed draws would meet it."""
    event = standard_normal_event(lambda z: 3.0 - z[:, 0])
    met = claimed = 0.0
    for seed in range(10):
        progress = drive(new_sampler(2, seed), event).sampler.progress
        second_phase = len(progress.estimates) * 10
        z, looks = progress.z[-second_phase:], progress.looks[-len(progress.estimates) :]
        met += (z[:, 0] < -2.0).sum()
        for number, reach in looks:
            z = draw_at(np.random.default_rng(3).uniform(0, reach, 4000), 2, np.random.default_rng(seed))
            claimed += number * (z[:, 0] < -2.0).mean()
    assert claimed > 12
    assert met > claimed - 3 * math.sqrt(claimed)


def test_a_certificate_goes_on_after_the_interval_is_narrow():
    event = standard_normal_event(lambda z: 3.0 - z[:, 0])
    plain = estimate(event, 1)
    strict = estimate(event, 1, certificate=Certificate(share=0.5, curvature=0.2))
    assert plain.converged
    assert strict.converged
    assert strict.simulations > plain.simulations
    assert strict.diagnostics["unseen_mode"] <= 0.5 * strict.probability
    assert plain.diagnostics["unseen_mode"] <= plain.diagnostics["unseen_any"] <= 1
    assert strict.diagnostics["looks"] > plain.diagnostics["looks"]


def test_a_region_that_is_met_late_is_not_averaged_away():
    """A certificate of a tenth finds the second region, of the same probability, which no score points to."""
    event = standard_normal_event(lambda z: np.minimum(3.5 - z[:, 0], 3.5 + z[:, 0]), graded=False)
    for seed in range(2):
        result = estimate(event, seed, certificate=Certificate(share=0.1, curvature=0.2))
        assert abs(math.log(result.probability / (2 * norm.sf(3.5)))) < math.log(1.6)


@pytest.mark.parametrize("wrong", [(0.0, 1.0), (1.0, -1.0), (1.0, math.inf)])
def test_certificates_that_mean_nothing_are_refused(wrong):
    with pytest.raises(ValueError, match="share must be positive"):
        Certificate(*wrong)


def test_an_event_found_at_its_far_end_has_not_converged():
    """After 60 draws of the whole wide law an event of 1e-20 is not certified; one of 1e-4 is."""
    looks = np.array([[60.0, REACH]])
    for probability, certified in ((1e-20, False), (1e-4, True)):
        unseen = Unseen.after(looks, 3, reach_of(probability), BY_DEFAULT.curvature)
        assert (unseen.mode <= BY_DEFAULT.share * probability) == certified


def test_reach_of_a_probability():
    assert reach_of(1e-6) == pytest.approx(math.log(1e6) + 3)
    assert reach_of(0.0) == reach_of(1e-40) == REACH
