"""The mean law: its Rosenblatt map, densities and weights, against the draws that it is the mean of."""

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.answer.averaged import AveragedSurrogate
from accelerated_evaluation.answer.references import Reference
from accelerated_evaluation.answer.reweighting import draws_of
from accelerated_evaluation.answer.scored_family import score_family
from accelerated_evaluation.crash_map.mapping import map_crashes
from accelerated_evaluation.crash_map.maps import Grid
from accelerated_evaluation.laws import CutIns
from accelerated_evaluation.laws.files import read_law, write_law
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.draws import LawDraws
from accelerated_evaluation.laws.smooth.family import DistinctRecords, Member
from accelerated_evaluation.laws.smooth.mean import MeanLaw
from accelerated_evaluation.laws.smooth.support import Support
from accelerated_evaluation.methods.estimate import Stopping
from accelerated_evaluation.problem import Problem
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.vehicles import Outcomes
from accelerated_evaluation.vehicles.events import CRASH
from fewruns import LawEstimates
from scipy.special import log_ndtr
from scipy.stats import norm

SUPPORT = Support((5.0, 25.0), 60.0, 20.0, (15.0,))
MEMBERS = (Member(), *(Member(0.9, shape) for shape in ("exponential", "generalised", "two kinds")))
LEVELS = np.arange(0.0005, 1, 0.001)
DRAWS = 60  # ten more than share a body


@pytest.fixture(scope="module")
def encounters():
    generator = np.random.default_rng(5)
    lead_speed, range_ = generator.uniform(5, 25, 3000), 60 * generator.beta(2, 1.2, 3000)
    closing_speed = generator.exponential(0.5 + 0.03 * range_).clip(0, 19.9)
    segment = np.where(lead_speed < 15, "5-15", "15-25")
    columns = {"lead_speed": lead_speed, "range": range_, "closing_speed": closing_speed}
    return pd.DataFrame(columns | {"segment": segment})


@pytest.fixture(scope="module")
def law(encounters):
    scored = score_family(DistinctRecords.of(encounters, SUPPORT), MEMBERS, 3)
    weights = np.full((DRAWS, len(MEMBERS)), 1 / len(MEMBERS))
    draws = LawDraws.of(scored.family, MEMBERS, weights, SUPPORT, np.random.default_rng(2))
    return MeanLaw.fitted(draws, encounters, "mean of draws", 40.0)


@pytest.fixture(scope="module")
def cut_ins(law):
    return law.from_normal_scores(np.random.default_rng(3).normal(size=(700, 3)) * [1, 1.5, 1.5])


def test_the_rarest_coordinates_are_ranges_above_zero(law):
    stratum, far = next(iter(law.strata.values())), np.array([1e3, 1e5])
    found = stratum.cut_ins(np.full(2, 10.0), far, np.ones(2))
    assert (found.range_ > 0).all()
    assert np.isfinite(found.closing_speed).all()


def each(law, cut_ins):
    """Return ranges' survival and density, and closing speeds' survival and density, of every draw."""
    draws = law.draws
    places = Places.of(cut_ins.lead_speed, cut_ins.range_, SUPPORT)
    x = np.log(SUPPORT.range_max / cut_ins.range_)
    rows = []
    for shared, speeds in zip(draws.shared, draws.laws, strict=True):
        ranges, given = places.range_hazards(draws.ranges[shared]), speeds.given(places)
        density = ranges.rate(x) * np.exp(-ranges.at(x))
        survival = np.exp(-given.cumulative(cut_ins.closing_speed))
        rows.append(
            (np.exp(-ranges.at(x)), density, survival, np.exp(given.log_density(cut_ins.closing_speed)))
        )
    return np.array(rows).transpose(1, 0, 2)


def test_all_shapes_are_drawn_and_bodies_are_shared(law):
    shapes = {None if speeds.tail is None else speeds.tail.shape.name for speeds in law.draws.laws}
    assert shapes == {None, "exponential", "generalised", "two kinds"}
    assert len(law.draws.bodies) == 50
    # Stratified choice: every law is drawn as often as its weight says, but for one.
    counts = pd.Series(law.draws.names).value_counts()
    assert counts.between(DRAWS / 4 - 1, DRAWS / 4 + 1).all()


def test_the_scores_are_those_of_the_mixture_of_all_draws(law, cut_ins):
    of_range, range_density, of_speed, _ = each(law, cut_ins)
    stratum = law.strata["5-15"]
    place = cut_ins.lead_speed, cut_ins.inverse_range
    np.testing.assert_allclose(stratum.first(*place), -np.log(of_range.mean(axis=0)), rtol=1e-9)
    second = stratum.second(*place, cut_ins.closing_speed)
    exact = (range_density * of_speed).mean(axis=0) / range_density.mean(axis=0)
    np.testing.assert_allclose(second, -np.log(exact), rtol=1e-9, atol=1e-12)
    without_ranges = -np.log(of_speed.mean(axis=0))  # the wrong mixture: equal weights at every range
    assert np.abs(second / without_ranges - 1).max() > 1e-3


def test_the_map_from_scores_is_the_inverse(law):
    z = np.random.default_rng(4).normal(size=(300, 3)) * [1, 2, 2]
    cut_ins = law.from_normal_scores(z)
    stratum = law.strata["5-15"]
    place = cut_ins.lead_speed, cut_ins.inverse_range
    np.testing.assert_allclose(stratum.first(*place), -log_ndtr(-z[:, 1]), rtol=1e-6, atol=1e-7)
    second = stratum.second(*place, cut_ins.closing_speed)
    np.testing.assert_allclose(second, -log_ndtr(-z[:, 2]), rtol=1e-6, atol=1e-7)


def test_a_cut_in_does_not_depend_on_the_others(law):
    z = np.random.default_rng(9).normal(size=(60, 3)) * [1, 2, 2]
    together, alone = law.from_normal_scores(z), [law.from_normal_scores(row[None]) for row in z]
    np.testing.assert_allclose(
        together.closing_speed, [part.closing_speed[0] for part in alone], rtol=1e-10, atol=1e-10
    )


def test_the_slope_of_the_first_score(law, cut_ins):
    stratum, step = law.strata["5-15"], 1e-6
    inverse_range = cut_ins.inverse_range * 1.01
    up, down = (stratum.first(cut_ins.lead_speed, inverse_range * (1 + s)) for s in (step, -step))
    slope = np.exp(stratum.log_first_slope(cut_ins.lead_speed, inverse_range))
    kinks = np.abs((up - down) / (2 * step * inverse_range) / slope - 1) > 1e-4
    assert kinks.mean() < 0.01  # where a difference straddles an edge of a bin


def test_ratios_are_those_of_the_densities_and_are_bounded(law, cut_ins):
    _, range_density, _, speed_density = each(law, cut_ins)
    density = range_density * speed_density
    ratios = law.log_ratios(cut_ins)
    np.testing.assert_allclose(ratios, np.log(density / density.mean(axis=0)), atol=1e-8)
    assert ratios.max() <= np.log(DRAWS) + 1e-12
    np.testing.assert_allclose(np.exp(ratios).mean(axis=0), 1, rtol=1e-9)
    without_ranges = np.log(speed_density / speed_density.mean(axis=0))  # the wrong weights
    assert np.abs(ratios - without_ranges).max() > 0.1


def test_reweighted_draws_of_the_mean_law_are_draws_of_each(law):
    """P(R < 10 m, C > 0.3 R / s) under each draw: exact, and by weights that average to one."""
    generator, size = np.random.default_rng(6), 15_000
    cut_ins = law.from_normal_scores(generator.normal(size=(size, 3)))
    ratios = np.exp(law.log_ratios(cut_ins))
    error = ratios.std(axis=1) / np.sqrt(size)
    assert np.all(np.abs(ratios.mean(axis=1) - 1) < 4.5 * error)
    happened = (cut_ins.range_ < 10) & (cut_ins.closing_speed > 0.3 * cut_ins.range_)
    found = (ratios * happened).mean(axis=1)
    deviation = (ratios * happened).std(axis=1) / np.sqrt(size)
    exact = np.array([crash_probability(law, draw) for draw in range(DRAWS)])
    assert np.all(np.abs(found - exact) < 4.5 * deviation)


def crash_probability(law, draw):
    """Return the probability of the event of the test above under one draw, by quadrature over ranges."""
    draws = law.draws
    recorded = np.sort(np.concatenate([speeds.ppf(LEVELS) for speeds in law.lead_speeds.values()]))
    leads = recorded[10::20]
    x = np.log(SUPPORT.range_max / 10) + np.linspace(0, 6, 241)
    middle = (x[1:] + x[:-1]) / 2
    lead, logarithm = (part.ravel() for part in np.meshgrid(leads, middle, indexing="ij"))
    ends = [part.ravel() for side in (x[:-1], x[1:]) for part in np.meshgrid(leads, side, indexing="ij")[1:]]
    range_ = SUPPORT.range_max * np.exp(-logarithm)
    places = Places.of(lead, range_, SUPPORT)
    ranges = places.range_hazards(draws.ranges[draws.shared[draw]])
    mass = np.exp(-ranges.at(ends[0])) - np.exp(-ranges.at(ends[1]))
    speeds = np.exp(-draws.laws[draw].given(places).cumulative(0.3 * range_))
    return (mass * speeds).sum() / leads.size


def test_a_file_gives_the_law_back(law, encounters, cut_ins, tmp_path):
    write_law(tmp_path / "law.json", law)
    read = read_law(tmp_path / "law.json", encounters)
    assert read == law
    assert read.content() == law.content()
    np.testing.assert_array_equal(read.log_ratios(cut_ins), law.log_ratios(cut_ins))


def test_thinned_draws_are_some_of_all(law, cut_ins):
    few = law.thinned(7)
    assert few.draws.size == 7
    densities = law.strata["5-15"].log_densities(cut_ins.lead_speed, cut_ins.range_, cut_ins.closing_speed)
    own = few.strata["5-15"].log_densities(cut_ins.lead_speed, cut_ins.range_, cut_ins.closing_speed)
    chosen = np.linspace(0, DRAWS - 1, 7).round().astype(int)
    np.testing.assert_allclose(own, densities[chosen], rtol=1e-12)
    assert law.thinned(1000).draws.size == DRAWS


def test_closing_speeds_are_capped_where_nothing_changes(law):
    z = np.array([[0.0, 0.0, norm.isf(1e-250)]])
    assert law.from_normal_scores(z).closing_speed[0] > 40
    assert law.capped(law.from_normal_scores(z).closing_speed)[0] == 40


class QuickCloser:
    """Crashes if the gap closes within four seconds."""

    name = "quick closer"

    def simulate(self, lead_speed, range_, closing_speed):
        closing_speed, range_ = np.asarray(closing_speed), np.asarray(range_)
        crash = closing_speed > 0.25 * range_
        ttc = np.where(closing_speed > 0, range_ / np.maximum(closing_speed, 1e-9), np.inf)
        return Outcomes(crash, np.where(crash, 0.0, range_), ttc, np.where(crash, closing_speed, 0.0))


def test_the_map_of_a_reference_gives_the_mean_of_the_draws_and_each_of_them(law, encounters):
    grid, generator = Grid(5, 25, 60, 8, 30, 4, 120, 40), np.random.default_rng(4)
    crash_map = map_crashes(QuickCloser(), grid, [], generator)
    records = DistinctRecords.of(encounters, SUPPORT)
    found = Reference.of(QuickCloser(), crash_map, records, law.draws, generator)
    cut_ins = law.from_normal_scores(np.random.default_rng(6).normal(size=(20_000, 3)))
    crash = cut_ins.closing_speed > 0.25 * cut_ins.range_
    assert found.recorded == (records.closing_speed > 0.25 * records.range_).sum()
    error = np.sqrt(crash.mean() / crash.size)
    assert found.probabilities.mean() == pytest.approx(crash.mean(), abs=4 * error)
    weighted = np.exp(law.log_ratios(CutIns(*(part[crash] for part in cut_ins_of(cut_ins)))))
    by_draw, errors = weighted.sum(axis=1) / crash.size, np.sqrt((weighted**2).sum(axis=1)) / crash.size
    apart = np.abs(found.probabilities - by_draw) / errors
    assert np.all(apart < 4)
    assert np.mean(apart < 2) > 0.95
    assert np.mean(np.abs(found.probabilities[::-1] - by_draw) / errors < 2) < 0.9  # of other draws: wrong


def cut_ins_of(cut_ins):
    return cut_ins.lead_speed, cut_ins.inverse_range, cut_ins.inverse_ttc


def test_the_emphasis_is_large_where_draws_of_small_probability_have_their_events(law):
    probabilities = np.geomspace(1e-7, 1e-5, DRAWS)
    emphasis = draws_of(law).emphasis(LawEstimates(probabilities, np.full(DRAWS, 0.1), 20))
    z = np.random.default_rng(9).normal(size=(60, 3)) * [1, 1.2, 1.2]
    chosen = 3 * np.arange(20) + 1  # at equal steps of the rank
    few = law.only_draws(chosen)
    ratios, chosen = np.exp(few.log_ratios(few.from_normal_scores(z))), probabilities[chosen]
    chosen = chosen / probabilities.mean()
    assert emphasis(z) == pytest.approx(np.sqrt(np.mean((ratios / chosen[:, None]) ** 2, axis=0)))
    many = np.repeat(z, 10, axis=0)
    assert emphasis(many) == pytest.approx(np.repeat(emphasis(z), 10))  # by the nearest, which are the same


def test_runs_that_are_chosen_for_a_near_miss_find_its_probability(law):
    # The quick closer has this near miss where the gap closes within six seconds.
    near = CUT_IN.event("min_ttc", 6.0)
    problem = Problem(law, QuickCloser(), near)
    stopping = Stopping(minimum_events=1, maximum_simulations=400)
    method = AveragedSurrogate(events=(CRASH, CUT_IN.event("min_range", 1.0)))
    found = method.estimate(problem, stopping, np.random.default_rng(10))
    answer = found.tables["answer"].set_index("event")
    cut_ins = law.from_normal_scores(np.random.default_rng(6).normal(size=(20_000, 3)))
    rates = {name: np.mean(cut_ins.closing_speed * time > cut_ins.range_) for name, time in EVENTS.items()}
    assert answer.index[0] == "TTC at most 6 s"
    # A quarter of the near misses are crashes, and few of the runs.
    for (name, rate), margin in zip(rates.items(), (0.3, 1.2), strict=True):
        assert np.log(answer.loc[name, "probability"] / rate) == pytest.approx(0, abs=margin)
    assert np.isnan(answer.loc["range at most 1 m", "median"])  # no part of the event: not known


EVENTS = {"TTC at most 6 s": 6.0, "crash": 4.0}
