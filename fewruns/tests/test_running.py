"""The loop over batches and the estimate for a function: against closed forms, and with each hook."""

import re
from dataclasses import replace

import numpy as np
import pytest
from fewruns import InputError, Sampler, Stopping, SystemProblem, estimate, run_batches
from fewruns.constants import FIRST_REPEATS
from sampler_checks import HALF_PLANE, STOPPING, half_plane, new_sampler, numbers
from sampler_checks import estimate as of_problem
from scipy import stats

INPUTS = [stats.norm(7, 1), stats.lognorm(0.3, scale=1.5)]


def fails(x):
    return x[:, 0] - x[:, 1] <= 0, x[:, 0] - x[:, 1]


def test_a_function_of_given_inputs_has_the_exact_probability():
    load = np.linspace(0.01, 20, 200_000)
    exact = np.trapezoid(INPUTS[0].cdf(load) * INPUTS[1].pdf(load), load)
    found = [estimate(fails, INPUTS, np.random.default_rng(seed)) for seed in range(4)]
    errors = [np.log(each.probability / exact) for each in found]
    assert all(each.converged for each in found)
    assert abs(np.mean(errors)) < 4 * 0.156 / 2  # the target of a single estimate is 0.156
    swapped = estimate(fails, INPUTS[::-1], np.random.default_rng(0))
    assert not 0.2 < swapped.probability / exact < 5


def test_the_newer_distributions_of_scipy_are_inputs():
    short, inputs = Stopping(maximum_simulations=60), [stats.Normal(mu=7, sigma=1), INPUTS[1]]
    newer, usual = (estimate(fails, laws, 1, stopping=short, deterministic=True) for laws in (inputs, INPUTS))
    assert newer.probability == pytest.approx(usual.probability, rel=1e-6)
    with pytest.raises(InputError, match="iccdf"):
        estimate(fails, [stats.norm, "normal"], 1)


def test_flags_alone_are_enough_and_a_number_of_inputs_stands_for_normal_ones():
    found = estimate(lambda z: z @ [0.6, 0.8] > 4, 2, np.random.default_rng(1))
    assert found.converged
    assert abs(np.log(found.probability / HALF_PLANE)) < 0.6
    assert found.diagnostics["repeats"] == FIRST_REPEATS  # nothing is stated about the function
    known = estimate(lambda z: z @ [0.6, 0.8] > 4, 2, np.random.default_rng(1), deterministic=True)
    assert known.diagnostics["repeats"] == 0


@pytest.mark.parametrize(
    ("answer", "seen"),
    [
        (lambda z: z[:, 0], "flags of the type float64"),
        (lambda z: (4 - z[:, 0], z[:, 0]), "flags of the type float64"),
        (lambda z: np.where(z[:, 0] > 4, np.nan, 0.0), "flags of the type float64"),  # a run without outcome
        (lambda z: np.where(z[:, 0] > 4, "1", "0"), "flags of the type <U1"),
        (lambda z: [None] * len(z), "flags of the type object"),
        (lambda z: (z[:, 0] > 4, z[:, 0].astype(str)), "and scores of the type <U"),
        (lambda z: (z[:, 0] > 4, z[:, 0], z[:, 1]), "the function: seen 3 values"),
        (lambda z: z[:1, 0] > 4, r"\(1,\) flags"),
    ],
)
def test_a_function_with_other_outcomes_is_refused(answer, seen):
    with pytest.raises(InputError, match=seen):
        estimate(answer, 2, np.random.default_rng(1))


@pytest.mark.parametrize(
    "rule",
    [
        {"alpha": 80},
        {"alpha": 0},
        {"beta": np.nan},
        {"beta": "0.2"},
        {"anytime": "yes"},
        {"maximum_simulations": np.nan},
    ],
    ids=str,
)
def test_a_stopping_rule_that_nothing_satisfies_is_refused(rule):
    with pytest.raises(InputError, match=next(iter(rule))):
        Stopping(**rule)


def test_a_function_may_change_its_points():
    def changes(x):
        x *= 2
        return x[:, 0] > 8, 8 - x[:, 0]

    found = estimate(changes, 2, np.random.default_rng(1), deterministic=True)
    assert numbers(found) == numbers(
        estimate(lambda x: (x[:, 0] > 4, 8 - 2 * x[:, 0]), 2, np.random.default_rng(1), deterministic=True)
    )


def test_a_problem_with_another_number_of_inputs_is_refused():
    with pytest.raises(InputError, match="seen points with 3 normal scores; expected 2"):
        next(run_batches(new_sampler(3), half_plane(), STOPPING))


def test_the_function_of_every_batch_may_be_followed_and_its_state_resumed(tmp_path):
    seen, path = [], tmp_path / "state.json"
    few = Stopping(minimum_events=1, maximum_simulations=60)
    options = {"fingerprint": "structure", "state_file": path}
    estimate(fails, INPUTS, np.random.default_rng(3), stopping=few, on_batch=seen.append, **options)
    assert [each.simulations for each in seen] == list(range(5, 65, 5))
    resumed = estimate(fails, INPUTS, np.random.default_rng(99), **options)
    whole = estimate(fails, INPUTS, np.random.default_rng(3))
    assert numbers(resumed) == numbers(whole)
    with pytest.raises(InputError, match="fingerprint 'structure'; expected 'other'"):
        estimate(fails, INPUTS, np.random.default_rng(3), state_file=path, fingerprint="other")


def test_the_loop_ends_when_its_own_criterion_and_the_certificate_are_met():
    rough, fine = new_sampler(), new_sampler()
    event, tight = half_plane(2.5), replace(STOPPING, beta=0.1)
    for _ in run_batches(rough, event, STOPPING, lambda: len(rough.progress.estimates) >= 2):
        pass
    for _ in run_batches(fine, event, tight):
        pass
    assert len(rough.progress.estimates) >= 2
    assert rough.is_settled()
    assert rough.simulations < fine.simulations
    assert numbers(fine.estimate(tight)) == numbers(of_problem(event, 0, tight, batch_size=10))


def test_the_loop_may_be_left_and_never_exceeds_the_limit():
    sampler = new_sampler()
    for count, _ in enumerate(run_batches(sampler, half_plane(), STOPPING)):
        if count == 2:
            break
    assert sampler.simulations == 30
    limited = new_sampler()
    assert len(list(run_batches(limited, half_plane(), replace(STOPPING, maximum_simulations=45)))) == 4
    assert limited.simulations == 40


class Stored:
    """A problem that stores its outcomes, so that only ``repeat`` runs the system again."""

    dimension, fingerprint, deterministic = 2, "stored", None

    def __init__(self):
        self.problem, self.repeated = half_plane(), 0

    def evaluate(self, z):
        return self.problem.evaluate(z)

    def repeat(self, z):
        self.repeated += len(z)
        return self.problem.evaluate(z)


def test_repetitions_run_the_system_again():
    stored = Stored()
    sampler = Sampler(2, np.random.default_rng(0), deterministic=None, enough_repeats=20, enough_draws=10)
    for _ in run_batches(sampler, stored, STOPPING):
        pass
    assert stored.repeated == len(sampler.progress.repeats) == 20
    assert len(sampler.progress.law_draws) == 10
    assert sampler.has_converged(STOPPING)


def test_a_problem_of_a_system_maps_normal_scores_to_its_inputs():
    problem = SystemProblem(fails, 2, INPUTS)
    z = np.array([[-8.0, 8.0], [0.0, 0.0]])
    x = problem.inputs(z)
    assert x[0] == pytest.approx([-1.0, 1.5 * np.exp(0.3 * 8)])
    assert x[1] == pytest.approx([7.0, 1.5])


CONSTANTS = [stats.norm(5, 0), stats.uniform(3, 0), stats.norm(np.nan, 1), stats.pareto(0.01)]


@pytest.mark.parametrize("law", CONSTANTS)
def test_an_input_without_finite_quantiles_is_refused_before_the_function_is_called(law):
    def never(x):
        raise AssertionError(x)

    with pytest.raises(
        InputError, match=r"distribution of input 2: seen the quantile (nan|inf) at .*constant"
    ):
        estimate(never, [stats.norm(7, 1), law], np.random.default_rng(1))


COUNTS = [stats.poisson(3), stats.poisson(4e4), stats.geom(0.3), stats.dlaplace(0.8), stats.nbinom(3, 0.4)]


@pytest.mark.parametrize("law", COUNTS)
def test_the_far_tail_of_a_discrete_input_is_that_of_its_survival_function(law):
    z = np.linspace(-11, 11.5, 151)  # as far as the sampler goes
    (x,) = SystemProblem(None, 1, [law]).inputs(z[:, None]).T
    assert np.all(np.diff(x) >= 0)
    upper, q = x[z > 8.3], stats.norm.sf(z[z > 8.3])
    assert (law.sf(upper) <= q * (1 + 1e-6)).all()
    assert (law.sf(upper - 1) > q * (1 - 1e-6)).all()  # the next smaller number is too small


def test_a_constant_and_a_discrete_input_are_points_of_the_function():
    """The event has the probability P(N > 15) P(Z > 2) for a count N and a normal Z."""
    seen = []

    def crowded(x):
        seen.append(x)
        return (x[:, 0] > 15) & (x[:, 1] > 2), np.maximum(15.5 - x[:, 0], 2 - x[:, 1])

    inputs = [stats.poisson(3), stats.norm(), stats.randint(3, 4)]
    found = estimate(crowded, inputs, np.random.default_rng(2), deterministic=True)
    points = np.concatenate(seen)
    assert np.isfinite(points).all()
    assert set(points[:, 2]) == {3}
    exact = stats.poisson.sf(15, 3) * stats.norm.sf(2)
    assert 0.5 < found.probability / exact < 2
    assert not 0.5 < found.probability / (exact * stats.norm.sf(2)) < 2  # of another event


def test_an_estimate_says_why_it_has_converged_and_what_is_excluded():
    found = estimate(lambda z: (z[:, 0] > 4, 4 - z[:, 0]), 2, 1, deterministic=True)
    assert found.converged
    assert found.reason == "the interval is narrow, and the certificate is met"
    assert "parts of the event with more than 0.5 times its probability" in found.excluded
    assert "smaller ones if the scores fall towards them at most 1.5 times as steeply" in found.excluded
    assert str(found).startswith(f"{found.probability:.3g} (80 % interval")
    few = estimate(lambda z: (z[:, 0] > 4, 4 - z[:, 0]), 2, 1)
    rate = 1 - 0.05 ** (1 / few.diagnostics["repeats"])
    assert f"other outcomes in more than {100 * rate:.2g} % of repeated runs" in few.excluded
    assert few.excluded.endswith(
        f"add {rate:.2g} to the probability, {rate / few.probability:.2g} times the estimate"
    )
    short = estimate(lambda z: (z[:, 0] > 4, 4 - z[:, 0]), 2, 1, stopping=Stopping(maximum_simulations=20))
    assert short.reason in (
        "no run has met the event",
        "too few batches have given an estimate that agrees with the one before",
    )
    assert short.excluded == "nothing, so that the event may have other parts"
    assert f"not converged ({short.reason})" in str(short)


def test_a_seed_is_a_generator_and_names_of_arguments_are_checked():
    def plane(z):
        return z[:, 0] > 2, 2 - z[:, 0]

    few = Stopping(maximum_simulations=40)
    found = estimate(plane, 2, 3, stopping=few)
    assert numbers(found) == numbers(estimate(plane, 2, np.random.default_rng(3), stopping=few))
    with pytest.raises(InputError, match="maximum_simulations: seen an unknown argument"):
        estimate(plane, 2, 3, maximum_simulations=100)
    with pytest.raises(InputError, match=r"expected \d+ flags and \d+ scores, each as an array of the shape"):
        estimate(lambda z: (z > 2, z), 2, 3)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"function": 3}, "function: seen 3; expected a function of points"),
        ({"inputs": True}, "inputs: seen True; expected a number of inputs"),
        ({"inputs": [stats.gamma]}, "; expected a number of inputs, or frozen distributions"),
        ({"inputs": 0}, "dimension: seen 0"),
        ({"inputs": [stats.norm(), "normal"]}, "normal"),
        ({"batch_size": 2.5}, "batch_size: seen 2.5"),
        ({"certificate": 0.5}, "certificate"),
        ({"state_file": "state.json"}, "fingerprint"),
        ({"state_file": "no/such/folder/state.json", "fingerprint": "a plane"}, "no/such/folder"),
        ({"generator": "1"}, "generator: seen '1'; expected a numpy.random.Generator or a seed"),
        ({"generator": True}, "expected a numpy.random.Generator or a seed"),
        ({"stopping": 500}, "stopping: seen 500; expected a rule such as"),
        ({"on_batch": 3}, "on_batch: seen 3; expected a function of an estimate"),
        ({"upper_set": "yes"}, "upper_set: seen 'yes'; expected True or False"),
        ({"frequent": 1}, "frequent: seen 1; expected True or False"),
        ({"enough_repeats": -3}, "enough_repeats: seen -3; expected a whole number, at least 0"),
        ({"enough_draws": 2.5}, "enough_draws: seen 2.5; expected a whole number, at least 0"),
        ({"predecessor": 3}, "predecessor: seen 3; expected a Predecessor or None"),
        ({"fingerprint": 3}, "fingerprint: seen 3; expected a text"),
        ({"function": lambda z: [[True], [True, False]]}, "the outcomes: seen flags of the type object"),
    ],
)
def test_wrong_arguments_are_named_before_a_run(wrong, message):
    calls = []

    def plane(z):
        calls.append(z)
        return z[:, 0] > 2, 2 - z[:, 0]

    usual = {
        "function": plane,
        "inputs": 2,
        "generator": np.int64(1),
        "stopping": Stopping(maximum_simulations=5),
    }
    assert estimate(**usual).simulations == len(calls.pop()) == 5
    with pytest.raises(InputError, match=re.escape(message)):
        estimate(**(usual | wrong))
    assert not calls


def test_the_loop_of_the_readme_ends_at_the_largest_number_of_simulations():
    """Also with a score of the wrong sign, with which the estimate never converges."""
    goal = Stopping(maximum_simulations=60)
    sampler = Sampler(2, np.random.default_rng(1), deterministic=True)
    while not sampler.is_done(goal):
        z = sampler.ask(certify=sampler.is_narrow(goal))
        sampler.tell(z[:, 0] > 4.2, z[:, 0] - 4.2)
    assert 55 <= sampler.simulations <= 60
    assert not sampler.has_converged(goal)
