"""The adaptive sampler against events of known probability, its two phases by hand, and its saved state."""

import json
import math
from dataclasses import dataclass

import numpy as np
import pytest
from accelerated_evaluation.errors import InputError
from accelerated_evaluation.sampling import two_phase
from accelerated_evaluation.sampling.rare_event import RareEvent
from accelerated_evaluation.sampling.surrogate_sampler import FORMAT, Sampler, Target, sample
from accelerated_evaluation.sampling.wide_laws import REACH, draw_wide
from scipy.stats import binom, norm, ttest_1samp

TARGET = Target()
HALF_PLANE = norm.sf(4.0)
TWO = norm.sf(4.0), norm.sf(4.3)


def standard_normal_event(margin, *, graded=True, dimension=2):
    """Return the event that a margin, a function of z, is negative."""

    def respond(z):
        score = margin(z)
        return score < 0, score if graded else None

    return RareEvent(dimension, lambda z: z, respond)


def half_plane(level=4.0, *, graded=True):
    return standard_normal_event(lambda z: level - z @ [0.6, 0.8], graded=graded)


def two_half_planes():
    """Return an event of two regions, the second of a fifth of the probability."""
    return standard_normal_event(lambda z: np.minimum(4.0 - z[:, 0], 4.3 + z[:, 1]))


def either():
    return TWO[0] + TWO[1] - TWO[0] * TWO[1]


@dataclass
class Course:
    """What a test keeps of a whole run: the result, the sampler, and two estimates that must be wrong."""

    result: object
    sampler: Sampler
    flags: float
    twice_controlled: float


def drive(sampler, event, target=TARGET):
    """Run a sampler to the end, as `sample` does."""
    flags, twice = [], []
    while not (result := sampler.result(target)).converged and result.calls < target.maximum_calls:
        z = sampler.ask()
        assert z.shape == (sampler.batch_size, sampler.z.shape[1])
        pending = sampler.state()["_pending"]
        happened, score = event.evaluate(z)
        sampler.tell(happened, score)
        if pending.get("usable"):
            flags.append(happened.mean())
            w, pi = np.array(pending["w"]), np.array(pending["pi"])
            twice.append(pending["controlled"] + (w * happened / pi).sum())
    return Course(result, sampler, np.mean(flags), np.mean(twice))


def courses(event, seeds, batch_size=10):
    return [
        drive(Sampler(event.dimension, np.random.default_rng(seed), batch_size), event)
        for seed in range(seeds)
    ]


def probabilities(of):
    return np.array([course.result.probability for course in of])


def is_unbiased(estimates, truth):
    """Whether Student's t test lets the mean be the truth; 1e-4 is 4 standard errors of many estimates."""
    return ttest_1samp(estimates, truth).pvalue > 1e-4


@pytest.fixture(scope="module")
def half_planes():
    return courses(half_plane(), 30)


def numbers(result):
    return result.probability, result.ci_low, result.ci_high, result.calls, result.converged


# ---- two phases


@pytest.fixture
def pool():
    """A pool of twelve points with flags that the surrogate does not foresee well."""
    generator = np.random.default_rng(3)
    z, w = generator.normal(size=(12, 2)), generator.lognormal(0, 1, 12)
    p, flags = generator.random(12), generator.random(12) < 0.5
    g = np.where(p > 0.3, p, 0.0)
    return z, w, p, g, flags


@dataclass
class Start:
    """A generator that returns a given start of the systematic sample."""

    u: float

    def random(self):
        return self.u


@pytest.mark.parametrize(("points", "n", "spread"), [(12, 4, 1.0), (2000, 10, 3.0), (2000, 300, 2.0)])
def test_inclusion_probabilities(points, n, spread):
    generator = np.random.default_rng(points + n)
    size = generator.lognormal(0, spread, points) * (generator.random(points) < 0.7)
    pi = two_phase.inclusion(size, n)
    assert pi.sum() == pytest.approx(n, rel=1e-12)
    assert pi.max() <= 1
    assert pi.min() >= two_phase.DEFENCE * n / points * (1 - 1e-12)
    defended = (1 - two_phase.DEFENCE) * size / size.sum() + two_phase.DEFENCE / points
    ratio = (pi / defended)[pi < 1]
    assert ratio == pytest.approx(ratio[0], rel=1e-12)
    assert two_phase.inclusion(np.zeros(points), n) == pytest.approx(n / points, rel=1e-12)


def test_some_points_are_certain():
    pi = two_phase.inclusion(np.array([100.0, 50.0, 1.0, 1.0, 1.0, 1.0]), 3)
    # without the defence: 1, 1 and a quarter of the third run for each
    assert pi == pytest.approx([1, 1, 0.25, 0.25, 0.25, 0.25], rel=1e-12)


def test_systematic_sample_includes_by_pi(pool):
    z, w, p, _, _ = pool
    pi = two_phase.inclusion(w * np.sqrt(p), 4)
    generator, draws = np.random.default_rng(1), 4000
    taken = np.zeros(12)
    for _ in range(draws):
        chosen = two_phase.systematic(z, w * p, pi, generator)
        assert len(set(chosen.tolist())) == 4
        taken[chosen] += 1
    allowed = 4.5 * np.sqrt(pi * (1 - pi) / draws) + 1e-9
    assert (abs(taken / draws - pi) <= allowed).all()
    assert (abs(taken / draws - pi[::-1]) > allowed).sum() > 6


def test_systematic_sample_is_spread_along_the_principal_axis():
    z = np.random.default_rng(2).normal(size=(1000, 2)) * [5.0, 0.5]
    chosen = two_phase.systematic(z, np.ones(1000), np.full(1000, 0.01), np.random.default_rng(3))
    rank = np.sort(z[:, 0].argsort().argsort()[chosen])
    # one run in each tenth of the axis, up to the little that it is turned against the first variable
    assert abs(rank - 100 * np.arange(10) - 50).max() < 65


def test_difference_estimator_is_exactly_unbiased(pool):
    """Over the starts the estimate is a step function with a jump a point: midpoints err by jumps / (2 K)."""
    z, w, p, g, flags = pool
    pi = two_phase.inclusion(w * np.sqrt(p), 4)
    starts = 2000

    def mean_estimate(pi_used, g_used, controlled):
        estimates = []
        for k in range(starts):
            chosen = two_phase.systematic(z, w * p, pi, Start((k + 0.5) / starts))
            batch = {"w": w[chosen] / 12, "g": g_used[chosen], "pi": pi_used[chosen]}
            batch |= {"controlled": controlled, "controlled_square": 0.0}
            batch |= {"weight": 1.0, "foretold": 1.0, "usable": True}
            estimates.append(two_phase.account(batch, flags[chosen])["estimate"])
        return np.mean(estimates), 12 * np.ptp(estimates) / (2 * starts)

    truth = (w * flags).mean()
    mean, error = mean_estimate(pi, g, (w @ g) / 12)
    assert error < 0.02 * truth
    assert abs(mean - truth) <= error
    for wrong in (
        (np.full(12, 4 / 12), g, (w @ g) / 12),
        (pi, g, 0.0),
        (pi, np.zeros(12), (w @ g) / 12),
    ):
        mean, error = mean_estimate(*wrong)
        assert abs(mean - truth) > 3 * error


def test_observed_variance_by_hand():
    batch = {"w": [0.1, 0.2], "g": [0.5, 0.0], "pi": [0.5, 0.25], "controlled": 0.3}
    batch |= {"controlled_square": 0.02, "weight": 2.0, "foretold": 0.1, "usable": True}
    kept = two_phase.account(batch, np.array([True, False]))
    # w (event - g) / pi: 0.1 * 0.5 / 0.5 = 0.1 and 0
    assert kept["estimate"] == pytest.approx(0.3 + 0.1)
    assert kept["observed"] == pytest.approx((0.02 + 0.1 * 0.1) + 0.1**2 * 0.5 * 2)
    assert {name: kept[name] for name in ("weight", "foretold", "usable")} == {
        "weight": 2.0, "foretold": 0.1, "usable": True,
    }  # fmt: skip


def test_aim_by_hand():
    w = np.array([9.0, 9.0, 9.0, 1.0, 1.0, 1.0])
    p, g, error = two_phase.aim(w, np.array([0.9, 0.1, 0.04, 0.04, 0.002, 0.0005]), 2.0)
    assert p.tolist() == [0.9, 0.1, 0.0, 0.04, 0.002, 0.0]
    assert g.tolist() == [0.9, 0.0, 0.0, 0.0, 0.0, 0.0]
    # E (1 - g)^2 p + g^2 (1 - p); without a control variate that is p
    assert error == pytest.approx([0.9 * 0.1**2 + 0.1 * 0.9**2, 0.1, 0.0, 0.04, 0.002, 0.0])


def test_foretold_variance_by_hand(pool):
    _, w, p, _, _ = pool
    p, g, error = two_phase.aim(w, p, 0.0)
    pi = two_phase.inclusion(w * np.sqrt(error + two_phase.FLOOR * p), 3)
    mean = sum(w * p) / 12
    second = sum(w[i] ** 2 * error[i] / pi[i] for i in range(12)) / 12**2
    first = (sum(w**2 * p) / 12 - mean**2) / 12
    believed, foretold = two_phase.foretell(w, p, g, error, 3, 12)
    assert believed == pytest.approx(mean)
    assert foretold == pytest.approx(3 * (second + first) / mean**2)
    # twice the runs out of a pool twice as large are worth the same each
    assert two_phase.foretell(w, p, g, error, 6, 24) == pytest.approx((mean, foretold))
    assert two_phase.foretell(w, 0 * p, g, error, 3, 12) == (0.0, two_phase.WORTHLESS)


# ---- estimates


def test_half_plane_is_estimated_without_bias(half_planes):
    estimates = probabilities(half_planes)
    assert is_unbiased(estimates, HALF_PLANE)
    assert (abs(np.log(estimates / HALF_PLANE)) < math.log(2)).all()
    assert not is_unbiased([course.flags for course in half_planes], HALF_PLANE)
    # without the control variate's share taken off the runs
    assert not is_unbiased([course.twice_controlled for course in half_planes], HALF_PLANE)


def test_half_plane_takes_few_simulations_and_is_covered(half_planes):
    results = [course.result for course in half_planes]
    assert all(result.converged and result.event_found for result in results)
    assert np.mean([result.calls for result in results]) < 300
    for result in results:
        half_width = (result.ci_high - result.ci_low) / 2
        assert result.probability == pytest.approx((result.ci_low + result.ci_high) / 2)
        assert half_width <= TARGET.half_width * result.probability * (1 + 1e-12)
    covered = sum(result.ci_low <= HALF_PLANE <= result.ci_high for result in results)
    assert covered >= binom.ppf(1e-3, len(results), 1 - TARGET.alpha)
    # the same intervals about 1.5 P would not do
    assert sum(result.ci_low <= 1.5 * HALF_PLANE <= result.ci_high for result in results) < 16


def test_the_smaller_of_two_regions_is_not_lost():
    of = courses(two_half_planes(), 12)
    estimates = probabilities(of)
    assert is_unbiased(estimates, either())
    assert not is_unbiased(estimates, TWO[0])
    assert (abs(np.log(estimates / either())) < math.log(2)).all()
    for course in of:
        z = course.sampler.z[course.sampler.event]
        assert (z[:, 0] > 4).any()
        assert (z[:, 1] < -4.3).any()


def test_flags_alone_are_enough():
    of = courses(half_plane(graded=False), 6)
    assert is_unbiased(probabilities(of), HALF_PLANE)
    assert (abs(np.log(probabilities(of) / HALF_PLANE)) < math.log(2)).all()
    assert all((course.sampler.score == 0).all() for course in of)


def test_batches_of_any_size():
    of = courses(half_plane(), 4, batch_size=25)
    assert is_unbiased(probabilities(of), HALF_PLANE)
    assert all(course.result.calls % 25 == 0 and course.result.converged for course in of)


def test_half_of_everything():
    of = courses(half_plane(0.0), 8)
    assert is_unbiased(probabilities(of), 0.5)
    assert (abs(probabilities(of) / 0.5 - 1) < 0.5).all()
    assert all(0 <= course.result.ci_low < course.result.ci_high <= 1 for course in of)


def test_event_everywhere():
    result = sample(half_plane(-99.0), Target(maximum_calls=60), np.random.default_rng(1))
    assert result.event_found
    assert not result.converged
    assert (result.ci_low, result.ci_high, result.calls) == (0.0, 1.0, 60)


@pytest.mark.parametrize("maximum", [0, 9, 27, 60])
def test_the_limit_of_calls_holds(maximum):
    calls = []
    event = standard_normal_event(lambda z: (calls.append(len(z)), 4.0 - z[:, 0])[1])
    result = sample(event, Target(maximum_calls=maximum), np.random.default_rng(1))
    assert result.calls == sum(calls) == maximum // 10 * 10
    assert not result.converged


# ---- no event


@pytest.mark.parametrize("graded", [True, False])
def test_without_an_event_there_is_a_bound(graded):
    event = half_plane(99.0, graded=graded)
    result = sample(event, Target(maximum_calls=50), np.random.default_rng(1))
    assert (result.probability, result.ci_low, result.calls) == (0.0, 0.0, 50)
    assert not result.event_found
    assert not result.converged
    assert 0 < result.ci_high <= 1


def test_the_bound_holds_and_shrinks():
    """Rarest seen by the wide law is an event about the origin: a ball, seen n times by none in alpha."""
    bounds = []
    for calls in (50, 100, 300):
        target = Target(alpha=0.1, maximum_calls=calls)
        result = sample(half_plane(99.0, graded=False), target, np.random.default_rng(1))
        bounds.append(result.ci_high)
        square = -2 * math.log1p(-result.ci_high)  # the ball of that probability, in two dimensions
        z = draw_wide(2000 * calls, 2, np.random.default_rng(2))
        missed = ~((z * z).sum(1) < square).reshape(2000, calls).any(1)
        assert abs(missed.mean() - 0.1) < 4 * math.sqrt(0.1 * 0.9 / 2000)
    assert bounds == sorted(bounds, reverse=True)
    assert bounds[0] > 0.9 > 0.4 > bounds[-1] > 0.1 ** (1 / 300) * 0.3
    assert bounds[-1] == pytest.approx(1 - math.exp(-REACH * (1 - 0.1 ** (1 / 300))))


# ---- state


def through_json(state):
    return json.loads(json.dumps(state, allow_nan=False))


@pytest.mark.parametrize("pending", [False, True])
@pytest.mark.parametrize("batches", [0, 1, 4, 11])
def test_an_interrupted_run_ends_like_a_whole_one(half_planes, batches, pending):
    whole, event = half_planes[0], half_plane()
    sampler = Sampler(2, np.random.default_rng(0))
    for _ in range(batches):
        sampler.tell(*event.evaluate(sampler.ask()))
    asked = sampler.ask().copy() if pending else None
    resumed = Sampler.resume(through_json(sampler.state()), dimension=2)
    if pending:
        np.testing.assert_array_equal(resumed.ask(), asked)
    again = drive(resumed, event)
    assert numbers(again.result) == numbers(whole.result)
    np.testing.assert_array_equal(again.sampler.z, whole.sampler.z)
    assert again.result.state == whole.result.state


def test_a_batch_is_asked_for_until_it_is_told():
    sampler = Sampler(3, np.random.default_rng(0), 7)
    first = sampler.ask().copy()
    assert first.shape == (7, 3)
    np.testing.assert_array_equal(sampler.ask(), first)
    sampler.tell(np.zeros(7, bool))
    assert (sampler.ask() != first).all()


@pytest.mark.parametrize(
    "told", [(np.zeros(9, bool),), (np.zeros((10, 1), bool),), (np.zeros(10, bool), np.zeros(9)), (True,)]
)
def test_other_shapes_are_refused(told):
    sampler = Sampler(2, np.random.default_rng(0))
    asked = sampler.ask()
    with pytest.raises(ValueError, match="10 simulations were asked for"):
        sampler.tell(*told)
    assert len(sampler.z) == 0
    np.testing.assert_array_equal(sampler.ask(), asked)


def test_same_seed_same_bytes(half_planes):
    results = [sample(half_plane(), TARGET, np.random.default_rng(seed)) for seed in (0, 0, 1)]
    first, again, other = (json.dumps(result.state) for result in results)
    assert first == again != other
    assert [numbers(result) for result in results[1:]] == [
        numbers(course.result) for course in half_planes[:2]
    ]


class Crash(Exception):  # noqa: N818
    """What interrupts a run."""


def test_nothing_is_simulated_twice(half_planes, tmp_path):
    simulated, told = [], []
    event = half_plane()
    counted = RareEvent(2, event.inputs, lambda x: (simulated.append(x), event.respond(x))[1])
    path = tmp_path / "state.json"

    def interrupt(result):
        told.append(result.calls)
        if result.calls == 60:
            raise Crash

    with pytest.raises(Crash):
        sample(counted, TARGET, np.random.default_rng(0), state_file=path, on_batch=interrupt)
    assert told == [10, 20, 30, 40, 50, 60]
    # the generator and the batch size given now are of no account
    result = sample(counted, TARGET, np.random.default_rng(99), 20, state_file=path)
    assert numbers(result) == numbers(half_planes[0].result)
    x = np.vstack(simulated)
    assert len(np.unique(x, axis=0)) == len(x) == result.calls
    again = sample(counted, TARGET, np.random.default_rng(7), state_file=path)
    assert numbers(again) == numbers(result)
    assert len(np.vstack(simulated)) == result.calls
    assert json.loads(path.read_text()) == result.state


def test_a_tighter_target_goes_on_from_the_state(tmp_path):
    path = tmp_path / "state.json"
    rough = sample(half_plane(), Target(half_width=0.4), np.random.default_rng(2), state_file=path)
    fine = sample(half_plane(), Target(half_width=0.1), np.random.default_rng(2), state_file=path)
    assert rough.calls < fine.calls
    assert fine.state["z"][: rough.calls] == rough.state["z"]
    assert fine.ci_high - fine.probability <= 0.1 * fine.probability * (1 + 1e-12)


@pytest.mark.parametrize("content", ["dimension", {"format": "something else"}, {}])
def test_states_of_other_problems_are_refused(tmp_path, content):
    path = tmp_path / "state.json"
    if content == "dimension":
        content = Sampler(3, np.random.default_rng(0)).state()
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match="2 variables") as error:
        sample(half_plane(), TARGET, np.random.default_rng(0), state_file=path)
    assert error.value.where == str(path)
    assert json.loads(path.read_text()) == content
    assert Sampler(2, np.random.default_rng(0)).state()["format"] == FORMAT


def test_a_pending_batch_does_not_tighten_the_bound():
    sampler = Sampler(2, np.random.default_rng(0), 500)
    before = sampler.result(TARGET).ci_high
    sampler.ask()
    assert sampler.result(TARGET).ci_high == before


def test_a_surrogate_that_expects_no_event_can_be_saved():
    nothing = np.zeros(50)
    believed, foretold = two_phase.foretell(np.ones(50), nothing, nothing, nothing, 10, 100)
    assert believed == 0
    json.dumps(foretold, allow_nan=False)
    assert foretold > 1e50


def test_a_score_of_minus_infinity_can_be_saved(tmp_path):
    event = standard_normal_event(lambda z: np.where(z[:, 0] > 4, -np.inf, 4.0 - z[:, 0]))
    result = sample(event, TARGET, np.random.default_rng(0), state_file=tmp_path / "state.json")
    assert result.converged


@pytest.mark.parametrize("text", ["[1, 2]", "no JSON", json.dumps({"format": FORMAT, "theta": [0, 0, 0]})])
def test_files_that_are_no_state_are_refused(tmp_path, text):
    path = tmp_path / "state.json"
    path.write_text(text)
    with pytest.raises(InputError):
        sample(half_plane(), TARGET, np.random.default_rng(0), state_file=path)


def test_an_event_seen_once_is_no_silent_zero():
    sampler = Sampler(5, np.random.default_rng(4))
    for batch in range(5):
        sampler.tell((np.arange(10) == 0) & (batch == 0))
        result = sampler.result(TARGET)
        assert result.event_found
        assert result.ci_high > 0
