"""Laws of cut-ins, with and without dependence: draws, normal scores, intervals, cells, single strata."""

import math
from dataclasses import replace

import mpmath
import numpy as np
import pytest
from accelerated_evaluation.distributions import Empirical
from accelerated_evaluation.laws import CutIns, Factors
from accelerated_evaluation.laws.paper.independent import IndependentLaw
from dependent_law import LOWER, POWER, closing_speed_tail, dependent_law, mean_over_cut_ins, rate, scale
from fewruns.problems import normal_score_quantile
from scipy.stats import binomtest, kstest, spearmanr
from wall_car import GRID, RANGE_LAWS, TTC_LAWS

SIZE = 20_000
INTERVALS = [(0.0, 3.0), (2.0, 2.0001), (6.0, 20.0), (8.0, np.inf), (0.0, np.inf)]  # [m/s]
DOUBTFUL = 1e-3  # p-value; the seeds are fixed, and a wrong law is seen to give less than 1e-20
DEPENDENT = dependent_law()
INDEPENDENT = IndependentLaw(
    "toy",
    {"slow": 7, "fast": 3},
    RANGE_LAWS["pieces"],
    {"slow": TTC_LAWS["pieces"], "fast": TTC_LAWS["exponential"]},
    {name: stratum.lead_speed for name, stratum in DEPENDENT.strata.items()},
)
LAWS = {"independent": INDEPENDENT, "dependent": DEPENDENT}


def drawn(law, size=SIZE):
    return law.draw(np.random.default_rng(1), size)


def mapped(law, size=SIZE):
    """Return cut-ins at random normal scores, and the index of their stratum."""
    cut_ins = law.from_normal_scores(np.random.default_rng(2).standard_normal((size, 3)))
    return cut_ins, np.where(cut_ins.lead_speed < 10, 0, 1)


def coordinates(stratum, cut_ins, here):
    """Return both coordinates of the cut-ins of one stratum, as uniform variables."""
    place = cut_ins.lead_speed[here], cut_ins.inverse_range[here]
    second = stratum.second(*place, cut_ins.closing_speed[here])
    return stratum.factors.first.cdf(stratum.first(*place)), stratum.factors.second.cdf(second)


def test_cut_ins_in_other_words():
    cut_ins = CutIns(np.array([20.0, 30.0]), np.array([0.1, 0.01]), np.array([0.5, 0.05]))
    assert len(cut_ins) == 2
    np.testing.assert_allclose(cut_ins.range_, [10, 100], rtol=1e-15)
    np.testing.assert_allclose(cut_ins.closing_speed, [5, 5], rtol=1e-15)
    assert replace(DEPENDENT, closing_speed_max=7.0).capped(np.array([6.9, 7.0, 7.1])).tolist() == [6.9, 7, 7]
    assert DEPENDENT.capped(np.array([1e9])).tolist() == [1e9]


def test_factors_are_independent():
    factors = Factors(RANGE_LAWS["pieces"], TTC_LAWS["pieces"])
    first, second = factors.rvs(np.random.default_rng(1), SIZE)
    assert first.shape == second.shape == (SIZE,)
    assert spearmanr(first, second).pvalue > DOUBTFUL
    total = RANGE_LAWS["pieces"].logpdf(first) + TTC_LAWS["pieces"].logpdf(second)
    np.testing.assert_array_equal(factors.logpdf(first, second), total)


@pytest.mark.parametrize("make", [drawn, mapped])
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_cut_ins_have_the_shares_and_the_coordinates_of_their_strata(law, make):
    cut_ins, index = make(law)
    assert len(cut_ins) == index.size == SIZE
    assert {*np.unique(index)} == {0, 1}
    assert binomtest(int((index == 0).sum()), SIZE, 0.7).pvalue > DOUBTFUL
    assert binomtest(int((index == 0).sum()), SIZE, 0.5).pvalue < 1e-20
    for k, stratum in enumerate(law.strata.values()):
        here = index == k
        assert np.isin(cut_ins.lead_speed[here], stratum.lead_speed.values).all()
        assert kstest(cut_ins.lead_speed[here], stratum.lead_speed.cdf).pvalue > DOUBTFUL
        first, second = coordinates(stratum, cut_ins, here)
        for values in (first, second):
            assert kstest(values, "uniform").pvalue > DOUBTFUL
            assert abs(spearmanr(values, cut_ins.lead_speed[here]).statistic) < 4 / math.sqrt(here.sum())
        assert abs(spearmanr(first, second).statistic) < 4 / math.sqrt(here.sum())


@pytest.mark.parametrize("make", [drawn, mapped])
def test_the_variables_of_a_law_with_dependence_depend_on_each_other_as_they_should(make):
    """P(R > 40 m), P(C > 3 m/s), and both, by quadrature; the product of the two first is the wrong way."""
    cut_ins, index = make(DEPENDENT)
    for k, stratum in enumerate(DEPENDENT.strata.values()):
        here = index == k
        far, fast = cut_ins.range_[here] > 40, cut_ins.closing_speed[here] > 3
        exact = {
            "far": mean_over_cut_ins(stratum, lambda v, x: np.ones(x.shape), 1 / 40),
            "fast": mean_over_cut_ins(stratum, lambda v, x: closing_speed_tail(v, x, 3.0)),
            "both": mean_over_cut_ins(stratum, lambda v, x: closing_speed_tail(v, x, 3.0), 1 / 40),
        }
        error = {name: math.sqrt(p * (1 - p) / here.sum()) for name, p in exact.items()}
        for name, seen in {"far": far, "fast": fast, "both": far & fast}.items():
            assert abs(seen.mean() - exact[name]) < 4 * error[name], name
        assert abs((far & fast).mean() - exact["far"] * exact["fast"]) > 8 * error["both"]


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_normal_scores_are_mapped_as_rosenblatt_says(law):
    """Each coordinate is the quantile of its own score, also where one in 10^15 cut-ins lies."""
    scores = np.array([-6.0, -2.0, 0.0, 2.0, 8.0])
    z = np.stack(np.meshgrid([-1.5, 1.5], scores, scores), axis=-1).reshape(-1, 3)
    cut_ins = law.from_normal_scores(z)
    for side, stratum in zip((-1.5, 1.5), law.strata.values(), strict=True):
        here = z[:, 0] == side
        place = cut_ins.lead_speed[here], cut_ins.inverse_range[here]
        expected = [
            normal_score_quantile(f, z[here, column])
            for column, f in ((1, stratum.factors.first), (2, stratum.factors.second))
        ]
        np.testing.assert_allclose(stratum.first(*place), expected[0], rtol=1e-6, atol=1e-14)
        np.testing.assert_allclose(
            stratum.second(*place, cut_ins.closing_speed[here]), expected[1], rtol=1e-9
        )
    assert not np.any(law.from_normal_scores(z[:0]).lead_speed)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_coordinates_and_cut_ins_are_inverse(law):
    generator = np.random.default_rng(3)
    for stratum in law.strata.values():
        speed = stratum.lead_speed.rvs(generator, 100)
        first, second = stratum.factors.rvs(generator, 100)
        cut_ins = stratum.cut_ins(speed, first, second)
        np.testing.assert_allclose(stratum.first(speed, cut_ins.inverse_range), first, rtol=1e-9)
        back = stratum.second(speed, cut_ins.inverse_range, cut_ins.closing_speed)
        np.testing.assert_allclose(back, second, rtol=1e-9)
        step = 1e-6 * cut_ins.inverse_range
        rise = stratum.first(speed, cut_ins.inverse_range + step) - stratum.first(
            speed, cut_ins.inverse_range - step
        )
        slope = np.exp(stratum.log_first_slope(speed, cut_ins.inverse_range))
        np.testing.assert_allclose(rise / (2 * step), slope, rtol=1e-5)


@pytest.mark.parametrize("place", [(5.0, LOWER), (12.0, 0.02), (9.0, 0.5)])
@pytest.mark.parametrize(
    ("start", "end"), [(0.0, 3.0), (2.0, 2.0001), (6.0, 20.0), (8.0, np.inf), (0.0, np.inf)]
)
def test_probability_of_closing_speeds_is_the_closed_form(place, start, end):
    """Down to 10^-36, where a difference of distribution functions would be 0."""
    speed, inverse_range = place
    place = [np.array([value]) for value in (speed, inverse_range, start, end)]
    found = DEPENDENT.strata["slow"].closing_speed_probability(*place)
    with mpmath.workdps(100):
        width = mpmath.mpf(float(scale(speed, inverse_range)))
        below, above = (mpmath.exp(-((mpmath.mpf(float(edge)) / width) ** POWER)) for edge in (start, end))
        assert found.tolist() == pytest.approx([float(below - above)], rel=1e-8, abs=0)
    law = INDEPENDENT.strata["fast"]  # exponential TTC^-1 of rate 21
    found = law.closing_speed_probability(
        *(np.array([value]) for value in (speed, inverse_range, start, end))
    )
    with mpmath.workdps(100):
        below, above = (mpmath.exp(-21 * mpmath.mpf(float(edge)) * inverse_range) for edge in (start, end))
        assert found.tolist() == pytest.approx([float(below - above)], rel=1e-8, abs=0)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
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


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_cells_of_a_map_hold_all_cut_ins(law):
    cells = GRID.cells(np.full((GRID.lead_speed_cells, GRID.range_cells), 2))
    cut_ins, index = drawn(law, 200_000)
    near = (cut_ins.inverse_range >= 0.02) & (cut_ins.inverse_range < 0.05)
    for k, stratum in enumerate(law.strata.values()):
        chance = stratum.cell_probability(cells.lead_speed, cells.inverse_range)
        assert chance.sum() == pytest.approx(1, rel=1e-12)
        narrow = cells.lead_speed.copy(), np.tile([0.02, 0.05], (len(cells.root), 1))
        columns = cells.root[:, 1] == 0  # one cell of each v_L
        part = stratum.cell_probability(narrow[0][columns], narrow[1][columns]).sum()
        error = math.sqrt(part * (1 - part) / (index == k).sum())
        assert near[index == k].mean() == pytest.approx(part, rel=0, abs=4 * error)


def test_shares_of_lead_speeds_leave_out_the_upper_edge():
    stratum = replace(DEPENDENT.strata["slow"], lead_speed=Empirical([5.0, 6.0, 6.0, 7.0]))
    edges = np.array([[5.0, 6.0], [6.0, 7.0], [7.0, 8.0], [5.0, 8.0], [6.5, 6.9]])
    assert stratum.lead_speed_share(edges).tolist() == [0.25, 0.5, 0.25, 1.0, 0.0]


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
@pytest.mark.parametrize("name", ["slow", "fast"])
def test_one_stratum_is_a_law_of_its_own(law, name):
    law = replace(law, closing_speed_max=12.1)
    alone = law.only(name)
    assert dict(alone.shares) == {name: 1.0}
    assert [*alone.strata] == [name]
    assert alone.strata[name].factors == law.strata[name].factors
    assert (alone.description, alone.closing_speed_max) == (law.description, 12.1)
    assert type(alone) is type(law)
    assert sum(law.shares.values()) == pytest.approx(1)
    cut_ins, index = drawn(alone)
    assert set(index) == {0}
    assert kstest(cut_ins.lead_speed, law.strata[name].lead_speed.cdf).pvalue > DOUBTFUL
    scored = alone.from_normal_scores(np.array([[-9.0, 0, 0], [9.0, 0, 0]])).lead_speed
    speeds = law.strata[name].lead_speed
    assert scored.tolist() == [speeds.lower, speeds.upper]
    with pytest.raises(KeyError):
        law.only("unknown")


def test_the_generator_alone_decides():
    for law in LAWS.values():
        (one, first), (two, second) = drawn(law, 50), drawn(law, 50)
        np.testing.assert_array_equal(first, second)
        for name, values in vars(one).items():
            np.testing.assert_array_equal(values, getattr(two, name))
