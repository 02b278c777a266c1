"""The mean law: its Rosenblatt map, densities and weights, against the draws that it is the mean of."""

from dataclasses import replace

import accelerated_evaluation as ae
import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.answer.ways.by_few_runs import laws_of
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.laws.smooth.conditional import Places, range_grid, speed_grid
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.vehicles import Outcomes
from accelerated_evaluation.vehicles.protocol import CRASH
from builders import coarse_grid
from fewruns import LawEstimates
from mean_law import DRAWS, SUPPORT, encounters_, law_, one_draw  # noqa: F401
from scipy.special import log_ndtr
from scipy.stats import norm

LEVELS = np.arange(0.0005, 1, 0.001)
CAP = 6.0  # m/s, which many closing speeds exceed


@pytest.fixture(scope="module")
def x(law):
    return law.from_normal_scores(np.random.default_rng(3).normal(size=(700, 3)) * [1, 1.5, 1.5])


def test_the_rarest_coordinates_are_ranges_above_zero(law):
    stratum, far = next(iter(law.strata.values())), np.array([1e3, 1e5])
    found = stratum.points(np.full(2, 10.0), far, np.ones(2))
    assert (found[:, 1] > 0).all()
    assert np.isfinite(found[:, 2]).all()


def each(law, x):
    """Return ranges' survival and density, and closing speeds' survival and density, of every draw."""
    lead_speed, range_, closing_speed = x.T
    places, value, rows = Places.of(lead_speed, range_, SUPPORT), np.log(SUPPORT.range_max / range_), []
    for shared, speeds in zip(law.draws.shared, law.draws.laws, strict=True):
        ranges, given = places.range_hazards(law.draws.ranges[shared]), speeds.given(places)
        of_range = np.exp(-ranges.at(value))
        of_speed = np.exp(-given.cumulative(closing_speed)), np.exp(given.log_density(closing_speed))
        rows.append((of_range, ranges.rate(value) * of_range, *of_speed))
    return np.array(rows).transpose(1, 0, 2)


def coordinates(law, x):
    """Return the two coordinates of cut-ins under the mean law."""
    stratum = law.strata["5-15"]
    return stratum.first(x[:, 0], 1 / x[:, 1]), stratum.second(x[:, 0], 1 / x[:, 1], x[:, 2])


def test_all_shapes_are_drawn_and_bodies_are_shared(law):
    shapes = {None if speeds.tail is None else speeds.tail.shape.name for speeds in law.draws.laws}
    assert shapes == {None, "exponential", "generalised", "two kinds"}
    assert len(law.draws.bodies) == 50
    # Stratified choice: every law is drawn as often as its weight says, but for one.
    counts = pd.Series(law.draws.names).value_counts()
    assert counts.between(DRAWS / 4 - 1, DRAWS / 4 + 1).all()


def test_the_scores_are_those_of_the_mixture_of_all_draws(law, x):
    of_range, range_density, of_speed, _ = each(law, x)
    first, second = coordinates(law, x)
    np.testing.assert_allclose(first, -np.log(of_range.mean(axis=0)), rtol=1e-9)
    exact = (range_density * of_speed).mean(axis=0) / range_density.mean(axis=0)
    np.testing.assert_allclose(second, -np.log(exact), rtol=1e-9, atol=1e-12)
    without_ranges = -np.log(of_speed.mean(axis=0))  # the wrong mixture: equal weights at every range
    assert np.abs(second / without_ranges - 1).max() > 1e-3


def test_the_map_from_scores_is_the_inverse(law):
    z, free = (
        np.random.default_rng(4).normal(size=(300, 3)) * [1, 2, 2],
        replace(law, closing_speed_max=np.inf),
    )
    expected = -log_ndtr(-z[:, 1:].T)
    np.testing.assert_allclose(coordinates(law, free.from_normal_scores(z)), expected, rtol=1e-6, atol=1e-7)


def test_a_cut_in_does_not_depend_on_the_others(law):
    z = np.random.default_rng(9).normal(size=(60, 3)) * [1, 2, 2]
    alone = np.concatenate([law.from_normal_scores(row[None]) for row in z])
    np.testing.assert_allclose(law.from_normal_scores(z), alone, rtol=1e-10, atol=1e-10)


def test_slopes_of_the_coordinates(law, x):
    stratum, step = law.strata["5-15"], 1e-6
    lead_speed, place, speed = x[:, 0], 1.01 / x[:, 1], x[:, 2]
    rises = {
        "first": stratum.first(lead_speed, place * (1 + step))
        - stratum.first(lead_speed, place * (1 - step)),
        "second": stratum.second(lead_speed, place, speed * (1 + step))
        - stratum.second(lead_speed, place, speed * (1 - step)),
    }
    slopes = {
        "first": place * np.exp(stratum.log_first_slope(lead_speed, place)),
        "second": speed * np.exp(stratum.log_second_slope(lead_speed, place, speed)),
    }
    for name, rise in rises.items():
        kinks = np.abs(rise / (2 * step) / slopes[name] - 1) > 1e-4
        assert kinks.mean() < 0.01, name  # where a difference straddles an edge of a bin


def test_ratios_are_those_of_the_densities_and_are_bounded(law, x):
    _, range_density, _, speed_density = each(law, x)
    density = range_density * speed_density
    ratios = law.log_ratios(x)
    np.testing.assert_allclose(ratios, np.log(density / density.mean(axis=0)), atol=1e-8)
    assert ratios.max() <= np.log(DRAWS) + 1e-12
    np.testing.assert_allclose(np.exp(ratios).mean(axis=0), 1, rtol=1e-9)
    without_ranges = np.log(speed_density / speed_density.mean(axis=0))  # the wrong weights
    assert np.abs(ratios - without_ranges).max() > 0.1


def gauss(edges):
    """Return nodes and weights of the Gauss-Legendre rule with three nodes between edges."""
    nodes, weights = np.polynomial.legendre.leggauss(3)
    half = np.diff(edges)[:, None] / 2
    return (edges[:-1, None] + half * (nodes + 1)).ravel(), (half * weights).ravel()


@pytest.mark.parametrize("lead_speed", [6.0, 21.3])
def test_densities_integrate_to_one_with_the_atom_at_the_cap(law, lead_speed):
    """Under every draw; that of the mean law is their mean, and each is that of the law of one draw alone."""
    edges = range_grid(SUPPORT).edges[-1]
    logs, of_logs = gauss(np.append(edges, edges[-1] + np.geomspace(0.1, 20, 20)))
    range_ = SUPPORT.range_max * np.exp(-logs)
    closing_speed, of_speed = gauss(speed_grid(SUPPORT).edges[-1][: int(2 * CAP) + 1])  # steps of 0.5 m/s
    closing_speed, of_speed = (
        np.append(closing_speed, CAP),
        np.append(of_speed, 1),
    )  # the cap has a probability
    capped = replace(law, closing_speed_max=CAP)
    x = np.stack(np.meshgrid(lead_speed, range_, closing_speed, indexing="ij"), axis=-1).reshape(-1, 3)
    densities = np.exp(capped.log_densities(x))
    weight = np.outer(range_ * of_logs, of_speed).ravel()
    np.testing.assert_allclose(densities @ weight, 1, atol=2e-4)
    np.testing.assert_allclose(np.exp(capped.log_density(x)), densities.mean(axis=0), rtol=1e-12)
    free = np.exp(law.log_densities(x))
    assert np.all(np.abs(free @ weight - 1) > 1e-3)  # the density at the cap in place of its probability
    for k in (0, 20, 40, DRAWS - 1):
        alone = one_draw(law, k, CAP)
        np.testing.assert_allclose(np.exp(alone.log_density(x)), densities[k], rtol=1e-9)
    outside = np.array([[lead_speed, 60.1, 1.0], [lead_speed, 20.0, CAP + 1e-9], [lead_speed, 20.0, -0.1]])
    assert np.isneginf(capped.log_density(outside)).all()
    assert np.isneginf(alone.log_density(outside)).all()


def test_reweighted_draws_of_the_mean_law_are_draws_of_each(law):
    """P(R < 10 m, C > 0.3 R / s) under each draw: exact, and by weights that average to one."""
    law, size = replace(law.thinned(20), closing_speed_max=CAP), 15_000
    x = law.draw(size, np.random.default_rng(6))
    ratios = np.exp(law.log_ratios(x))
    error = ratios.std(axis=1) / np.sqrt(size)
    assert np.all(np.abs(ratios.mean(axis=1) - 1) < 4.5 * error)
    happened = (x[:, 1] < 10) & (x[:, 2] > 0.3 * x[:, 1])
    found = (ratios * happened).mean(axis=1)
    deviation = (ratios * happened).std(axis=1) / np.sqrt(size)
    exact = crash_probabilities(law)
    assert np.all(np.abs(found - exact) < 4.5 * deviation)
    # With the density at the cap in place of its probability, the weights are wrong.
    wrong = np.exp(replace(law, closing_speed_max=np.inf).log_ratios(x))
    assert np.max(np.abs(wrong.mean(axis=1) - 1) * np.sqrt(size) / wrong.std(axis=1)) > 8


def crash_probabilities(law):
    """Return the probability of the event of the test above under each draw, by quadrature over ranges."""
    draws = law.draws
    recorded = np.sort(np.concatenate([speeds.ppf(LEVELS) for speeds in law.lead_speeds.values()]))
    leads = recorded[10::20]
    x = np.log(SUPPORT.range_max / 10) + np.linspace(0, 6, 241)
    middle = (x[1:] + x[:-1]) / 2
    lead, logarithm = (part.ravel() for part in np.meshgrid(leads, middle, indexing="ij"))
    ends = [part.ravel() for side in (x[:-1], x[1:]) for part in np.meshgrid(leads, side, indexing="ij")[1:]]
    range_ = SUPPORT.range_max * np.exp(-logarithm)
    places = Places.of(lead, range_, SUPPORT)
    hazards = [places.range_hazards(ranges) for ranges in draws.ranges]
    masses = [np.exp(-each.at(ends[0])) - np.exp(-each.at(ends[1])) for each in hazards]
    beyond = [np.exp(-speeds.given(places).cumulative(0.3 * range_)) for speeds in draws.laws]
    pairs = zip(draws.shared, beyond, strict=True)
    return np.array([(masses[shared] * speeds).sum() / leads.size for shared, speeds in pairs])


def test_a_file_gives_the_law_back(law, encounters, x, tmp_path):
    law = replace(law, closing_speed_max=CAP)
    ae.write_law(tmp_path / "law.json", law, encounters)
    read = ae.read_law(tmp_path / "law.json", encounters)
    assert read == law
    assert read.content() == law.content()
    assert read.digest == law.digest != law.thinned(7).digest
    x = np.minimum(x, [99, 99, CAP])
    np.testing.assert_array_equal(read.log_densities(x), law.log_densities(x))


def test_thinned_draws_are_some_of_all(law, x):
    few = law.thinned(7)
    assert few.draws.size == 7
    chosen = np.linspace(0, DRAWS - 1, 7).round().astype(int)
    np.testing.assert_allclose(few.log_densities(x), law.log_densities(x)[chosen], rtol=1e-12)
    assert law.thinned(1000).draws.size == DRAWS


def test_closing_speeds_are_capped_where_nothing_changes(law):
    z = np.array([[0.0, 0.0, norm.isf(1e-250)]])
    assert law.from_normal_scores(z)[0, 2] == 40
    assert replace(law, closing_speed_max=np.inf).from_normal_scores(z)[0, 2] > 40


class QuickCloser:
    """Crashes if the gap closes within four seconds."""

    name = "quick closer"

    def simulate(self, lead_speed, range_, closing_speed):
        closing_speed, range_ = np.asarray(closing_speed), np.asarray(range_)
        crash = closing_speed > 0.25 * range_
        ttc = np.where(closing_speed > 0, range_ / np.maximum(closing_speed, 1e-9), np.inf)
        return Outcomes(crash, np.where(crash, 0.0, range_), ttc, np.where(crash, closing_speed, 0.0))


def test_a_cap_of_the_law_leaves_the_parts_of_a_crash_map_above_it_their_probabilities(law):
    """Impact speeds grow above the cap, so a map does not move the larger closing speeds to the cap."""
    start, end, three = np.array([3.0, 6.0, 12.0]), np.array([6.0, 12.0, np.inf]), np.ones(3)
    lines = CrashLines(Places.of(10 * three, 20 * three, SUPPORT), three, np.arange(3), start, end)
    capped, free = (lines.masses(law.with_cap_at(cap)) for cap in (8.0, np.inf))
    np.testing.assert_allclose(capped, free, rtol=1e-12)
    slices = np.exp(law.with_cap_at(8.0).log_slices(2, lines.x, start, end))  # of the law with its cap
    assert (slices[:, 2] == 0).all()
    assert (free[:, 2] > 0).all()


def test_the_map_of_a_reference_gives_the_mean_of_the_draws_and_each_of_them(law, encounters):
    grid, generator = (
        coarse_grid(speeds=(5, 25, 8), ranges=(60, 30), closing=(120, 40), refinement=4),
        np.random.default_rng(4),
    )
    crash_map = ae.map_crashes(QuickCloser(), grid, [], generator)
    records = DistinctRecords.of(encounters, SUPPORT)
    problem = ae.Problem(ae.CUT_IN, QuickCloser(), law=law)
    answered = ae.evaluate(problem, law, ae.Map(crash_map, records), generator=generator)
    found = answered.posterior
    x = law.draw(20_000, np.random.default_rng(6))
    crash = x[:, 2] > 0.25 * x[:, 1]
    assert answered.replayed.events == (records.closing_speed > 0.25 * records.range_).sum()
    error = np.sqrt(crash.mean() / crash.size)
    assert found.probabilities.mean() == pytest.approx(crash.mean(), abs=4 * error)
    weighted = np.exp(law.log_ratios(x[crash]))
    by_draw, errors = weighted.sum(axis=1) / crash.size, np.sqrt((weighted**2).sum(axis=1)) / crash.size
    apart = np.abs(found.probabilities - by_draw) / errors
    assert np.all(apart < 4)
    assert np.mean(apart < 2) > 0.9  # 95 % on average; all draws are compared with the same cut-ins
    assert np.mean(np.abs(found.probabilities[::-1] - by_draw) / errors < 2) < 0.9  # of other draws: wrong


def test_the_emphasis_is_large_where_draws_of_small_probability_have_their_events(law):
    probabilities = np.geomspace(1e-7, 1e-5, DRAWS)
    emphasis = laws_of(law, law.from_normal_scores).emphasis(
        LawEstimates(probabilities, np.full(DRAWS, 0.1), 20)
    )
    z = np.random.default_rng(9).normal(size=(60, 3)) * [1, 1.2, 1.2]
    chosen = 3 * np.arange(20) + 1  # at equal steps of the rank
    few = law.subset(chosen)
    ratios, chosen = np.exp(few.log_ratios(few.from_normal_scores(z))), probabilities[chosen]
    chosen = chosen / probabilities.mean()
    assert emphasis(z) == pytest.approx(np.sqrt(np.mean((ratios / chosen[:, None]) ** 2, axis=0)))
    many = np.repeat(z, 10, axis=0)
    assert emphasis(many) == pytest.approx(np.repeat(emphasis(z), 10))  # by the nearest, which are the same


def test_runs_that_are_chosen_for_a_near_miss_find_its_probability(law):
    # The quick closer has this near miss where the gap closes within six seconds.
    near = ae.CUT_IN.event("min_ttc", 6.0)
    problem = ae.Problem(ae.CUT_IN, QuickCloser(), near, law=law)
    stopping = ae.Stopping(minimum_events=1, maximum_simulations=400)
    events = CRASH, ae.CUT_IN.event("min_range", 1.0)
    answers = [
        ae.evaluate(problem, law, ae.FewRuns(stopping), events, generator=np.random.default_rng(seed))
        for seed in (10, 11, 12)
    ]
    x = law.draw(20_000, np.random.default_rng(6))
    near_miss, crash = (np.mean(x[:, 2] * time > x[:, 1]) for time in (6.0, 4.0))
    tables = [answer.table().set_index("event") for answer in answers]
    found = np.mean([table.loc["TTC at most 6 s", "probability"] for table in tables])
    assert np.log(found / near_miss) == pytest.approx(0, abs=0.3)
    # A quarter of the near misses are crashes, and few of the runs: their probability may be unknown, below
    # that of the near miss.
    for table in tables:
        row = table.loc["crash"]
        assert row["low95"] <= crash <= row["high95"] <= table.loc["TTC at most 6 s", "high95"]
        assert np.isnan(row["probability"]) == np.isnan(row["median"])
    assert table.index[0] == "TTC at most 6 s"
    assert np.isnan(table.loc["range at most 1 m", "median"])  # no part of the event: not known
