"""The search for f*: updates against brute force, events, and vehicles whose crash probability is known."""

import dataclasses
import json
import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.configuration import load
from accelerated_evaluation.distributions import (
    BoundedExponential,
    BoundedNormal,
    Empirical,
    Mixture,
    PiecewiseMixture,
)
from accelerated_evaluation.errors import ConvergenceError, InputError
from accelerated_evaluation.laws import CutIns, Factors
from accelerated_evaluation.laws.independent import IndependentLaw
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.cross_entropy import search as cross_entropy
from accelerated_evaluation.methods.cross_entropy.families import (
    PiecewiseFamily,
    SingleFamily,
    bounded_weights,
)
from accelerated_evaluation.methods.cross_entropy.method import CrossEntropyMethod
from accelerated_evaluation.methods.cross_entropy.proposals import Proposals, read_proposals, write_proposals
from accelerated_evaluation.methods.cross_entropy.search import Settings, event_score, search
from accelerated_evaluation.problem import Problem, Sample
from accelerated_evaluation.vehicles import AccAeb, Outcomes
from scipy.optimize import minimize

SETTINGS = load()
CONFIG = SETTINGS["cross_entropy"]
PAPERS = [name for name, method in METHODS.items() if issubclass(method, CrossEntropyMethod)]
BODY = Mixture((0.2, 0.8), (BoundedNormal(0.037, 0.0, 0.166), BoundedNormal(0.0885, 0.0, 0.166)))
F = Factors(
    PiecewiseMixture(
        (0.83, 0.17), (BoundedExponential(107.0, 1 / 75, 0.037), BoundedExponential(43.0, 0.037))
    ),
    PiecewiseMixture((0.95, 0.05), (BODY, BoundedExponential(21.0, 0.166))),
)


@dataclass(frozen=True)
class Toy:
    """A vehicle that crashes if and only if R^-1 and TTC^-1 are both above their thresholds."""

    inverse_range: float = 0.0
    inverse_ttc: float = 0.0

    def simulate(self, lead_speed, range_, closing_speed):
        missing = np.zeros(range_.size)
        for threshold, value in (
            (self.inverse_range, 1 / range_),
            (self.inverse_ttc, closing_speed / range_),
        ):
            missing = np.maximum(missing, threshold - value)
        crash = missing == 0
        return Outcomes(
            crash, np.where(crash, 0.0, range_), np.where(crash, np.inf, missing), np.zeros(range_.size)
        )


def toy(inverse_range, inverse_ttc):
    """Return cut-ins before a vehicle whose thresholds, if there are any, have these tail probabilities."""
    thresholds = [
        0.0 if tail is None else float(law.isf(tail))
        for law, tail in ((F.first, inverse_range), (F.second, inverse_ttc))
    ]
    return before(Toy(*thresholds))


def before(vehicle, cap=math.inf):
    """Return the problem of a vehicle before cut-ins of one segment, all at 20 m/s."""
    law = IndependentLaw("toy", {"all": 1}, F.first, {"all": F.second}, {"all": Empirical([20.0])}, cap)
    return Problem(law, vehicle)


def families(method):
    make = SingleFamily.start if method == "single" else lambda law: PiecewiseFamily.start(law, 0.01, 5)
    return make(F.first), make(F.second)


def found(method, problem, seed, **changes):
    rows = []
    generator = np.random.default_rng(seed)
    configured = METHODS[method].configured(SETTINGS | {"cross_entropy": CONFIG | changes})
    (stratum,) = problem.law.strata
    result = configured.search(problem, stratum, generator, rows.append)
    assert rows == result.trace
    return result


def weighted_likelihood(law, x, weight):
    return float((weight * law.logpdf(x)).sum())


@pytest.fixture
def events():
    """Events of one variable with weights of any size, most of them in the tail piece."""
    generator = np.random.default_rng(5)
    x = np.concatenate([generator.uniform(0.05, 0.16, 40), 0.3 + generator.exponential(0.1, 60)])
    return x, generator.exponential(1.0, 100) ** 3


def test_single_update_maximizes_the_weighted_likelihood(events):
    family = SingleFamily.start(F.second)
    assert family.distribution.mean() == pytest.approx(F.second.mean())
    best = family.update(*events)
    brute = minimize(lambda p: -weighted_likelihood(BoundedExponential(math.exp(p[0])), *events), [1.0])
    assert best.parameters() == {"rate": best.distribution.rate}
    assert best.distribution.rate == pytest.approx(math.exp(brute.x[0]), rel=1e-4)
    assert weighted_likelihood(best.distribution, *events) >= -brute.fun


def test_piecewise_update_maximizes_the_weighted_likelihood(events):
    best = PiecewiseFamily.start(F.second, 0.01, 5).update(*events)

    def loss(parameters):
        share = 1 / (1 + math.exp(-parameters[0]))
        tilts = parameters[1], 21 - math.exp(parameters[2])
        return -weighted_likelihood(F.second.accelerated(tilts, (share, 1 - share)), *events)

    brute = minimize(loss, [0.0, 0.0, 3.0], method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-9})
    assert weighted_likelihood(best.distribution, *events) == pytest.approx(-brute.fun, abs=1e-6)
    assert best.thetas == pytest.approx((brute.x[1], 21 - math.exp(brute.x[2])), rel=1e-3)
    assert best.weights[0] == pytest.approx(1 / (1 + math.exp(-brute.x[0])), rel=1e-4)
    unweighted = PiecewiseFamily.start(F.second, 0.01, 5).update(events[0], np.ones(100))
    assert weighted_likelihood(unweighted.distribution, *events) < -brute.fun - 1e-3


@pytest.mark.parametrize("light", [0.0, 5e-324, 1e-320])
def test_pieces_without_events_keep_theta(light):
    family = dataclasses.replace(PiecewiseFamily.start(F.second, 0.01, 5), thetas=(7.0, 1.0))
    x = np.array([0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.3, 0.4, 0.5, 0.6, 0.7])
    few = family.update(x[2:], np.ones(9))  # four events in the body
    assert few.thetas[0] == 7.0
    assert few.thetas[1] == pytest.approx(21 - 1 / (0.5 - 0.166))
    lost = family.update(x, np.where(x < 0.166, light, 1.0))  # six, but their weights underflow
    assert lost.thetas == few.thetas
    assert lost.weights == pytest.approx((0.01, 0.99))
    assert family.update(x[:6], np.ones(6)).thetas[1] == 1.0


def test_needles_at_the_edge_of_a_bounded_piece_are_blunted():
    family = PiecewiseFamily.start(F.second, 0.01, 5)
    for edge, mean in ((1e-6, 0.02 * 0.166), (0.166 - 1e-6, 0.98 * 0.166)):
        body = family.update(np.full(9, edge), np.ones(9)).distribution.components[0]
        assert body.mean() == pytest.approx(mean)


def test_the_tail_of_f_star_is_never_lighter_than_that_of_f():
    family = PiecewiseFamily.start(F.second, 0.01, 5)
    near, far = (
        family.update(np.full(9, x), np.ones(9)).distribution.components[1].rate for x in (0.17, 0.6)
    )
    assert near == 21  # nine events next to the knot ask for a rate of 250
    assert far == pytest.approx(1 / (0.6 - 0.166))


@pytest.mark.parametrize(
    "shares", [(0.2, 0.3, 0.5), (0.0, 0.0, 1.0), (0.06, 0.9, 0.04), (0.11, 0.8, 0.09), (1 / 3,) * 3]
)
@pytest.mark.parametrize("minimum", [0.01, 0.1, 0.33])
def test_bounded_weights_are_the_best_of_all_that_are_allowed(shares, minimum):
    shares = np.array(shares)
    weights = np.array(bounded_weights(shares, minimum))
    assert weights.sum() == pytest.approx(1, rel=1e-15)
    assert weights.min() >= minimum
    assert np.all(np.diff(weights[np.argsort(shares)]) >= -1e-15)
    grid = np.linspace(minimum, 1 - 2 * minimum, 201)
    first, second = (part.ravel() for part in np.meshgrid(grid, grid))
    allowed = np.stack([first, second, 1 - first - second])[:, 1 - first - second >= minimum]
    assert shares @ np.log(weights) >= (shares @ np.log(allowed)).max() - 1e-12


@pytest.mark.parametrize(("size", "minimum"), [(3, 0.34), (2, 0.5), (2, 0.7), (2, 0.0), (2, math.nan)])
def test_weights_that_cannot_be_are_refused(size, minimum):
    with pytest.raises(ValueError, match=f"{size} weights cannot all be at least"):
        bounded_weights(np.full(size, 1 / size), minimum)


def outcomes_of(crash, min_range, min_ttc):
    crash, nothing = np.asarray(crash), np.zeros(len(crash))
    outcomes = Outcomes(crash, np.asarray(min_range), np.asarray(min_ttc), nothing)
    return Sample(nothing, nothing, nothing, crash, outcomes)


def test_event_score_is_the_threshold_of_nested_events():
    generator = np.random.default_rng(2)
    crash = generator.random(500) < 0.1
    min_range = np.where(crash, -1.0, generator.exponential(5.0, 500))
    min_ttc = np.where(generator.random(500) < 0.1, np.inf, generator.exponential(2.0, 500))
    score = event_score(outcomes_of(crash, min_range, min_ttc), 0.5)
    last = np.ones(500, dtype=bool)
    for threshold in (100.0, 5.0, 1.0, 0.2, 0.01, 0.0):
        event = crash | (min_range <= 0.5 * threshold) | (min_ttc <= threshold)
        np.testing.assert_array_equal(score <= threshold, event)
        assert np.all(last[event])
        last = event
    np.testing.assert_array_equal(last, crash)


def test_samples_join_and_weigh_crashes_alone():
    problem, generator = toy(None, 0.01), np.random.default_rng(1)
    parts = [problem.sample("all", F, generator, size) for size in (3, 500)]
    whole = parts[0].join(parts[1])
    assert whole.first.shape == whole.outcomes.crash.shape == (503,)
    for name in ("first", "second", "happened"):
        for place, part in zip((slice(3), slice(3, None)), parts, strict=True):
            np.testing.assert_array_equal(getattr(whole, name)[place], getattr(part, name))
    np.testing.assert_array_equal(whole.outcomes.min_ttc[:3], parts[0].outcomes.min_ttc)
    np.testing.assert_array_equal(whole.log_ratio, 0)
    np.testing.assert_array_equal(whole.happened, whole.outcomes.crash)
    np.testing.assert_array_equal(whole.weight, whole.outcomes.crash)
    assert 0 < whole.happened.sum() < 30


def test_closing_speeds_are_capped():
    class Recorder:
        def simulate(self, *inputs):
            self.seen = np.array(inputs)
            return Toy().simulate(*inputs)

    recorder = Recorder()
    cut_ins = CutIns(np.array([20.0, 30.0]), np.array([0.1, 0.01]), np.array([0.5, 0.5]))
    before(recorder, cap=23.49).simulate(cut_ins)
    np.testing.assert_allclose(recorder.seen, [[20, 30], [10, 100], [5, 23.49]], rtol=1e-15)


def accelerated(law, thetas, shift=0.0):
    family = dataclasses.replace(PiecewiseFamily.start(law, 0.01, 5), thetas=thetas, weights=(0.3, 0.7))
    return family.shifted(shift).distribution


@pytest.mark.parametrize(
    "f_star",
    [
        F,
        Factors(BoundedExponential(35.0, 1 / 75), BoundedExponential(12.0)),
        Factors(accelerated(F.first, (-50.0, 10.0)), accelerated(F.second, (8.0, 15.0))),
        Factors(accelerated(F.first, (90.0, 10.0), 0.01), accelerated(F.second, (8.0, 10.0), 0.05)),
    ],
    ids=["f", "single", "piecewise", "heuristic"],
)
def test_likelihood_ratios_average_to_one(f_star):
    size = 20_000
    sample = toy(None, None).sample("all", f_star, np.random.default_rng(3), size)
    ratio = np.exp(sample.log_ratio)
    assert ratio.mean() == pytest.approx(1, abs=4 * ratio.std() / math.sqrt(size) + 1e-14)
    assert ratio.std() < 10
    if f_star != F:
        half = np.exp(0.5 * sample.log_ratio)  # a wrong ratio
        assert abs(half.mean() - 1) > 4 * half.std() / math.sqrt(size)


@pytest.mark.parametrize("method", PAPERS)
@pytest.mark.parametrize(
    ("inverse_range", "inverse_ttc"),
    [(None, 1e-3), (None, 1e-6), (None, 1e-12), (1e-6, None), (1e-3, 1e-3), (1e-6, 1e-6)],
)
def test_known_probabilities_are_found(method, inverse_range, inverse_ttc):
    problem = toy(inverse_range, inverse_ttc)
    truth = (inverse_range or 1.0) * (inverse_ttc or 1.0)
    result = found(method, problem, 11)
    sample = problem.sample("all", result.proposal, np.random.default_rng(12), 20_000)
    weight = sample.weight
    assert sample.outcomes.crash.mean() > 0.05
    assert weight.mean() == pytest.approx(truth, rel=0, abs=4 * weight.std() / math.sqrt(weight.size))
    assert weight.std() / math.sqrt(weight.size) < 0.15 * truth
    share = sample.outcomes.crash.mean()
    assert abs(share - truth) > 4 * math.sqrt(share / weight.size)  # the estimator that forgets the weights


@pytest.mark.parametrize("method", PAPERS)
def test_the_trace_keeps_the_books(method):
    result = found(method, toy(1e-2, 1e-6), 3, minimum_events=300)
    trace = pd.DataFrame(result.trace)
    assert trace["iteration"].tolist() == list(range(1, len(trace) + 1))
    assert math.isnan(trace["threshold_ttc_s"][0])
    assert trace["simulations_total"][0] == 0
    steps = trace[1:]
    assert np.all(steps["threshold_ttc_s"].diff().dropna() <= 0)
    assert np.all(steps["threshold_range_m"] == steps["threshold_ttc_s"] * CONFIG["range_per_ttc"])
    assert np.all(steps["threshold_ttc_s"][-CONFIG["crash_iterations"] :] == 0)
    assert np.all(steps["simulations_total"] == steps["simulations"].cumsum())
    assert result.simulations == steps["simulations"].sum()
    assert np.all(steps["simulations"] % CONFIG["sample_size"] == 0)
    assert np.all(steps["simulations"] <= CONFIG["sample_size"] * CONFIG["maximum_batches"])
    assert steps["simulations"].min() < steps["simulations"].max()
    assert np.all(steps["events"] >= np.maximum(steps["crashes"], 100))
    assert np.all(
        steps["events"][steps["threshold_ttc_s"] == 0] == steps["crashes"][steps["threshold_ttc_s"] == 0]
    )
    assert np.all(
        (steps["effective_sample_size"] >= 1 - 1e-12)
        & (steps["effective_sample_size"] <= steps["events"] * (1 + 1e-12))
    )
    parameters = result.first.parameters(), result.second.parameters()
    for variable, values in zip(("inverse_range", "inverse_ttc"), parameters, strict=True):
        for name, value in values.items():
            assert trace[f"{variable}_{name}"].iloc[-1] == value
    assert sum(len(values) for values in parameters) == (2 if method == "single" else 12)


@pytest.mark.parametrize("method", PAPERS)
def test_the_generator_alone_decides(method):
    first, again, other = (found(method, toy(None, 1e-4), seed) for seed in (1, 1, 2))
    pd.testing.assert_frame_equal(pd.DataFrame(first.trace), pd.DataFrame(again.trace), check_exact=True)
    assert first.proposal == again.proposal != other.proposal


def test_heuristic_moves_truncation_points_but_never_past_an_event():
    problem = toy(None, 1e-9)
    threshold = problem.vehicle.inverse_ttc
    plain, moved = found("piecewise", problem, 4), found("heuristic", problem, 4)
    knots = [row["inverse_ttc_from_2"] for row in moved.trace]
    assert {row["inverse_ttc_from_2"] for row in plain.trace} == {0.166}
    assert np.all(np.diff(knots) >= 0)
    assert 0.166 < knots[-1] < threshold
    assert {row["inverse_ttc_from_1"] for row in moved.trace} == {0.0}

    full = PiecewiseFamily.start(F.second, 0.01, 5).update(np.full(9, 1.0), np.ones(9))
    for lowest in (0.166 + 1e-9, 0.265, 0.267, 0.5, 0.9123):
        family, last = full, None
        while family != last:
            last, family = family, cross_entropy._shifted(family, 0.05, np.array([1.0, lowest]))
        assert family.model.knots[0] <= max(lowest - 0.05, 0.166)
        assert family.model.knots[0] > lowest - 0.1 - 1e-9
    half = full.update(np.array([0.1] * 9 + [1.0] * 9), np.ones(18))
    assert cross_entropy._shifted(half, 0.05, np.array([1.0])) is half
    assert cross_entropy._shifted(full, 0.0, np.array([1.0])) is full


class Fading(Toy):
    """Crashes in every encounter of its first batch, and then never."""

    def simulate(self, lead_speed, range_, closing_speed):
        outcomes = Toy(inverse_ttc=1e9 if hasattr(self, "was_called") else 0.0).simulate(
            lead_speed, range_, closing_speed
        )
        object.__setattr__(self, "was_called", True)
        return outcomes


@pytest.mark.parametrize(
    ("vehicle", "changes", "message"),
    [
        (Toy(inverse_ttc=1e9), {}, "events down to a time to collision of"),
        (Toy(inverse_ttc=1e9), {"minimum_events": 500, "maximum_batches": 2}, "limit 6 iterations of 100"),
        (Fading(), {}, "no event down to 0 s in 500 simulations"),
    ],
)
def test_a_search_that_does_not_end_says_so(vehicle, changes, message):
    settings = Settings(**{"sample_size": 100, "maximum_iterations": 6, "minimum_events": 5} | changes)
    with pytest.raises(ConvergenceError, match=message):
        search(before(vehicle), "all", families("piecewise"), settings, np.random.default_rng(1))


def proposals():
    searches = {
        f"{method} {seed}": found(method, toy(1e-1, 1e-3), seed) for seed, method in enumerate(PAPERS)
    }
    return searches, Proposals.of(searches)


def test_proposals_come_back_equal(tmp_path):
    searches, kept = proposals()
    assert kept.factors == {name: search.proposal for name, search in searches.items()}
    assert kept.simulations == {name: search.simulations for name, search in searches.items()}
    assert kept.total == sum(search.simulations for search in searches.values()) > 0
    first, second = tmp_path / "first.json", tmp_path / "second.json"
    write_proposals(first, kept)
    back = read_proposals(first)
    assert back == kept
    assert list(back.factors) == list(kept.factors)
    write_proposals(second, back)
    assert first.read_bytes() == second.read_bytes()
    other = dataclasses.replace(kept, simulations=kept.simulations | {"single 2": 1})
    assert other != kept


def test_proposals_of_one_stratum():
    searches, kept = proposals()
    alone = kept.only("piecewise 1")
    assert alone.factors == {"piecewise 1": searches["piecewise 1"].proposal}
    assert alone.total == searches["piecewise 1"].simulations < kept.total


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text[:-30],
        lambda text: "",
        lambda text: "[]",
        lambda text: text.replace('"second"', '"third"'),
        lambda text: text.replace('"simulations"', '"simulation"'),
        lambda text: text.replace("bounded exponential", "Weibull"),
        lambda text: text.replace('"rate"', '"speed"'),
        lambda text: json.dumps(json.loads(text) | {"slow": 3}),
    ],
)
def test_damaged_proposals_are_refused(tmp_path, damage):
    path = tmp_path / "proposals.json"
    write_proposals(path, Proposals({"slow": F}, {"slow": 7000}))
    text = path.read_text(encoding="utf-8")
    assert damage(text) != text
    path.write_text(damage(text), encoding="utf-8")
    with pytest.raises(InputError, match=r"proposals\.json: seen .*; expected a file of accelerated"):
        read_proposals(path)


def test_each_stratum_is_searched_and_sampled_with_its_own_law():
    """At 6 or 7 m/s TTC^-1 is that of F, at 30 m/s exponential; a crash is a TTC^-1 of 0.3 and more."""
    other = BoundedExponential(30.0)
    law = IndependentLaw(
        "made up",
        {"slow": 2, "fast": 1},
        F.first,
        {"slow": F.second, "fast": other},
        {"slow": Empirical([7.0, 6.0]), "fast": Empirical([30.0])},
    )
    seen = {}

    class Recorder(Toy):
        def simulate(self, lead_speed, range_, closing_speed):
            seen.setdefault("speeds", set()).update(lead_speed.tolist())
            return super().simulate(lead_speed, range_, closing_speed)

    problem = Problem(law, Recorder(inverse_ttc=0.3))
    single = METHODS["single"].configured(SETTINGS)
    for stratum, (f, speeds) in {"slow": (F.second, {6.0, 7.0}), "fast": (other, {30.0})}.items():
        seen.clear()
        result = single.search(problem, stratum, np.random.default_rng(1))
        assert seen["speeds"] == speeds
        sample = problem.sample(stratum, result.proposal, np.random.default_rng(2), 20_000)
        error = 4 * sample.weight.std() / math.sqrt(20_000)
        assert sample.weight.mean() == pytest.approx(float(f.sf(0.3)), rel=0, abs=error)
        assert error < 0.15 * float(f.sf(0.3))


@pytest.mark.parametrize("method", PAPERS)
def test_twenty_seeds_end_well_before_the_car_of_the_study(method):
    law = IndependentLaw(
        "near the records of 5 to 15 m/s",
        {"5-15": 1},
        F.first,
        {"5-15": F.second},
        {"5-15": Empirical(np.linspace(5, 15, 201)[:-1])},
        closing_speed_max=23.49,
    )
    problem = Problem(law, AccAeb())
    for seed in range(20):
        result = found(method, problem, seed)
        sample = problem.sample("5-15", result.proposal, np.random.default_rng(seed), 2000)
        assert sample.happened.mean() > 0.05
