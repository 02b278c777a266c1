"""What may be unseen: the bound holds for parts of known probability, and a bolder one does not."""

import math

import numpy as np
import pytest
from fewruns import Certificate, InputError, Sampler
from fewruns.certificate import BY_DEFAULT, Unseen, _cap, look_beyond
from fewruns.constants import FREQUENT_REACH, FREQUENT_START, REACH, START, UNSEEN_ALPHA
from fewruns.two_phase import reach_of
from fewruns.wide_laws import draw_at, draw_wide, rarity
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
    wide_draws = np.array([[30.0, 0.0, REACH], [100.0, 0.0, reach], [40.0, 9.0, reach]])
    bound = Unseen.after(wide_draws, 3, reach, curvature).mode
    bolder = Unseen.after(wide_draws * [2, 1, 1], 3, reach, curvature).mode
    assert bolder < bound < 0.3

    def missed(probability):
        distance = norm.isf(probability)
        met = np.zeros(trials, bool)
        for number, begin, end in wide_draws:
            for _ in range(int(number)):
                z = draw_at(generator.uniform(begin, end, trials), 3, generator)
                met |= in_mode(z, distance, curvature) & (rarity(z) <= reach)
        return (~met).sum()

    assert abs(missed(bound) - UNSEEN_ALPHA * trials) < 5 * math.sqrt(UNSEEN_ALPHA * trials)
    assert missed(bolder) > binom.isf(1e-6, trials, UNSEEN_ALPHA)


def expected_in(wide_draws, distance, curvature, reach):
    """Return how many draws are expected in a mode, by drawing many."""
    expected, generator = 0.0, np.random.default_rng(5)
    for number, begin, end in wide_draws:
        z = draw_at(generator.uniform(begin, end, 40_000), 3, generator)
        expected += number * (in_mode(z, distance, curvature) & (rarity(z) <= reach)).mean()
    return expected


@pytest.mark.parametrize(("curvature", "gain"), [(0.0, 1.2), (HIDDEN_CURVATURE, 1.0), (1.0, 0.99)])
def test_looking_beyond_a_rarity_meets_the_nearest_mode_most_often(curvature, gain):
    """Draws there meet it more often than draws that begin nearer or farther out, and than all draws."""
    wide_draws, share, reach = np.array([[150.0, 0.0, REACH]]), 1e-6, 17.0
    nearest = norm.isf(Unseen.after(wide_draws, 3, reach, curvature).mode)
    beyond = look_beyond(wide_draws, 3, reach, curvature, share)
    farthest = rarity(np.array([[norm.isf(share), 0.0, 0.0]]))[0]
    assert 0 <= beyond <= farthest
    best = expected_in([[1000.0, beyond, reach]], nearest, curvature, reach)
    assert best > gain * expected_in([[1000.0, 0.0, reach]], nearest, curvature, reach)
    for begin in (0.7 * beyond, min(1.2 * beyond, farthest)):
        there = expected_in([[1000.0, begin, reach]], nearest, curvature, reach)
        assert best > there - 4 * math.sqrt(there / 40)  # 40 thousand draws stand for a thousand
    # Draws beyond leave less unseen than as many draws of the whole wide law.
    more = [np.vstack([wide_draws, [60.0, begin, reach]]) for begin in (beyond, 0.0)]
    aimed, spread = (Unseen.after(each, 3, reach, curvature).mode for each in more)
    assert aimed < spread or beyond == 0


def test_a_mode_that_ends_early_is_looked_for_where_it_is():
    """A ball of radius 1 nearby does not reach as far as the modes that the certificate speaks of."""
    wide_draws, share, reach = np.array([[40.0, 0.0, REACH]]), 1e-8, 21.0
    farthest = rarity(np.array([[norm.isf(share), 0.0, 0.0]]))[0]
    plain, curved = (look_beyond(wide_draws, 3, reach, curvature, share) for curvature in (0.0, 1.0))
    assert plain == pytest.approx(farthest, abs=0.2)
    nearest = norm.isf(Unseen.after(wide_draws, 3, reach, 1.0).mode)
    assert rarity(np.array([[nearest, 0.0, 0.0]]))[0] - 0.2 <= curved < farthest - 3
    assert look_beyond(np.empty((0, 3)), 3, 0.0, 0.0, share) == 0.0


def test_any_set_at_the_bound_is_missed_as_seldom_as_it_says():
    generator, trials = np.random.default_rng(2), 2000
    wide_draws = np.array([[20.0, 0.0, REACH], [30.0, 0.0, 20.0]])
    bound = Unseen.after(wide_draws, 2, 20.0, 0.0).anything
    missed = np.ones(trials, bool)
    for number, begin, end in wide_draws:
        rarities = generator.uniform(begin, end, (trials, int(number)))
        missed &= (rarities > -math.log1p(-bound)).all(1)  # beyond the ball of that probability
    assert abs(missed.mean() - UNSEEN_ALPHA) < 5 * math.sqrt(UNSEEN_ALPHA / trials)


def test_more_draws_leave_less_unseen():
    bounds = [Unseen.after(np.array([[n, 0.0, 20.0]]), 3, 20.0, 0.2) for n in (1.0, 50.0, 200.0, 1000.0)]
    assert [bound.mode for bound in bounds] == sorted((bound.mode for bound in bounds), reverse=True)
    assert bounds[0].mode == 0.5
    assert bounds[-1].mode < 1e-4
    assert all(bound.mode <= bound.anything for bound in bounds[1:])
    assert Unseen.after(np.empty((0, 3)), 3, 20.0, 0.2).anything > 0.999


@pytest.mark.seeds
def test_runs_are_worth_the_draws_that_are_claimed():
    """A far half-plane that is no part of the event is met as often as the claimed draws would meet it.

    The runs for an estimate are counted first, and then those for a certificate.
    """
    event = standard_normal_event(lambda z: 3.0 - z[:, 0])
    met, claimed = np.zeros(2), np.zeros(2)
    for seed in range(10):
        sampler = drive(new_sampler(2, seed), event).sampler
        first_run, first_look = sampler.simulations - 10 * len(sampler.progress.estimates), 2
        for certify in (0, 1):
            if certify:
                sampler.certificate = Certificate(share=0.01, curvature=0.1)
                first_run, first_look = sampler.simulations, len(sampler.progress.wide_draws)
                for _ in range(6):
                    sampler.tell(*event.evaluate(sampler.ask(certify=True)))
            z, wide_draws = sampler.progress.z[first_run:], sampler.progress.wide_draws[first_look:]
            assert (wide_draws[:, 1] > 0).any() == certify
            met[certify] += (z[:, 0] < -2.0).sum()
            for number, begin, end in wide_draws:
                rarity = np.random.default_rng(3).uniform(begin, end, 4000)
                there = draw_at(rarity, 2, np.random.default_rng(seed))[:, 0] < -2.0
                claimed[certify] += number * there.mean()
    assert (claimed > 10).all()
    assert (met > claimed - 3 * np.sqrt(claimed)).all()


def test_a_certificate_goes_on_after_the_interval_is_narrow():
    event = standard_normal_event(lambda z: 3.0 - z[:, 0])
    plain = estimate(event, 1, upper_set=True)
    strict = estimate(event, 1, upper_set=True, certificate=Certificate(share=0.5, curvature=0.2))
    assert plain.converged
    assert strict.converged
    assert strict.simulations > plain.simulations
    assert strict.diagnostics["unseen_mode"] <= 0.5 * strict.probability
    assert plain.diagnostics["unseen_mode"] <= plain.diagnostics["unseen_any"] <= 1
    assert strict.diagnostics["wide_draws"] > plain.diagnostics["wide_draws"]


def test_a_region_that_is_met_late_is_not_averaged_away():
    """A certificate of a tenth finds the second region, of the same probability, which no score points to."""
    event = standard_normal_event(lambda z: np.minimum(3.5 - z[:, 0], 3.5 + z[:, 0]), graded=False)
    for seed in range(2):
        result = estimate(event, seed, certificate=Certificate(share=0.1, curvature=0.2))
        assert abs(math.log(result.probability / (2 * norm.sf(3.5)))) < math.log(1.6)


def test_a_mode_that_is_not_filled_is_missed_as_seldom_as_its_bound_says():
    """The event happens in 30 % of the encounters of a half-space; a filled one is met oftener."""
    generator, trials, draws, filled = np.random.default_rng(3), 2000, 100, 0.3
    wide_draws = np.array([[draws, 0.0, FREQUENT_REACH]])
    bound = Unseen.after(wide_draws, 3, FREQUENT_REACH, 0.0, filled).mode
    assert Unseen.after(wide_draws, 3, FREQUENT_REACH, 0.0).mode < bound / filled
    z = draw_wide(draws * trials, 3, generator, FREQUENT_REACH)
    in_mode = z[:, 0] > norm.isf(bound / filled)
    happened = in_mode & (generator.random(len(z)) < filled)
    missed, missed_if_filled = (~each.reshape(trials, draws).any(1) for each in (happened, in_mode))
    assert abs(missed.mean() - UNSEEN_ALPHA) < 5 * math.sqrt(UNSEEN_ALPHA / trials)
    assert missed_if_filled.mean() < UNSEEN_ALPHA / 10


@pytest.mark.parametrize(
    "wrong", [(0.0, 1.0), (1.0, -1.0), (1.0, math.inf), (1.0, 0.0, 0.0), (1.0, 0.0, 1.5)]
)
def test_certificates_that_mean_nothing_are_refused(wrong):
    with pytest.raises(InputError, match="expected share above 0"):
        Certificate(*wrong)


def test_an_event_found_at_its_far_end_has_not_converged():
    """After 60 draws of the whole wide law an event of 1e-20 is not certified; one of 1e-4 is."""
    wide_draws = np.array([[60.0, 0.0, REACH]])
    for probability, certified in ((1e-20, False), (1e-4, True)):
        unseen = Unseen.after(wide_draws, 3, reach_of(probability), BY_DEFAULT.curvature)
        assert (unseen.mode <= BY_DEFAULT.share * probability) == certified


def test_reach_of_a_probability():
    assert reach_of(1e-6) == pytest.approx(math.log(1e6) + 3)
    assert reach_of(0.0) == reach_of(1e-40) == REACH


def test_the_first_runs_for_frequent_events_exclude_what_those_for_rare_ones_leave_open():
    """Half-spaces with a probability of 5e-3 in three dimensions, by the first runs alone."""
    probability, reach = 5e-3, reach_of(5e-3)
    frequent, rare = [FREQUENT_START, 0.0, FREQUENT_REACH], [START, 0.0, REACH]
    bounds = [Unseen.after(np.array([draws]), 3, reach, 0.0).mode for draws in (frequent, rare)]
    assert bounds[0] <= probability < bounds[1]
    z = draw_wide(1000, 3, np.random.default_rng(1), FREQUENT_REACH)
    assert rarity(z).max() <= FREQUENT_REACH
    assert rarity(z).mean() == pytest.approx(FREQUENT_REACH / 2, abs=4 * FREQUENT_REACH / np.sqrt(12_000))


def test_the_first_runs_count_up_to_their_rarity():
    sampler = Sampler(3, np.random.default_rng(1), 20, fingerprint="x", frequent=True)
    for _ in range(2):
        z = sampler.ask()
        sampler.tell(np.zeros(20, bool), -z[:, 0])
    assert sampler.progress.wide_draws[:, 0].sum() == FREQUENT_START
    assert (sampler.progress.wide_draws[:, 2] == FREQUENT_REACH).all()
