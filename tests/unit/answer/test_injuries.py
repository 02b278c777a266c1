"""Injuries: published points of the curves, integrals by mpmath, and the tables against closed forms."""

from dataclasses import dataclass, replace

import mpmath
import numpy as np
import pytest
from accelerated_evaluation.answer.consequences.injuries.curves import (
    FRONTAL,
    LEVELS,
    MILES_PER_HOUR,
    REAR,
    Logistic,
)
from accelerated_evaluation.answer.consequences.injuries.sources import SOURCES, published_curves
from accelerated_evaluation.answer.consequences.injuries.tables import (
    SPEEDS,
    Injured,
    MassRatio,
    balance_table,
    gentle,
    injuries_table,
    injury_budget,
    injury_tables,
    mean_risks,
    tabulated_risks,
)
from accelerated_evaluation.answer.consequences.rates import Rate
from accelerated_evaluation.answer.ways.posterior import Posterior
from accelerated_evaluation.crash_map import impacts as module
from accelerated_evaluation.crash_map.impacts import with_impacts
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.scenarios.cut_in import SPEED_LIMIT
from accelerated_evaluation.vehicles.protocol import Outcomes

KEYS = list(tabulated_risks())
HALF = Logistic(-6.9774, 0.1620, 2 * MILES_PER_HOUR)  # as a function of the impact speed, for equal masses


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("impact", [FRONTAL, REAR])
def test_every_level_has_curves_of_several_publications(level, impact):
    curves = published_curves(level, impact)
    assert len(curves) >= 2
    delta_v = np.linspace(0, 60, 200)
    for curve in curves.values():
        risk = curve(delta_v)
        assert (np.diff(risk) >= 0).all()
        assert risk.min() >= 0
        assert risk[-1] <= 1


def test_graver_injuries_are_rarer():
    """Up to 15 m/s; beyond, the curves of Malliaris cross, as their table of sources says."""
    delta_v = np.linspace(0, 15, 50)
    for name in ("wang_2022", "malliaris_1997"):
        curves = SOURCES[name].curves
        for impact in (FRONTAL, REAR):
            risks = [curves[level, impact](delta_v) for level in LEVELS]
            assert (risks[0] > risks[1]).all()
            assert (risks[1] > risks[2]).all()
    assert SOURCES["malliaris_1997"].curves["MAIS3+", FRONTAL](18.0) > 0.5


def test_the_curve_of_lubbe_meets_the_point_of_its_abstract():
    """10 % at a closing speed of 112 km/h, as far as coefficients with three decimals determine it."""
    curve = SOURCES["lubbe_2022"].curves["MAIS3+", FRONTAL]
    low, high = (closing / 3.6 / 2 for closing in (109, 116))
    assert curve(low) < 0.1 < curve(high)
    assert curve(2 * low) > 0.3  # the closing speed in place of the delta-v would not meet it


def test_other_published_points():
    # 31.74 m/s, where the rule of Joksch reaches 1, and 2 % at 27 mph.
    joksch = SOURCES["joksch_1993"].curves["fatal", FRONTAL]
    assert joksch(31.74) == pytest.approx(1, rel=1e-3)
    assert joksch(27 * MILES_PER_HOUR) == pytest.approx((27 / 71) ** 4)
    # Delta-v in miles per hour: the intercept and slope of the report, worked out by hand.
    wang = SOURCES["wang_2022"].curves["MAIS3+", FRONTAL]
    assert wang(30 * MILES_PER_HOUR) == pytest.approx(1 / (1 + np.exp(6.9774 - 0.1620 * 30)))
    assert wang(30 / 3.6) < 0.6 * wang(30 * MILES_PER_HOUR)
    # Belted occupants are injured less often than the mean of both groups, whose intercept is -6.068.
    kusano = SOURCES["kusano_2012"].curves["MAIS2+", FRONTAL]
    assert kusano(60.68 / 3.6) == pytest.approx(1 / (1 + np.exp(0.6234)))


@pytest.mark.parametrize("impact", [FRONTAL, REAR])
@pytest.mark.parametrize("speed", [0.5, 8.0, 30.0])
@pytest.mark.parametrize("mean", [0.0, 0.4])
def test_risks_are_averaged_over_the_masses(impact, speed, mean):
    masses, curve = MassRatio(mean), Logistic(-6.9774, 0.1620, MILES_PER_HOUR)
    sign = 1 if impact == FRONTAL else -1

    def integrand(z):
        share = 1 / (1 + mpmath.exp(-sign * (mean + masses.deviation * z)))
        return mpmath.npdf(z) / (1 + mpmath.exp(6.9774 - 0.1620 * speed * share / mpmath.mpf("0.44704")))

    exact = float(mpmath.quad(integrand, [-9, -3, 0, 3, 9]))
    found = masses.expected_risk(curve, impact, np.array([speed]))[0]
    assert found == pytest.approx(exact, rel=1e-6)
    # One mass for all cars is not the same.
    alike = MassRatio(mean, 0.0).expected_risk(curve, impact, np.array([speed]))[0]
    assert speed < 1 or abs(alike / exact - 1) > 0.005


def test_the_masses_have_the_percentiles_of_the_sales():
    """Two independent lognormal masses with 5 and 95 % at 2,800 and 5,850 lb."""
    generator = np.random.default_rng(1)
    deviation = np.log(5850 / 2800) / (2 * 1.6448536)
    lead, host = np.exp(np.log(np.sqrt(2800 * 5850)) + deviation * generator.standard_normal((2, 200_000)))
    assert np.quantile(host, [0.05, 0.95]) == pytest.approx([2800, 5850], rel=0.01)
    assert MassRatio().deviation == pytest.approx(np.log(lead / host).std(), rel=0.01)


@dataclass
class Exponential:
    """A closing speed with a constant hazard, at any place, in the place of a fitted law."""

    rate: float
    size = 1  # number of draws

    def given(self, places):
        return self

    def cumulative(self, speed, row=None):
        return self.rate * speed

    def inverse(self, level):
        return level / self.rate

    def with_cap_at(self, closing_speed_max):
        return self

    def log_slices(self, k, x, low, high):
        return np.log(np.exp(-self.rate * low) - np.exp(-self.rate * high))[None]


@dataclass
class Late:
    """A car that crashes above a closing speed, with what exceeds it as impact speed; or only in stripes."""

    first: float
    stripe: float = 0.0  # distance of the stripes [m/s]
    share: float = 0.5  # of the closing speeds, that is in the stripes

    def simulate(self, lead_speed, range_, closing_speed):
        crash = closing_speed > self.first
        if self.stripe:
            crash &= closing_speed / self.stripe % 1 < self.share
        impact = np.where(crash, closing_speed - self.first, 0.0)
        return Outcomes(crash, np.zeros(crash.size), np.zeros(crash.size), impact)


def lines_above(first, count=3):
    """Lines that crash above a closing speed, each in a third of all cut-ins."""
    ones = np.ones(count)
    places, never = Places.of(20 * ones, 10 * ones), np.inf * ones
    return CrashLines(places, ones / count, np.arange(count), first * ones, never)


def mean_risk(speed, risk):
    """Return the mean of a risk at `SPEEDS` over the crashes of each part."""
    return mean_risks(speed, {KEYS[0]: risk})[0]


def expected_exactly(rate, first):
    """Integrate the risk `HALF` over the closing speeds of a law with a constant hazard."""

    def integrand(x):
        mph = (x - first) / 2 / mpmath.mpf("0.44704")
        return rate * mpmath.exp(-rate * x) / (1 + mpmath.exp(6.9774 - 0.1620 * mph))

    return float(mpmath.quad(integrand, [first, first + 2, first + 10, first + 60]))


TAILS = [(0.7, 1.2, 0.012), (0.7, 0.7, 0.003), (0.7, 0.5, 0.02), (0.1, 0.3, 0.03), (0.3, 0.15, 0.05)]


@pytest.mark.parametrize(("guide", "rate", "error"), TAILS)
def test_injuries_of_a_law_are_an_integral(guide, rate, error):
    """The law that places the simulated speeds has the rate of the guide; other tails have a larger error."""
    guide, first = Exponential(guide), 4.0
    lines, speed = with_impacts(lines_above(first), Late(first), guide)
    masses = lines.masses(Exponential(rate))[0]
    assert masses.sum() == pytest.approx(np.exp(-rate * first), rel=1e-12)
    risk = mean_risk(speed, HALF(SPEEDS))
    exact = expected_exactly(rate, first)
    assert risk @ masses == pytest.approx(exact, rel=error)
    # The risk at the mean impact speed, which leaves out that the risk is convex, is too small.
    wrong = masses.sum() * float(HALF(np.array(1 / rate)))
    assert wrong < (1 - error) * exact


def test_one_point_in_an_interval_would_not_do(monkeypatch):
    for name, value in (("STEPS", np.empty(0)), ("POINTS", 1), ("INSIDE", np.array([0.5]))):
        monkeypatch.setattr(module, name, value)
    lines, speed = with_impacts(lines_above(4.0), Late(4.0), Exponential(0.7))
    risk = mean_risk(speed, HALF(SPEEDS))
    masses = lines.masses(Exponential(0.5))[0]
    assert risk @ masses < 0.9 * expected_exactly(0.5, 4.0)


def test_no_speed_above_the_limit_of_the_inputs_is_simulated():
    """With few records, a law may give quantiles of the closing speed that no vehicle accepts."""
    simulated = []

    class Watched(Late):
        def simulate(self, lead_speed, range_, closing_speed):
            simulated.append(closing_speed)
            return super().simulate(lead_speed, range_, closing_speed)

    with_impacts(lines_above(4.0), Watched(4.0), Exponential(1e-9))
    assert np.max(simulated) == SPEED_LIMIT


def test_points_without_a_crash_do_not_count():
    """A map in steps, of which only stripes crash: the mean is that of the crashes in a step."""
    lines = lines_above(4.0, count=2)
    steps = replace(lines, start=np.array([4.0, 9.9]), end=np.array([4.4, 10.3]))
    undivided, speed = with_impacts(steps, Late(4.0, stripe=0.2), Exponential(0.7))
    assert undivided.row.size == 2  # narrow intervals are not divided
    crashed = ~np.isnan(speed)
    assert crashed.any(axis=1).all()
    assert not crashed.all()
    assert mean_risk(speed, SPEEDS) == pytest.approx(
        [speed[0][crashed[0]].mean(), speed[1][crashed[1]].mean()]
    )
    # A car that never crashes in them counts as touching.
    _, never = with_impacts(steps, Late(99.0), Exponential(0.7))
    assert mean_risk(never, SPEEDS + 1.0) == pytest.approx([1, 1])


@pytest.mark.parametrize("found", [True, False])
def test_a_narrow_stripe_has_the_impact_speed_of_its_crashes(monkeypatch, found):
    """Not that of a touch, which such a part has if only a few of its points are simulated."""
    if not found:
        monkeypatch.setattr(module, "DENSEST", module.POINTS)
    steps = replace(lines_above(4.0, count=2), start=np.array([4.1, 9.9]), end=np.array([4.4, 10.2]))
    vehicle = Late(4.0, stripe=0.25, share=0.002)  # stripes of 0.5 mm/s from 4.25 and 10 m/s
    _, speed = with_impacts(steps, vehicle, Exponential(0.7))
    errors = mean_risk(speed, SPEEDS) - [0.25, 6.0]
    assert (np.abs(errors) <= vehicle.stripe * vehicle.share).all() == found


class Individual(Late):
    """A driver with a closing speed of its own on each line, above which it crashes."""

    def draw_inner(self, size, generator):
        raise AssertionError("the lines have inner variables")

    inner_weights = draw_inner

    def simulate(self, lead_speed, range_, closing_speed):
        raise AssertionError("the lines have inner variables")

    def simulate_given(self, lead_speed, range_, closing_speed, inner):
        return Late(inner[:, 0]).simulate(lead_speed, range_, closing_speed)


def test_a_driver_on_a_line_has_the_inner_variables_of_the_line():
    first = np.array([3.0, 5.0, 9.0])
    lines = replace(lines_above(0.0), start=first, inner=first[:, None])
    divided, speed = with_impacts(lines, Individual(0.0), Exponential(0.7))
    assert not np.isnan(speed).any()
    _, alike = with_impacts(replace(lines_above(0.0), start=first), Late(3.0), Exponential(0.7))
    excess = first[divided.row][:, None] - 3.0
    np.testing.assert_allclose(speed, alike - excess, atol=1e-9)


def test_a_vehicle_that_never_crashes_has_no_parts():
    lines = lines_above(4.0, count=1)
    empty = replace(lines, row=lines.row[:0], start=lines.start[:0], end=lines.end[:0])
    divided, speed = with_impacts(empty, Late(1.0), Exponential(1.0))
    assert divided.row.size == 0
    assert mean_risks(speed, tabulated_risks()).shape == (len(KEYS), 0)


def drawn(generator, scale=1.0, draws=400, laws=(1.0, 3.0)):
    """A posterior, and risks that are a common factor, times that of a law, times that of a curve."""
    member = generator.integers(len(laws), size=draws)
    crash = 1e-6 * generator.lognormal(0, 0.5, draws) * np.array(laws)[member]
    curves = 0.01 * (1 + np.arange(len(KEYS)))
    return Posterior(scale * crash, member), scale * crash[:, None] * curves


def test_the_budget_finds_the_variance_of_each_source():
    posterior, expected = drawn(np.random.default_rng(1), draws=20_000)
    found = Injured.of(posterior, expected, KEYS, "MAIS3+")
    assert found.numbers.shape == (20_000, 6)
    assert found.combinations == [(a, b) for a in found.sources[0] for b in found.sources[1]]
    variances = found.variances()
    multipliers = found.numbers[0] / posterior.probabilities[0]
    assert variances["data"] == pytest.approx(0.5**2, rel=0.05)
    assert variances["choice of law"] == pytest.approx(np.log(3) ** 2 / 4, rel=0.05)
    assert variances["choice of curve"] == pytest.approx(np.log(multipliers).var(), rel=1e-9)
    assert sum(variances.values()) == pytest.approx(np.log(found.numbers).var(), rel=0.01)
    table = injury_budget({"MAIS3+": found}, 0.2)
    assert table["source"].tolist() == ["data", "choice of law", "choice of curve", "sampling", "together"]
    assert table["variance_share"][:4].sum() == pytest.approx(1)


def test_rates_and_ratios():
    first, second = (drawn(np.random.default_rng(1), scale) for scale in (1.0, 4.0))
    injured = {
        name: {level: Injured.of(*own, KEYS, level) for level in LEVELS}
        for name, own in (("ours", first), ("other", second))
    }
    table = injuries_table(injured, 1000, {"kilometres": 5000.0, "hours": None})
    assert set(table["per"]) == {"cut-in", "million kilometres"}
    rows = table.set_index(["vehicle", "level", "per"])
    for level in LEVELS:
        own, of_rate = rows.loc["ours", level, "cut-in"], rows.loc["ours", level, "million kilometres"]
        assert of_rate["mean"] == pytest.approx(1e6 * Rate(1000, 5000.0).law.mean() * own["mean"])
        assert own["low95"] < own["low80"] < own["median"] < own["high80"] < own["high95"]
        assert own["per_crash"] == pytest.approx(
            injured["ours"][level].numbers.mean() / first[0].probabilities.mean()
        )
    balance = balance_table(injured, "ours")
    assert balance["reference"].unique().tolist() == ["other"]
    # The law and the curve are the same for both, so that the ratio is known exactly.
    np.testing.assert_allclose(balance[["ratio", "ratio_low80", "ratio_high80"]], 0.25)
    assert (balance["fewer_injured"] == 1).all()
    # Without pairing the draws, it would not be.
    unpaired = injured["ours"]["fatal"].numbers / injured["other"]["fatal"].numbers[::-1]
    assert np.quantile(unpaired, 0.9) > 0.4


def test_a_study_without_exposure_has_no_rates():
    found = {"ours": {"fatal": Injured.of(*drawn(np.random.default_rng(1)), KEYS, "fatal")}}
    assert injuries_table(found, 1000, {"kilometres": None, "hours": None})["per"].tolist() == ["cut-in"]
    both = injuries_table(found, 1000, {"kilometres": 5000.0, "hours": 100.0})
    assert both["per"].tolist() == ["cut-in", "million kilometres", "million hours"]


def test_a_vehicle_that_never_crashes_injures_nobody():
    own, other = drawn(np.random.default_rng(1), 0.0), drawn(np.random.default_rng(2))
    tables = injury_tables(
        {"under test": own, "other": other}, "under test", KEYS, 1000, {"kilometres": 9.0, "hours": None}, 0.2
    )
    rows = tables["injuries"].set_index("vehicle").loc["under test"]
    assert (rows[["mean", "median", "high95"]] == 0).all().all()
    assert rows["per_crash"].isna().all()
    assert tables["risk_balance"]["fewer_injured"].tolist() == [1, 1, 1]
    assert tables["injury_budget"]["variance_share"].isna().all()
    # It cannot be a reference, and a rejected vehicle under test has no comparison.
    assert injury_tables(
        {"other": other, "never": own}, "other", KEYS, 9, {"kilometres": None, "hours": None}, 0.2
    )["risk_balance"].empty
    assert injury_tables({"never": own}, "other", KEYS, 9, {"kilometres": None, "hours": None}, 0.2)[
        "injury_budget"
    ].empty


def test_gentle_impacts_are_a_part_of_all():
    risks = tabulated_risks()
    for (level, impact, source), risk in risks.items():
        if level in LEVELS:
            slow = risks[gentle(level), impact, source]
            assert (slow[SPEEDS < 3] == risk[SPEEDS < 3]).all()
            assert not slow[SPEEDS >= 3].any()
