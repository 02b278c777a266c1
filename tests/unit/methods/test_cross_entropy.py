"""The search for f*: events, likelihood ratios, and vehicles whose crash probability is known."""

import dataclasses
import math

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import CUT_IN, Problem
from accelerated_evaluation.laws import Factors
from accelerated_evaluation.laws.distributions import BoundedExponential, Empirical
from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.cross_entropy.families import LARGE, PiecewiseFamily
from accelerated_evaluation.methods.cross_entropy.levels import SearchSettings, Shift, draw_level, event_score
from accelerated_evaluation.methods.cross_entropy.search import search
from accelerated_evaluation.methods.importance_sampling import Sample
from accelerated_evaluation.vehicles import AccAeb, Outcomes
from toy_segment import CONFIG, PAPERS, SETTINGS, F, Toy, before, families, found, toy


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
    parts = [Sample.of(problem, "all", F, generator, size) for size in (3, 500)]
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
    Sample.of(before(recorder, cap=2.5), "all", F, np.random.default_rng(1), 500)
    assert recorder.seen[2].max() == 2.5 > recorder.seen[2].min()
    before(recorder).simulate(np.array([[20.0, 10.0, 5.0], [30.0, 100.0, 50.0]]))
    assert recorder.seen.tolist() == [[20, 30], [10, 100], [5, 50]]


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
    ids=["f", "single", "piecewise", "shifted"],
)
def test_likelihood_ratios_average_to_one(f_star):
    size = 20_000
    sample = Sample.of(toy(None, None), "all", f_star, np.random.default_rng(3), size)
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
    sample = Sample.of(problem, "all", result.proposal, np.random.default_rng(12), 20_000)
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


def full(first, second):
    """Return the families of F whose pieces hold all weight at these coordinates."""
    pairs = zip((F.first, F.second), (first, second), strict=True)
    return tuple(PiecewiseFamily.start(law, 0.01, 5).update(np.full(9, x), np.ones(9)) for law, x in pairs)


def knots_of(families):
    return tuple(family.model.knots[0] for family in families)


def test_shifted_moves_truncation_points_but_never_past_an_event():
    problem = toy(None, 1e-9)
    threshold = problem.vehicle.inverse_ttc
    plain, moved = found("piecewise", problem, 4), found("shifted", problem, 4)
    knots = [row["inverse_ttc_from_2"] for row in moved.trace]
    assert {row["inverse_ttc_from_2"] for row in plain.trace} == {0.166}
    assert np.all(np.diff(knots) >= 0)
    assert 0.166 < knots[-1] < threshold
    assert {row["inverse_ttc_from_1"] for row in moved.trace} == {0.0}

    shift, tails = Shift(0.01, 0.05, every_iteration=True), full(0.02, 1.0)
    for lowest in (0.166 + 1e-9, 0.265, 0.267, 0.5, 0.9123):
        at, last = tails, None
        while at != last:
            last, at = at, shift.raised(at, (np.array([0.02]), np.array([1.0, lowest])))
        first, second = knots_of(at)
        assert first == 0.037  # its tail is not full
        assert max(lowest - 0.05, 0.166) >= second > lowest - 0.1 - 1e-9
    assert shift.raised(families("piecewise"), (np.ones(1), np.ones(1))) == families("piecewise")
    assert Shift().raised(tails) == tails


SMALL = SearchSettings(sample_size=100, minimum_events=50, event_quantile=0.8, maximum_batches=4)


@pytest.mark.parametrize(("rank", "steps"), [(40, 1), (60, 0)])
def test_the_papers_heuristic_moves_only_if_even_the_previous_event_is_too_rare(rank, steps):
    """No encounter crashes, and 40 or 60 of the first 100 belong to the event of the previous iteration."""
    problem, start = before(Toy(inverse_ttc=3.0)), full(0.1, 1.0)

    def level(shift, previous):
        return draw_level(problem, "all", start, SMALL, shift, previous, np.random.default_rng(1))

    scores = event_score(level(Shift(), math.inf).sample, SMALL.range_per_ttc)
    previous = np.sort(scores)[rank - 1]
    moved = level(Shift(0.01, 0.05), previous)
    assert knots_of(moved.families) == pytest.approx((0.037 + steps * 0.01, 0.166 + steps * 0.05))
    assert moved.happened.size == 400 - 100 * steps  # the sample before the move is not used
    assert moved.simulations == 400
    for fixed in (Shift(), Shift(0.01, 0.05, every_iteration=True)):
        other = level(fixed, previous)
        assert (other.families, other.happened.size) == (start, 400)
        assert previous >= other.threshold > 0


def test_the_papers_heuristic_stops_at_enough_events():
    """All encounters whose TTC^-1 is above 0.25 crash, as all draws do after two moves of the knot."""
    start = full(0.02, 1.0)
    tilted = dataclasses.replace(start[1], thetas=(0.0, -60.0))
    problem, shift = before(Toy(inverse_ttc=0.25)), Shift(0.0, 0.05)
    level = draw_level(problem, "all", (start[0], tilted), SMALL, shift, 0.0, np.random.default_rng(1))
    assert knots_of(level.families) == pytest.approx((0.037, 0.266))
    assert (level.simulations, level.happened.size, level.threshold) == (300, 100, 0.0)
    assert level.happened.sum() >= 95


def test_a_large_piece_with_few_events_needs_more_simulations():
    """The second piece of R^-1 has few of the draws, and much of the weight of the events."""
    family = PiecewiseFamily.start(F.first, 0.01, 5)
    x, heavy = np.array([0.02] * 96 + [0.05] * 4), np.array([1e-3] * 96 + [1.0] * 4)
    assert not family.is_determined(x, heavy)
    assert family.is_determined(np.append(x, 0.05), np.append(heavy, 1.0))  # enough events
    light = np.array([1.0] * 96 + [0.99 * LARGE / (1 - LARGE) * 96 / 4] * 4)
    assert family.is_determined(x, light)  # a small piece
    assert families("single")[0].is_determined(x, heavy)

    start = (dataclasses.replace(family, weights=(0.98, 0.02)), families("piecewise")[1])
    problem = toy(None, 1.0)
    few, enough = (
        draw_level(problem, "all", start, settings, Shift(), math.inf, np.random.default_rng(5))
        for settings in (SearchSettings(sample_size=100, maximum_batches=most) for most in (1, 20))
    )
    assert np.count_nonzero(few.events[0] >= 0.037) < 5
    assert not start[0].is_determined(few.events[0], few.weight)
    assert 100 < enough.simulations < 2000
    assert np.count_nonzero(enough.events[0] >= 0.037) >= 5
    np.testing.assert_array_equal(enough.sample.first[:100], few.sample.first)


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
        (Toy(inverse_ttc=1e9), {"minimum_events": 500, "maximum_batches": 2}, "within 6 iterations of 100"),
        (Fading(), {}, "no event down to 0 s in 500 simulations"),
    ],
)
def test_a_search_that_does_not_end_gives_its_last_proposal_and_says_so(vehicle, changes, message):
    settings = SearchSettings(**{"sample_size": 100, "maximum_iterations": 6, "minimum_events": 5} | changes)
    result = search(before(vehicle), "all", families("piecewise"), settings, np.random.default_rng(1))
    assert message in result.unfinished
    assert 1 < len(result.trace) <= 7
    assert result.trace[-1]["inverse_ttc_weight_2"] == result.proposal.second.weights[1]
    assert not found("piecewise", toy(None, 1e-3), 1).unfinished


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

    problem = Problem(CUT_IN, Recorder(inverse_ttc=0.3), law=law)
    single = METHODS["single"].configured(SETTINGS)
    for stratum, (f, speeds) in {"slow": (F.second, {6.0, 7.0}), "fast": (other, {30.0})}.items():
        seen.clear()
        result = single.search(problem, stratum, np.random.default_rng(1))
        assert seen["speeds"] == speeds
        sample = Sample.of(problem, stratum, result.proposal, np.random.default_rng(2), 20_000)
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
    problem = Problem(CUT_IN, AccAeb(), law=law)
    for seed in range(20):
        result = found(method, problem, seed)
        sample = Sample.of(problem, "5-15", result.proposal, np.random.default_rng(seed), 2000)
        assert sample.happened.mean() > 0.05
