"""Exact answers from scans of one variable: slices of laws, a toy with a closed form, and the left turn."""

from dataclasses import dataclass, replace
from pathlib import Path

import accelerated_evaluation as ae
import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.answer import by_scan
from accelerated_evaluation.answer.by_scan import exact_probability
from accelerated_evaluation.answer.posterior import Posterior
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.joint.copula import GaussianCopula, IndependentVariables
from accelerated_evaluation.laws.joint.kernel import KernelLaw
from accelerated_evaluation.laws.joint.truncated import log_interval_mass
from accelerated_evaluation.laws.joint.truncated_normals import TruncatedNormalMixture
from accelerated_evaluation.laws.protocol import SlicedLaw
from accelerated_evaluation.scenarios.outcomes import FLAG, outcome
from normal_law import normal_law
from scipy.stats import norm

ROOT = Path(__file__).parents[2]
BOX = ae.Box(("a", "b", "c"), (0.0, 0.0, 0.0), (10.0, 10.0, 10.0))
NODES, WEIGHTS = np.polynomial.legendre.leggauss(200)
LEFT_TURN = ae.SCENARIOS["left_turn"]


def fitted(kind, **settings):
    generator = np.random.default_rng(3)
    covariance = [[1, 0.6, 0.2], [0.6, 2, -0.5], [0.2, -0.5, 1.5]]
    x = generator.multivariate_normal([3, 4, 5], covariance, 80).clip(0.01, 9.99)
    return kind.fit(x, BOX, generator, **settings)


@pytest.mark.parametrize(
    ("kind", "settings"),
    [
        (GaussianCopula, {}),
        (IndependentVariables, {}),
        (TruncatedNormalMixture, {"components": 2}),
        (KernelLaw, {}),
    ],
)
def test_a_slice_is_the_integral_of_the_density(kind, settings):
    law, generator = fitted(kind, **settings), np.random.default_rng(4)
    assert isinstance(law, SlicedLaw)
    for k in range(3):
        x = law.draw(6, generator)
        low = np.append(0.0, generator.uniform(0, 5, 5))
        high = np.append(low[:5] + generator.uniform(0.1, 4, 5), 10.0)
        values = (high - low)[:, None] / 2 * NODES + (high + low)[:, None] / 2
        points = np.repeat(x, NODES.size, axis=0)
        points[:, k] = values.ravel()
        density = np.exp(law.log_density(points)).reshape(values.shape)
        integral = (density @ WEIGHTS) * (high - low) / 2
        assert law.log_slice(k, x, low, high) == pytest.approx(np.log(integral), abs=1e-6)
        x[:, k] = np.nan  # the variable itself is not used
        assert law.log_slice(k, x, low, high) == pytest.approx(np.log(integral), abs=1e-6)


def test_intervals_in_far_tails_keep_their_digits():
    low, high = np.array([30.0, -31.0, 9.0, 2.0]), np.array([31.0, -30.0, np.inf, 2.0])
    expected = [norm.logsf(30), norm.logcdf(-30), norm.logsf(9), -np.inf]
    assert log_interval_mass(low, high) == pytest.approx(expected, rel=1e-12)


@dataclass(frozen=True)
class Outcomes:
    crash: Array = outcome(FLAG, "whether")
    distance: Array = outcome("", "how near")


@dataclass
class Stripes:
    """A car that crashes for two stripes of b, whose place depends on a."""

    deterministic: bool | None = True

    def simulate(self, a, b):
        crash = ((b > a) & (b < a + 1)) | (b > 8)
        return Outcomes(crash, np.where(crash, 0.0, 1.0))


TOY = ae.Scenario(
    "stripes",
    "Two variables.",
    [ae.Variable(name, "", 0, 10, "") for name in "ab"],
    Outcomes,
    [ae.Event.flag("crash", scored_by="distance")],
    {},
    "none",
    scanned="b",
)
PLANE = ae.Box(("a", "b"), (0.0, 0.0), (10.0, 10.0))


def toy_problem(means, **changes):
    laws = [normal_law(mean, np.diag([1.0, 4.0]), PLANE) for mean in means]
    draws = ae.DrawnLaws.of(laws, ["toy"] * len(laws), np.random.default_rng(2))
    return ae.Problem(replace(TOY, **changes), Stripes()), draws


def exact(law):
    """Return the probability of the two stripes under a law with independent variables."""
    (mean,) = law.normals.mean
    a = np.linspace(0, 10, 4001)
    density = norm.pdf(a, mean[0], 1)

    def below(b):
        return norm.cdf(np.minimum(b, 10), mean[1], 2)

    union = below(a + 1) - below(a) + below(10) - below(8)
    union -= np.maximum(below(np.minimum(a + 1, 10)) - below(np.maximum(a, 8)), 0)
    whole = norm.cdf(10, mean[1], 2) - norm.cdf(0, mean[1], 2)
    return np.trapezoid(density * union, a) / np.trapezoid(density, a) / whole


def test_a_scan_gives_the_probability_of_two_stripes_under_every_draw(monkeypatch):
    problem, draws = toy_problem([(4.0, 5.0), (3.0, 4.0), (5.0, 7.0)])
    truth = np.array([exact(law) for law in draws.laws])
    answer = ae.evaluate(problem, draws, ae.Scan(1024, 60), generator=np.random.default_rng(5))
    deviation = (answer.posterior.probabilities / truth - 1) / answer.posterior.errors
    assert np.abs(deviation).max() < 5  # of 16 batches
    assert (answer.posterior.errors < 0.02).all()
    assert answer.crash_weights.sum(axis=1) == pytest.approx(answer.posterior.probabilities)
    monkeypatch.setattr(by_scan, "_stretches", one_step_wider(by_scan._stretches))
    wrong = ae.evaluate(problem, draws, ae.Scan(1024, 60), generator=np.random.default_rng(5))
    assert np.abs((wrong.posterior.probabilities / truth - 1) / wrong.posterior.errors).max() > 10


def one_step_wider(right):
    """Return a wrong variant, whose intervals begin a step of the scan too early."""

    def wrong(*arguments):
        found = right(*arguments)
        return replace(found, start=np.maximum(found.start - 10 / 59, 0))

    return wrong


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scanned": None}, "scenario stripes: seen no variable along which every event happens in a few"),
        ({}, "scan of b: seen a law of the class Without, without a method log_slice; expected laws that"),
        ({"deterministic": False}, "scan of b: seen a vehicle whose outcomes are random; expected"),
    ],
)
def test_what_a_scan_needs_is_said_with_another_way(changes, message):
    changes = dict(changes)
    deterministic = changes.pop("deterministic", True)
    problem, draws = toy_problem([(4.0, 5.0)], **changes)
    problem = replace(problem, vehicle=Stripes(deterministic))
    if not changes and deterministic:
        draws = replace(draws, parts=[ae.OneLaw(Without())])
    with pytest.raises(ae.InputError) as error:
        ae.evaluate(problem, draws, ae.Scan(), generator=np.random.default_rng(1))
    assert str(error.value).startswith(message)
    assert str(error.value).endswith("Use Simulations, or FewRuns for a slow vehicle.")


def test_the_judge_of_methods_is_the_scan_where_there_is_one():
    problem, draws = toy_problem([(4.0, 5.0)])
    probability, error = exact_probability(replace(problem, law=draws.laws[0]), np.random.default_rng(3))
    assert 0 < error < 0.01
    assert probability == pytest.approx(exact(draws.laws[0]), rel=5 * error)
    other, _ = toy_problem([(4.0, 5.0)], scanned=None)
    assert np.isnan(exact_probability(replace(other, law=draws.laws[0]), np.random.default_rng(3))).all()


class Without(ae.Law):
    """A law without slices."""

    from_normal_scores = log_density = content = from_content = None


def test_the_left_turn_agrees_with_its_many_simulations():
    """Three laws of different kinds are fitted to the records; both ways have the same draws."""
    records = pd.read_parquet(ROOT / LEFT_TURN.records)[list(LEFT_TURN.names)].to_numpy()[::4]
    limits, generator = LEFT_TURN.law_limits, np.random.default_rng(6)
    box = ae.Box(LEFT_TURN.names, tuple(limits[:, 0]), tuple(limits[:, 1]))
    x = LEFT_TURN.as_in_law(records)
    laws = [GaussianCopula.fit(x, box, generator), KernelLaw.fit(x, box, generator)]
    laws.append(TruncatedNormalMixture.fit(x, box, generator, components=2))
    draws = ae.DrawnLaws.of(laws, ["copula", "kernel", "normals"], generator)
    vehicle = ae.load_vehicle(LEFT_TURN.default_vehicle, LEFT_TURN)
    problem = ae.Problem(LEFT_TURN, vehicle)
    events = [LEFT_TURN.event("impact_speed", 5.0), LEFT_TURN.event("post_encroachment_time", 1.0)]
    scanned, many = (
        ae.evaluate(problem, draws, way, events, generator=np.random.default_rng(seed))
        for way, seed in ((ae.Scan(2048, 60), 7), (ae.Simulations(100_000), 8))
    )
    for event in (problem.event, *events):
        one, other = scanned.posteriors[event], many.posteriors[event]
        error = np.hypot(one.errors * one.probabilities, other.errors * other.probabilities)
        assert np.abs((one.probabilities - other.probabilities) / error).max() < 4, event
        assert (one.errors < 0.12).all(), event
    found = scanned.notes["found"][problem.event]
    counts = np.bincount(found.line, minlength=2048)
    assert np.mean(counts == 1) > 0.9  # most lines have a single interval


@pytest.fixture(scope="module")
def turns():
    """Problem, draws and law of the left turn."""
    problem = ae.Problem("left_turn", "acc_aeb")
    return problem, ae.choose_draws("independent_variables", ae.read_records("left_turn"))


def test_impact_speeds_of_crashes_are_those_of_the_event_above_them(turns):
    """Half of the crashes are above the median, in the probabilities of the two events."""
    problem, draws = turns
    found = {
        way: ae.evaluate(problem, draws, way, generator=1).impact_speeds().set_index("of")
        for way in (ae.Simulations(200_000), ae.Scan())
    }
    by_simulations, by_scan = (each["impact_speed_m_s"] for each in found.values())
    assert by_simulations.index.tolist() == ["mean", "q10", "q25", "q50", "q75", "q90"]
    assert by_simulations.iloc[1:].is_monotonic_increasing
    events = [f"impact_speed={speed:.12g}" for speed in by_simulations[["q25", "q50", "q90"]]]
    answer = ae.evaluate(problem, draws, ae.Simulations(200_000), events, generator=1)
    crash, *above = (each.probability for each in answer.posteriors.values())
    assert np.array(above) / crash == pytest.approx([0.75, 0.5, 0.1], abs=0.01)
    # The scan has a few impact speeds for each interval of distances, and the low quantiles are steep.
    assert by_scan.to_numpy() == pytest.approx(by_simulations.to_numpy(), rel=0.05, abs=0.3)


def test_impact_speeds_have_the_weights_of_each_draw(turns):
    problem, draws = turns
    speeds = np.array([[4.0, 2.0], [6.0, np.nan], [np.nan, np.nan]])
    weights = np.array([[2e-3, 1e-3, 0.0], [0.0, 4e-3, 1.0]])
    posterior = Posterior(weights.sum(axis=1), np.zeros(2, int))
    crashes = ae.Crashes(np.zeros((3, 3)), speeds, weights)
    answer = ae.Answer(problem, draws, {problem.event: posterior}, crashes)
    rows = answer.impact_speeds().set_index("of")
    # Under the first draw, speeds of 2, 4 and 6 m/s have a third of the weight; under the second only 6 m/s.
    assert rows.loc["mean"].tolist() == pytest.approx([(1 * 2 + 1 * 4 + 5 * 6) / 7, 4.05, 5.95])
    assert rows.loc["q10"].tolist() == pytest.approx([2, 2.1, 5.9])
    assert rows.loc["q50"].tolist() == pytest.approx([6, 4.05, 5.95])


@pytest.mark.parametrize(
    ("crashes", "seen"),
    [
        (None, "no crash"),
        (ae.Crashes(np.zeros((1, 3)), np.full((1, 1), np.nan), np.ones((1, 1))), "crashes without an impact"),
    ],
)
def test_impact_speeds_that_are_not_there_are_one_message(turns, crashes, seen):
    problem, draws = turns
    answer = ae.Answer(problem, draws, {problem.event: None}, crashes)
    with pytest.raises(ae.InputError, match=f"impact_speeds: seen {seen}"):
        answer.impact_speeds()
