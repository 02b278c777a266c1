"""Laws of cut-ins, with and without dependence: draws, scores, densities, intervals, cells, single strata."""

import math
from dataclasses import replace

import mpmath
import numpy as np
import pytest
from accelerated_evaluation.laws import Factors
from accelerated_evaluation.laws.distributions import Empirical
from accelerated_evaluation.laws.paper.models import IndependentLaw
from dependent_law import LOWER, POWER, closing_speed_tail, dependent_law, mean_over_cut_ins, rate, scale
from fewruns.problems import normal_score_quantile
from scipy.stats import binomtest, kstest, spearmanr
from wall_car import GRID, RANGE_LAWS, TTC_LAWS

SIZE = 20_000
INTERVALS = [(0.0, 3.0), (2.0, 2.0001), (6.0, 20.0), (8.0, np.inf), (0.0, np.inf)]  # [m/s]
DOUBTFUL = 1e-3  # p-value; the seeds are fixed, and a wrong law is seen to give less than 1e-20
CAP = 4.0  # m/s
DEPENDENT = dependent_law()
INDEPENDENT = IndependentLaw(
    "toy",
    {"slow": 7, "fast": 3},
    RANGE_LAWS["pieces"],
    {"slow": TTC_LAWS["pieces"], "fast": TTC_LAWS["exponential"]},
    {name: stratum.lead_speed for name, stratum in DEPENDENT.strata.items()},
)
LAWS = {"independent": INDEPENDENT, "dependent": DEPENDENT}
each_law = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)


def drawn(law, size=SIZE):
    return law.draw_in_strata(size, np.random.default_rng(1))


def mapped(law, size=SIZE):
    """Return cut-ins at random normal scores, and the index of their stratum."""
    x = law.from_normal_scores(np.random.default_rng(2).standard_normal((size, 3)))
    return x, np.where(x[:, 0] < 10, 0, 1)


def coordinates(stratum, x):
    """Return both coordinates of the cut-ins of one stratum."""
    lead_speed, range_, closing_speed = x.T
    return stratum.first(lead_speed, 1 / range_), stratum.second(lead_speed, 1 / range_, closing_speed)


def test_factors_are_independent():
    factors = Factors(RANGE_LAWS["pieces"], TTC_LAWS["pieces"])
    first, second = factors.rvs(np.random.default_rng(1), SIZE)
    assert first.shape == second.shape == (SIZE,)
    assert spearmanr(first, second).pvalue > DOUBTFUL
    total = RANGE_LAWS["pieces"].logpdf(first) + TTC_LAWS["pieces"].logpdf(second)
    np.testing.assert_array_equal(factors.logpdf(first, second), total)


@pytest.mark.parametrize("make", [drawn, mapped])
@each_law
def test_cut_ins_have_the_shares_and_the_coordinates_of_their_strata(law, make):
    x, index = make(law)
    assert x.shape == (SIZE, 3)
    assert {*np.unique(index)} == {0, 1}
    assert binomtest(int((index == 0).sum()), SIZE, 0.7).pvalue > DOUBTFUL
    assert binomtest(int((index == 0).sum()), SIZE, 0.5).pvalue < 1e-20
    for k, stratum in enumerate(law.strata.values()):
        here = x[index == k]
        assert np.isin(here[:, 0], stratum.lead_speed.values).all()
        assert kstest(here[:, 0], stratum.lead_speed.cdf).pvalue > DOUBTFUL
        first, second = coordinates(stratum, here)
        for values, factor in ((first, stratum.factors.first), (second, stratum.factors.second)):
            assert kstest(factor.cdf(values), "uniform").pvalue > DOUBTFUL
            assert abs(spearmanr(values, here[:, 0]).statistic) < 4 / math.sqrt(len(here))
        assert abs(spearmanr(first, second).statistic) < 4 / math.sqrt(len(here))


@pytest.mark.parametrize("make", [drawn, mapped])
def test_the_variables_of_a_law_with_dependence_depend_on_each_other_as_they_should(make):
    """P(R > 40 m), P(C > 3 m/s), and both, by quadrature; the product of the two first is the wrong way."""
    x, index = make(DEPENDENT)
    for k, stratum in enumerate(DEPENDENT.strata.values()):
        _, range_, closing_speed = x[index == k].T
        far, fast = range_ > 40, closing_speed > 3
        exact = {
            "far": mean_over_cut_ins(stratum, lambda v, r: np.ones(r.shape), 1 / 40),
            "fast": mean_over_cut_ins(stratum, lambda v, r: closing_speed_tail(v, r, 3.0)),
            "both": mean_over_cut_ins(stratum, lambda v, r: closing_speed_tail(v, r, 3.0), 1 / 40),
        }
        error = {name: math.sqrt(p * (1 - p) / far.size) for name, p in exact.items()}
        for name, seen in {"far": far, "fast": fast, "both": far & fast}.items():
            assert abs(seen.mean() - exact[name]) < 4 * error[name], name
        assert abs((far & fast).mean() - exact["far"] * exact["fast"]) > 8 * error["both"]


@each_law
def test_normal_scores_are_mapped_as_rosenblatt_says(law):
    """Each coordinate is the quantile of its own score, also where one in 10^15 cut-ins lies."""
    scores = np.array([-6.0, -2.0, 0.0, 2.0, 8.0])
    z = np.stack(np.meshgrid([-1.5, 1.5], scores, scores), axis=-1).reshape(-1, 3)
    x = law.from_normal_scores(z)
    for side, stratum in zip((-1.5, 1.5), law.strata.values(), strict=True):
        here = z[:, 0] == side
        first, second = coordinates(stratum, x[here])
        expected = normal_score_quantile(stratum.factors.first, z[here, 1])
        np.testing.assert_allclose(first, expected, rtol=1e-6, atol=1e-14)
        np.testing.assert_allclose(second, normal_score_quantile(stratum.factors.second, z[here, 2]), 1e-9)
    assert law.from_normal_scores(z[:0]).shape == (0, 3)


@each_law
def test_closing_speeds_are_capped(law):
    capped = replace(law, closing_speed_max=CAP)
    for make in (drawn, mapped):
        (free, _), (x, _) = make(law), make(capped)
        np.testing.assert_array_equal(x, np.minimum(free, [np.inf, np.inf, CAP]))
        assert (x[:, 2] == CAP).any()
    assert capped.capped(np.array([3.9, 4.0, 4.1])).tolist() == [3.9, 4, 4]
    assert law.capped(np.array([1e9])).tolist() == [1e9]
    assert capped.box.names == ("lead_speed", "range", "closing_speed")
    assert capped.box.upper == (np.inf, pytest.approx(75), CAP)


@each_law
def test_coordinates_and_cut_ins_are_inverse_and_slopes_are_derivatives(law):
    generator = np.random.default_rng(3)
    for stratum in law.strata.values():
        speed = stratum.lead_speed.rvs(generator, 100)
        scores = stratum.factors.rvs(generator, 100)
        x = stratum.points(speed, *scores)
        np.testing.assert_allclose(coordinates(stratum, x), scores, rtol=1e-9)
        place, step = (speed, 1 / x[:, 1]), 1e-6 / x[:, 1]
        rise = stratum.first(speed, place[1] + step) - stratum.first(speed, place[1] - step)
        np.testing.assert_allclose(rise / (2 * step), np.exp(stratum.log_first_slope(*place)), rtol=1e-5)
        step = 1e-6 * x[:, 2]
        rise = stratum.second(*place, x[:, 2] + step) - stratum.second(*place, x[:, 2] - step)
        slope = np.exp(stratum.log_second_slope(*place, x[:, 2]))
        np.testing.assert_allclose(rise / (2 * step), slope, rtol=1e-5)


NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)


def gauss(edges):
    """Return nodes and weights of the composite Gauss-Legendre rule, along the last axis."""
    half = np.diff(edges)[..., None] / 2
    nodes = edges[..., :-1, None] + half * (NODES + 1)
    return [part.reshape(*edges.shape[:-1], -1) for part in (nodes, half * WEIGHTS)]


@pytest.mark.parametrize("lead_speed", [6.0, 14.0])
@each_law
def test_densities_integrate_to_one_with_the_atom_at_the_cap(law, lead_speed):
    logs, of_logs = gauss(np.log([1.0, 75 * 0.0374, 75.0]))  # of 75 m / R; hardly any range is below 1 m
    range_ = 75 * np.exp(-logs)
    knots = np.column_stack([0 * range_, np.minimum(0.166 * range_, 0.9999 * CAP), 0 * range_ + CAP])
    closing_speed, of_speed = gauss(knots)
    closing_speed = np.column_stack([closing_speed, knots[:, 2]])  # the cap has a probability of its own
    of_speed = np.column_stack([of_speed, 0 * range_ + 1])
    x = np.stack(np.broadcast_arrays(lead_speed, range_[:, None], closing_speed), axis=-1).reshape(-1, 3)
    capped = replace(law, closing_speed_max=CAP)
    density = np.exp(capped.log_density(x)).reshape(closing_speed.shape)
    of_range = (density * of_speed).sum(axis=1)
    assert (of_range * range_) @ of_logs == pytest.approx(1, abs=1e-5)
    stratum = law.strata["slow" if lead_speed < 10 else "fast"]
    ends = (np.full(range_.size, end) for end in (CAP, np.inf))
    atom = stratum.closing_speed_probability(np.full(range_.size, lead_speed), 1 / range_, *ends)
    np.testing.assert_allclose(density[:, -1], atom * of_range, rtol=1e-4, atol=1e-9)
    without_atom = np.exp(law.log_density(x)).reshape(closing_speed.shape)
    np.testing.assert_array_equal(without_atom[:, :-1], density[:, :-1])
    assert abs(((without_atom * of_speed).sum(axis=1) * range_) @ of_logs - 1) > 1e-3
    outside = [[lead_speed, 75.1, 1.0], [lead_speed, 20.0, CAP + 1e-9], [lead_speed, 20.0, -0.1]]
    assert np.isneginf(capped.log_density(np.array(outside))).all()


@pytest.mark.parametrize("place", [(5.0, LOWER), (12.0, 0.02), (9.0, 0.5)])
@pytest.mark.parametrize(("start", "end"), INTERVALS)
def test_probability_of_closing_speeds_is_the_closed_form(place, start, end):
    """Down to 10^-36, where a difference of distribution functions would be 0."""
    speed, inverse_range = place
    arguments = [np.array([value]) for value in (speed, inverse_range, start, end)]
    with mpmath.workdps(100):
        ends, width = (mpmath.mpf(start), mpmath.mpf(end)), mpmath.mpf(float(scale(speed, inverse_range)))
        exact = {
            DEPENDENT.strata["slow"]: [mpmath.exp(-((edge / width) ** POWER)) for edge in ends],
            INDEPENDENT.strata["fast"]: [mpmath.exp(-21 * edge * inverse_range) for edge in ends],
        }
        for stratum, (below, above) in exact.items():
            found = stratum.closing_speed_probability(*arguments)
            assert found.tolist() == pytest.approx([float(below - above)], rel=1e-8, abs=0)


@each_law
def test_cells_have_the_probability_of_the_closed_form(law):
    stratum = law.strata["slow"]
    lead_speed = np.array([[5.0, 6.0], [6.0, 6.5], [9.0, 15.0], [10.0, 15.0]])
    inverse_range = np.array([[LOWER, 0.02], [0.03, 0.05], [0.05, np.inf], [LOWER, np.inf]])
    found = stratum.cell_probability(lead_speed, inverse_range)
    speeds = stratum.lead_speed.values
    for k, ((slow, fast), (far, near)) in enumerate(zip(lead_speed, inverse_range, strict=True)):
        share = np.mean((speeds >= slow) & (speeds < fast))
        if law is DEPENDENT:
            middle = rate((slow + fast) / 2)
            chance = np.exp(-middle * (far - LOWER)) - np.exp(-middle * (near - LOWER))
        else:
            chance = law.inverse_range.sf(far) - law.inverse_range.sf(near)
        assert found[k] == pytest.approx(share * chance, rel=1e-12, abs=1e-16)
    assert found[:3].min() > 0 == found[3]


@each_law
def test_cells_of_a_map_hold_all_cut_ins(law):
    cells = GRID.cells(np.full((GRID.lead_speed_cells, GRID.range_cells), 2))
    x, index = drawn(law, 200_000)
    near = (x[:, 1] <= 50) & (x[:, 1] > 20)
    for k, stratum in enumerate(law.strata.values()):
        chance = stratum.cell_probability(cells.lead_speed, cells.inverse_range)
        assert chance.sum() == pytest.approx(1, rel=1e-12)
        column = cells.lead_speed[cells.root[:, 1] == 0]  # one cell of each v_L
        part = stratum.cell_probability(column, np.tile([0.02, 0.05], (len(column), 1))).sum()
        error = math.sqrt(part * (1 - part) / (index == k).sum())
        assert near[index == k].mean() == pytest.approx(part, rel=0, abs=4 * error)


def test_shares_of_lead_speeds_leave_out_the_upper_edge():
    stratum = replace(DEPENDENT.strata["slow"], lead_speed=Empirical([5.0, 6.0, 6.0, 7.0]))
    edges = np.array([[5.0, 6.0], [6.0, 7.0], [7.0, 8.0], [5.0, 8.0], [6.5, 6.9]])
    assert stratum.lead_speed_share(edges).tolist() == [0.25, 0.5, 0.25, 1.0, 0.0]


@each_law
@pytest.mark.parametrize("name", ["slow", "fast"])
def test_one_stratum_is_a_law_of_its_own(law, name):
    law = replace(law, closing_speed_max=12.1)
    alone, speeds = law.only(name), law.strata[name].lead_speed
    assert dict(alone.shares) == {name: 1.0}
    assert [*alone.strata] == [name]
    assert alone.strata[name].factors == law.strata[name].factors
    assert (alone.description, alone.closing_speed_max) == (law.description, 12.1)
    assert type(alone) is type(law)
    assert sum(law.shares.values()) == pytest.approx(1)
    x, index = drawn(alone)
    assert set(index) == {0}
    assert kstest(x[:, 0], speeds.cdf).pvalue > DOUBTFUL
    scored = alone.from_normal_scores(np.array([[-9.0, 0, 0], [9.0, 0, 0]]))[:, 0]
    assert scored.tolist() == [speeds.lower, speeds.upper]
    np.testing.assert_array_equal(alone.log_density(x), law.log_density(x))
    with pytest.raises(KeyError):
        law.only("unknown")
