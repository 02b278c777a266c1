"""The adaptive sampler against events of known probability, its two phases by hand, and its saved state."""

import json
import math
from dataclasses import dataclass

import numpy as np
import pytest
from accelerated_evaluation.errors import InputError
from accelerated_evaluation.methods.surrogate import two_phase
from accelerated_evaluation.methods.surrogate.sampler import FORMAT, Sampler, Target, sample
from accelerated_evaluation.methods.surrogate.wide_laws import REACH, draw_wide
from accelerated_evaluation.rare_event import RareEvent
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
    with pytest.raises(ValueError, match="asked for 10 simulations"):
        sampler.tell(*told)
    assert len(sampler.z) == 0
    np.testing.assert_array_equal(sampler.ask(), asked)


def test_a_score_that_is_no_number_is_refused():
    with pytest.raises(ValueError, match="not a number"):
        Sampler(2, np.random.default_rng(0)).tell(np.zeros(10, bool), np.full(10, np.nan))


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
