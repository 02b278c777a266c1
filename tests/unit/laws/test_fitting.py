"""Fits: zero scores, known parameters, an independent optimizer, brute force, the published lane changes."""

import itertools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.base.errors import ConvergenceError, InputError
from accelerated_evaluation.laws.distributions import (
    BoundedExponential,
    BoundedNormal,
    Mixture,
    Pareto,
    PiecewiseMixture,
)
from accelerated_evaluation.laws.paper.models import (
    choose_knots,
    fit_exponential_from_zero,
    fit_paper_laws,
    refit,
)
from accelerated_evaluation.laws.paper.piecewise import (
    EXPONENTIAL,
    PieceFamily,
    fit_piecewise,
    knots_at_quantiles,
    knots_by_profile_likelihood,
)
from accelerated_evaluation.study.configuration import load
from scipy.optimize import minimize

RECORDS = Path(__file__).resolve().parents[3] / "data" / "spmd" / "cut_ins.parquet"

NORMAL, TWO_NORMALS = PieceFamily("bounded normal"), PieceFamily("bounded normal", 2)
BODY = Mixture((0.3, 0.7), (BoundedNormal(0.03, 0.0, 0.166), BoundedNormal(0.09, 0.0, 0.166)))
PIECEWISE = PiecewiseMixture((0.9, 0.1), (BODY, BoundedExponential(21.0, 0.166)))
SIZE = 20_000


def sample(law, size=SIZE, seed=1):
    return law.rvs(np.random.default_rng(seed), size)


def score_and_error(make, parameter, x):
    """Score at a parameter in units of its standard deviation, and the standard error, by differences."""
    step = 1e-3 * max(abs(parameter), 1e-3)
    low, middle, high = (
        make(value).logpdf(x).sum() for value in (parameter - step, parameter, parameter + step)
    )
    information = -(high - 2 * middle + low) / step**2
    return (high - low) / (2 * step) / math.sqrt(information), 1 / math.sqrt(information)


@pytest.mark.parametrize(
    "law",
    [
        *(BoundedExponential(rate, 0.0133, 0.0373) for rate in (107.0, 0.0, -60.0)),
        BoundedExponential(21.0, 0.166),
        *(BoundedNormal(sd, 0.0, 0.166) for sd in (0.03, 0.09)),
        BoundedNormal(0.1, 0.2, 0.5),
        BoundedNormal(0.1, 0.3),
        Pareto(1.7, 1 / 75),
    ],
)
def test_one_parameter_is_recovered_where_the_score_is_zero(law):
    x = sample(law)
    fitted = type(law).fit(x, law.lower, law.upper)
    assert fitted == PieceFamily(law.kind).fit(x, law.lower, law.upper)
    (parameter,) = law.parameters

    def make(value):
        return replace(law, **{parameter: value})

    score, error = score_and_error(make, getattr(fitted, parameter), x)
    assert abs(score) < 0.01  # differences of steps of 1e-3; a hundredth of a standard deviation in any case
    assert abs(getattr(fitted, parameter) - getattr(law, parameter)) < 4 * error
    if parameter == "rate" and math.isfinite(law.upper):
        assert abs(1 / (x.mean() - law.lower) - law.rate) > 4 * error  # the fit that forgets the upper bound


def test_em_never_falls_and_finds_what_an_independent_optimizer_finds():
    x, course = sample(BODY), []
    fitted = BoundedNormal.fit_mixture(x, 0.0, 0.166, 2, on_iteration=course.append)
    assert len(course) > 2
    assert np.all(np.diff(course) > -1e-9 * abs(course[-1]))  # but for the rounding of a sum
    assert fitted.logpdf(x).sum() == pytest.approx(course[-1], rel=1e-12)

    def make(parameters):
        share = 1 / (1 + math.exp(-parameters[0]))
        return Mixture((share, 1 - share), [BoundedNormal(math.exp(p), 0.0, 0.166) for p in parameters[1:]])

    def loss(parameters):
        return -make(parameters).logpdf(x).sum()

    best = minimize(
        loss,
        [0.0, math.log(0.04), math.log(0.08)],
        method="Nelder-Mead",
        options={"xatol": 1e-6, "fatol": 1e-7},
    )
    independent = make(best.x)
    assert -best.fun - 1e-10 * SIZE < course[-1] < -best.fun + 1e-3
    ours, theirs = ([*law.weights, *(part.sd for part in law.components)] for law in (fitted, independent))
    np.testing.assert_allclose(ours, theirs, rtol=1e-3)
    truth = [*BODY.weights, *(part.sd for part in BODY.components)]
    np.testing.assert_allclose(ours, truth, rtol=0.15)  # about four standard errors of the smaller component
    assert [part.sd for part in fitted.components] == sorted(part.sd for part in fitted.components)


def test_em_that_has_not_converged_says_so():
    with pytest.raises(ConvergenceError, match=r"EM for 2 .* limit 3 iterations"):
        BoundedNormal.fit_mixture(sample(BODY), 0.0, 0.166, 2, maximum_iterations=3)


@pytest.mark.parametrize("rate", [0.0, -30.0])
@pytest.mark.parametrize("components", [1, 2])
def test_no_normal_fits_what_does_not_fall(rate, components):
    x = BoundedExponential(rate, 0.0, 0.166).ppf((np.arange(SIZE) + 0.5) / SIZE)
    with pytest.raises(ConvergenceError, match="does not decrease"):
        PieceFamily("bounded normal", components).fit(x, 0.0, 0.166)


def test_piecewise_fit_is_that_of_its_pieces():
    x = sample(PIECEWISE)
    fitted = fit_piecewise(x, 0.0, [0.166], [TWO_NORMALS, EXPONENTIAL])
    body, tail = x[x < 0.166], x[x >= 0.166]
    assert fitted.weights == (body.size / SIZE, tail.size / SIZE)
    assert fitted.components == (
        BoundedNormal.fit_mixture(body, 0.0, 0.166, 2),
        BoundedExponential.from_mean(tail.mean(), 0.166),
    )
    assert fitted.weights[1] == pytest.approx(0.1, abs=4 * math.sqrt(0.09 / SIZE))
    assert fitted.components[1].rate == pytest.approx(21, rel=4 / math.sqrt(tail.size))
    assert refit(fitted, x) == fitted


@pytest.mark.parametrize(
    ("x", "knots", "message"),
    [
        ([0.1, 0.2, 0.3], [0.5], r"piece \[0.5, inf\): seen 0 observations"),
        ([0.1, 0.2, 0.6, 0.6], [0.5], r"piece \[0.5, inf\): seen 2 observations"),
        ([0.1, 0.2, 0.3], [0.25, 0.2], r"piece \[0.25, 0.2\): seen 0 observations"),
        ([-0.1, 0.1, 0.2, 0.3, math.nan, math.inf], [0.15], "seen 3 of 6 values outside"),
    ],
)
def test_a_piece_without_data_and_data_without_a_piece_are_refused(x, knots, message):
    with pytest.raises(InputError, match=message):
        fit_piecewise(np.array(x), 0.0, knots, [EXPONENTIAL] * (len(knots) + 1))


def test_knots_at_quantiles_and_values():
    x = np.arange(101.0)
    assert knots_at_quantiles(x, [0.5, 0.955]) == [50.0, 95.5]
    families = [EXPONENTIAL] * 3
    assert choose_knots(x, 0.0, families, {"method": "quantiles", "quantiles": [0.5, 0.955]}) == [50.0, 95.5]
    assert choose_knots(x, 0.0, families, {"method": "values", "values": [3.0, 7.0]}) == [3.0, 7.0]
    profile = {"method": "profile", "profile": {"low": 0.1, "high": 0.9, "points": 9}}
    x = sample(BoundedExponential(3.0))
    assert choose_knots(x, 0.0, families, profile) == knots_by_profile_likelihood(
        x, 0.0, families, np.linspace(0.1, 0.9, 9)
    )


@pytest.mark.parametrize("families", [[EXPONENTIAL] * 3, [NORMAL, EXPONENTIAL]])
def test_profile_likelihood_equals_brute_force(families):
    x = sample(PIECEWISE, 3000)
    quantiles = np.linspace(0.1, 0.98, 8)
    grid = np.quantile(x, quantiles)
    likelihood = {}
    for knots in itertools.combinations(grid, len(families) - 1):
        fitted = fit_piecewise(x, 0.0, knots, families)
        if [PieceFamily.of(piece) for piece in fitted.components] == families:  # none had to be simpler
            likelihood[knots] = fitted.logpdf(x).sum()
    assert len(likelihood) > 2
    assert tuple(knots_by_profile_likelihood(x, 0.0, families, quantiles)) == max(
        likelihood, key=likelihood.get
    )


def test_profile_likelihood_recovers_a_known_knot():
    law = PiecewiseMixture((0.7, 0.3), (BoundedExponential(-10.0, 0.0, 0.2), BoundedExponential(20.0, 0.2)))
    (knot,) = knots_by_profile_likelihood(sample(law), 0.0, [EXPONENTIAL] * 2, np.linspace(0.02, 0.98, 193))
    assert law.cdf(knot) == pytest.approx(0.7, abs=0.0051)  # one step of the grid


def test_profile_likelihood_without_a_fit_says_so():
    x = sample(BoundedExponential(-30.0, 0.0, 0.166))
    with pytest.raises(ConvergenceError, match="no interval of the grid"):
        knots_by_profile_likelihood(x, 0.0, [NORMAL, EXPONENTIAL], [0.5, 0.9])


def segmented(inverse_range, inverse_ttc, lead_speed):
    names = np.array(["5-15", "15-25", "25-35"])
    segment = names[np.digitize(lead_speed, [15, 25])]
    return pd.DataFrame(
        {
            "lead_speed": lead_speed,
            "inverse_range": inverse_range,
            "inverse_ttc": inverse_ttc,
            "segment": segment,
        }
    )


@pytest.fixture
def models():
    """Section models of the default configuration, R^-1 knots at quantiles, as a profile takes its time."""
    models = load()["models"]
    for variant in ("two_pieces", "three_pieces"):
        models["inverse_range"][variant]["method"] = "quantiles"
    return models


def test_the_papers_laws(models):
    generator = np.random.default_rng(4)
    lead_speed = np.concatenate(
        [np.linspace(25, 34, 500), np.linspace(5, 14, 2000), np.linspace(15, 24, 1000)]
    )
    inverse_range = BoundedExponential(60.0, 1 / 75).rvs(generator, lead_speed.size)
    encounters = segmented(inverse_range, PIECEWISE.rvs(generator, lead_speed.size), lead_speed)
    fitted = fit_paper_laws(encounters, models, 75, "made up", 23.49)
    assert {name: model.n_parameters for name, model in fitted.items()} == {
        "two_pieces": 18,
        "three_pieces": 20,
        "single": 4,
    }
    for model in fitted.values():
        assert model.counts == {"5-15": 2000, "15-25": 1000, "25-35": 500}
        assert model.segments == ("5-15", "15-25", "25-35")
        assert model.inverse_range.lower == 1 / 75
        assert model.description == "made up"
        assert model.closing_speed_max == 23.49
    x = encounters.loc[encounters["segment"] == "15-25", "inverse_ttc"].to_numpy()
    assert fitted["two_pieces"].inverse_ttc["15-25"].knots == (np.quantile(x, 0.95),)
    assert fitted["single"].inverse_ttc["15-25"].rate == pytest.approx(1 / x.mean())


def test_fits_to_the_recorded_lane_changes():
    lead_speed, inverse_range, inverse_ttc = pd.read_parquet(RECORDS).to_numpy().T
    encounters = segmented(inverse_range, inverse_ttc, lead_speed)
    assert Pareto.fit(inverse_range, 1 / 75).shape == pytest.approx(1.7320507600110688, rel=1e-12)
    groups = {name: group["inverse_ttc"].to_numpy() for name, group in encounters.groupby("segment")}
    rates = {name: round(fit_exponential_from_zero(x).rate, 2) for name, x in groups.items()}
    assert rates == {"5-15": 15.81, "15-25": 33.12, "25-35": 46.84}
    (knot,) = knots_at_quantiles(groups["5-15"], [0.95])
    assert knot == pytest.approx(0.16584979763175556, rel=1e-14)
    fitted = fit_piecewise(groups["5-15"], 0.0, [knot], [NORMAL, EXPONENTIAL])
    assert fitted.components[1].rate == pytest.approx(21.084581450393657, rel=1e-12)
