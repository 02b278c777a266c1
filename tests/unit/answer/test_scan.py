"""Exact answers from scans of one variable: slices of laws, a toy with a closed form, and the left turn."""

from dataclasses import dataclass, replace
from pathlib import Path

import accelerated_evaluation as ae
import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.answer.ways import by_scan
from accelerated_evaluation.answer.ways.by_scan import exact_probability
from accelerated_evaluation.answer.ways.posterior import Posterior
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map import intervals
from accelerated_evaluation.laws.distributions import Empirical
from accelerated_evaluation.laws.joint.copula import GaussianCopula, IndependentVariables
from accelerated_evaluation.laws.joint.kernel import KernelLaw
from accelerated_evaluation.laws.joint.truncated import log_interval_mass
from accelerated_evaluation.laws.joint.truncated_normals import TruncatedNormalMixture
from accelerated_evaluation.laws.lead_speeds import WithLeadSpeeds
from accelerated_evaluation.laws.mixed import MixedLaws
from accelerated_evaluation.laws.protocol import SlicedLaw, density_over
from accelerated_evaluation.scenarios.outcomes import FLAG, outcome
from mean_law import braking_probabilities, encounters_, law_, one_draw  # noqa: F401
from normal_law import normal_law
from scipy.stats import norm
from wall_car import RANGE_LAWS, TTC_LAWS, WallCar, integral, law_of

ROOT = Path(__file__).parents[3]
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
    monkeypatch.setattr(by_scan, "intervals_on", one_step_wider(by_scan.intervals_on))
    wrong = ae.evaluate(problem, draws, ae.Scan(1024, 60), generator=np.random.default_rng(5))
    assert np.abs((wrong.posterior.probabilities / truth - 1) / wrong.posterior.errors).max() > 10


def one_step_wider(right):
    """Return a wrong variant, whose intervals begin a step of the scan too early."""

    def wrong(*arguments):
        found = right(*arguments)
        return {
            event: replace(each, start=np.maximum(each.start - 10 / 59, 0)) for event, each in found.items()
        }

    return wrong


@dataclass
class OneSide:
    """A car that crashes on one side of a limit of a, or in many narrow stripes of b, deterministically."""

    limit: float = 10.0
    width: float = 0.0  # of the stripes, of which three tenths are crashes
    deterministic = True

    def simulate(self, a, b):
        crash = (a > self.limit) & (b > 5)
        if self.width:
            crash = b % self.width < 0.3 * self.width
        return Outcomes(crash, np.where(crash, 0.0, 1.0))


def estimated(vehicle, law, seeds, size=512):
    """Return the probability, its error, and the ends of the 80 % interval, from scans with several seeds."""
    problem, draws = ae.Problem(TOY, vehicle), ae.OneLaw(law)
    found = [
        ae.evaluate(problem, draws, ae.Scan(size, 40), generator=np.random.default_rng(seed)).posterior
        for seed in range(seeds)
    ]
    rows = [
        (0.0,) * 4 if one is None else (one.probabilities[0], one.errors[0], *one.whole.interval(0.8))
        for one in found
    ]
    return np.array(rows).T


def test_lines_that_the_law_rarely_has_are_met(monkeypatch):
    """The crashes are on lines with a score above 4.5, of which a law has one in 300,000."""
    law, seeds = normal_law((4.0, 5.0), np.diag([1.0, 4.0]), PLANE), 30
    above, whole = norm.sf([4.5, 6.0, -4.0]), norm.cdf(2.5) - norm.cdf(-2.5)
    truth = (above[0] - above[1]) / (above[2] - above[1]) * 0.5  # half of the values of b are above 5
    assert whole > 0.98  # the law of b is symmetric within its limits
    found, errors, low, high = estimated(OneSide(8.5), law, seeds, 2048)
    assert found.mean() == pytest.approx(truth, abs=4 * found.std(ddof=1) / seeds**0.5)
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(found.std(ddof=1) / truth, rel=0.5)
    assert ((low < truth) & (truth < high)).sum() >= 16
    monkeypatch.setattr(by_scan, "WIDE", 10**9)  # a wrong variant, without wide lines
    assert estimated(OneSide(8.5), law, seeds, 2048)[0].mean() < truth / 10


def test_intervals_of_a_scan_cover_as_often_as_they_say(monkeypatch):
    law = normal_law((4.0, 5.0), np.diag([1.0, 4.0]), PLANE)
    truth = exact(law)
    _, _, low, high = estimated(Stripes(), law, 30)
    assert 18 <= ((low < truth) & (truth < high)).sum() <= 29  # 24 are expected, with a deviation of 2.2
    weights = by_scan._scores

    def without_weights(*arguments):
        """A wrong variant, which takes all lines for lines of the law."""
        scores, log_weight = weights(*arguments)
        return scores, 0 * log_weight

    monkeypatch.setattr(by_scan, "_scores", without_weights)
    _, _, low, high = estimated(Stripes(), law, 30)
    assert ((low < truth) & (truth < high)).sum() < 15


def test_ends_of_many_narrow_stripes_are_not_refined(monkeypatch):
    """Bisection makes what prevails prevail even more: two cells of 0.7 give 0.784, and not 0.7."""
    law = normal_law((4.0, 5.0), np.diag([1.0, 4.0]), PLANE)
    vehicle = OneSide(width=0.0137)  # far less than the distance of two points, 10 / 39
    found, errors, *_ = estimated(vehicle, law, 8)
    assert found.mean() == pytest.approx(0.3, abs=4 * found.std(ddof=1) / 8**0.5)
    assert (errors < 0.05).all()
    monkeypatch.setattr(intervals, "CLEAN", 10**6)
    assert estimated(vehicle, law, 8)[0].mean() < 0.24


@pytest.mark.parametrize(("range_", "ttc"), [("pareto", "pieces"), ("pieces", "exponential")])
def test_the_scan_of_a_paper_law_gives_the_integral(range_, ttc):
    car, factors = WallCar(), (RANGE_LAWS[range_], TTC_LAWS[ttc])
    law, truth = law_of(*factors, cap=60.0), integral(*factors, (car.first, *car.hole))
    found = ae.evaluate(ae.Problem("cut_in", car), law, ae.Scan(1024, 500), generator=1).posterior
    assert found.errors[0] < 0.05
    assert found.probabilities[0] == pytest.approx(truth, rel=5 * found.errors[0])
    wrong = ae.evaluate(ae.Problem("cut_in", WallCar(hole=(99, 99))), law, ae.Scan(1024, 500), generator=1)
    assert wrong.posterior.probability > truth * (1 + 5 * found.errors[0])


class HardBraking:
    """Crashes if the constant deceleration that it needs exceeds 4 m/s^2."""

    deterministic = True

    def simulate(self, lead_speed, range_, closing_speed):
        crash = closing_speed**2 / (2 * range_) > 4.0
        gap = np.where(crash, 0.0, range_)
        return ae.Outcomes(crash, gap, np.ones(len(gap)), np.where(crash, closing_speed, 0.0))


def test_the_scan_of_a_mean_law_gives_each_draw_and_the_mean(law):
    few = law.thinned(8)
    problem, truth = ae.Problem("cut_in", HardBraking()), braking_probabilities(few, 4.0)
    for draws, known in ((few, truth), (ae.OneLaw(few), truth.mean())):
        found = ae.evaluate(problem, draws, ae.Scan(4096, 60), generator=2).posterior
        assert (found.errors < 0.2).all()
        assert np.abs((found.probabilities / known - 1) / found.errors).max() < 5
    assert np.abs((found.probabilities / truth - 1) / found.errors).max() > 10  # the draws differ


def test_a_slice_up_to_the_cap_has_the_probability_of_the_cap(law):
    cap, generator = 6.0, np.random.default_rng(4)
    box = ae.Box(("range", "closing_speed"), (0.0, 0.0), (60.0, 40.0))
    sides = normal_law((30.0, 4.0), np.diag([100.0, 9.0]), box)
    mean = replace(law.thinned(4), closing_speed_max=cap)
    laws = [mean, *(one_draw(mean, k, cap) for k in range(4))]
    laws.append(WithLeadSpeeds(sides, Empirical(np.array([10.0, 20.0])), cap))
    x = np.column_stack([np.full(5, 12.0), generator.uniform(2, 50, 5), np.full(5, np.nan)])
    low, inner, at_cap = np.full(5, 3.1), np.full(5, 3.1001), np.column_stack([x[:, :2], np.full(5, cap)])
    laws.append(MixedLaws(laws[-2:], np.array([0.3, 0.7])))
    for each in laws:
        whole, first = (np.exp(each.log_slice(2, x, low, end)) for end in (np.full(5, 1e9), inner))
        assert first == pytest.approx(density_over(each, 2, x, low, inner), rel=1e-6)
        body = np.exp(each.log_slice(2, x, inner, np.full(5, cap - 1e-9)))
        assert whole - first - body == pytest.approx(np.exp(each.log_density(at_cap)), rel=1e-6)
        assert np.isneginf(each.log_slice(2, x, np.full(5, cap + 0.1), np.full(5, 50.0))).all()
    rows = [each.log_slice(2, x, low, inner) for each in laws[1:5]]
    assert mean.log_slices(2, x, low, inner) == pytest.approx(np.array(rows), abs=1e-9)
    with pytest.raises(ae.InputError, match="argument k: seen 1, the variable range; expected 2"):
        mean.log_slice(1, x, low, inner)


def test_a_law_without_limits_is_not_scanned():
    """The closing speeds of the paper's laws have no upper limit unless there is a cap."""
    law = law_of(RANGE_LAWS["exponential"], TTC_LAWS["exponential"])
    with pytest.raises(ae.InputError, match="scan of closing_speed: seen a law with the limits 0 and inf"):
        ae.evaluate(ae.Problem("cut_in", "acc_aeb"), law, ae.Scan(), generator=1)


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
    records = pd.read_parquet(ROOT / LEFT_TURN.records.file)[list(LEFT_TURN.names)].to_numpy()[::4]
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
    assert np.mean(counts == 1) > 0.8  # most lines have a single interval


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
        for way in (ae.Simulations(200_000), ae.Scan(16384))
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
