"""Figures 1, 2, 4 to 7 and model tables: values against their laws, no record shown, same bytes twice."""

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.laws import Factors
from accelerated_evaluation.laws import distributions as dist
from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.publishing.figures import data as concept_figures
from accelerated_evaluation.publishing.figures import data as data_figures
from accelerated_evaluation.publishing.figures import laws as law_figures
from accelerated_evaluation.publishing.figures import models as model_figures
from accelerated_evaluation.publishing.tables.models import (
    candidates_table,
    close_call_table,
    parameter_table,
    rank_table,
)

SOURCE = "simulated for a test"
EDGES = (5, 15, 25, 35)
SEGMENTS = ("5-15", "15-25", "25-35")
EVENTS = {"5-15": 3000, "15-25": 2000, "25-35": 1500}
LOWER = 1 / 75


def pieces_of_range(knots: tuple[float, ...]) -> dist.PiecewiseMixture:
    bounds = (LOWER, *knots, np.inf)
    rates = np.linspace(110, 40, len(bounds) - 1)
    components = [
        dist.BoundedExponential(rate, low, high)
        for rate, low, high in zip(rates, bounds, bounds[1:], strict=False)
    ]
    weights = {2: (0.8, 0.2), 3: (0.7, 0.2, 0.1)}[len(components)]
    return dist.PiecewiseMixture(weights, components)


def pieces_of_ttc(scale: float) -> dist.PiecewiseMixture:
    knot = 0.15 * scale
    body = dist.Mixture((0.3, 0.7), [dist.BoundedNormal(sd * scale, 0.0, knot) for sd in (0.03, 0.08)])
    return dist.PiecewiseMixture((0.9, 0.1), [body, dist.BoundedExponential(20 / scale, knot)])


SCALES = dict(zip(SEGMENTS, (1.0, 0.7, 0.5), strict=True))
TTC = {segment: pieces_of_ttc(scale) for segment, scale in SCALES.items()}
SPEEDS = dict.fromkeys(SEGMENTS, dist.Empirical([10.0]))
TWO = IndependentLaw(SOURCE, EVENTS, pieces_of_range((0.037,)), TTC, SPEEDS)
THREE = IndependentLaw(SOURCE, EVENTS, pieces_of_range((0.029, 0.06)), TTC, SPEEDS)
SINGLE = IndependentLaw(
    SOURCE,
    EVENTS,
    dist.Pareto(1.7, LOWER),
    {segment: dist.BoundedExponential(16 / scale) for segment, scale in SCALES.items()},
    SPEEDS,
)
PROPOSALS = {
    "single": {"5-15": Factors(dist.BoundedExponential(80.0, LOWER), dist.BoundedExponential(1.6))},
    "piecewise": {
        "5-15": Factors(
            TWO.inverse_range.accelerated((50.0, 10.0), (0.5, 0.5)),
            TTC["5-15"].accelerated((8.0, 17.0), (0.01, 0.99)),
        )
    },
}


@pytest.fixture(scope="module")
def encounters() -> pd.DataFrame:
    generator = np.random.default_rng(7)
    parts = []
    for (segment, size), low in zip(EVENTS.items(), EDGES, strict=False):
        inverse_range = TWO.inverse_range.rvs(generator, size)
        inverse_ttc = TTC[segment].rvs(generator, size)
        parts.append(
            pd.DataFrame(
                {
                    "lead_speed": generator.uniform(low, low + 10, size),
                    "range": 1 / inverse_range,
                    "closing_speed": inverse_ttc / inverse_range,
                    "inverse_range": inverse_range,
                    "inverse_ttc": inverse_ttc,
                    "segment": segment,
                }
            )
        )
    return pd.concat(parts, ignore_index=True)


FIGURES: dict[str, Callable] = {
    "fig01_concept": lambda e: concept_figures.fig01_concept(e, SINGLE, TWO, PROPOSALS, "5-15", SOURCE),
    "fig02_data": lambda e: data_figures.fig02_data(e, EDGES, SOURCE),
    "fig04_inverse_range_fit": lambda e: model_figures.fig04_inverse_range_fit(e, TWO, THREE, SOURCE),
    "fig05_inverse_ttc_fit": lambda e: model_figures.fig05_inverse_ttc_fit(e, TWO, "15-25", SOURCE),
    "fig06_inverse_range_comparison": lambda e: model_figures.fig06_inverse_range_comparison(
        e, TWO, SINGLE, SOURCE
    ),
    "fig07_inverse_ttc_comparison": lambda e: model_figures.fig07_inverse_ttc_comparison(
        e, TWO, SINGLE, "15-25", SOURCE
    ),
}
FITS = {
    "fig04_inverse_range_fit": {"2 pieces": TWO.inverse_range, "3 pieces": THREE.inverse_range},
    "fig05_inverse_ttc_fit": {"piecewise (2 pieces)": TTC["15-25"]},
    "fig06_inverse_range_comparison": {
        "piecewise (2 pieces)": TWO.inverse_range,
        "single (dist.Pareto)": SINGLE.inverse_range,
    },
    "fig07_inverse_ttc_comparison": {
        "piecewise (2 pieces)": TTC["15-25"],
        "single (exponential)": SINGLE.inverse_ttc["15-25"],
    },
}


def drawn(name: str, encounters: pd.DataFrame) -> tuple[pd.DataFrame, str, str, np.ndarray]:
    """Return the data of a figure of fits, its columns of x and density, and its records."""
    data = FIGURES[name](encounters)[1]
    if "range" in name:
        return data, "inverse_range_per_m", "density_m", encounters["inverse_range"].to_numpy()
    rows = encounters["segment"] == "15-25"
    return data, "inverse_ttc_per_s", "density_s", encounters.loc[rows, "inverse_ttc"].to_numpy()


@pytest.mark.parametrize("name", FITS)
def test_curves_are_the_laws(name, encounters):
    data, x, density, _ = drawn(name, encounters)
    for curve, law in FITS[name].items():
        body = data[(data["panel"] == "body") & (data["curve"] == curve)]
        tail = data[(data["panel"] == "tail") & (data["curve"] == curve)]
        np.testing.assert_array_equal(body[density], np.exp(law.logpdf(body[x].to_numpy())))
        np.testing.assert_array_equal(tail["survival"], law.sf(tail[x].to_numpy()))
        for rows in (body, tail):
            marked = rows.loc[rows["is_knot"].astype(bool), x]
            assert tuple(marked) == tuple(getattr(law, "knots", ()))


@pytest.mark.parametrize("name", FITS)
def test_the_other_law_would_not_pass(name, encounters):
    """The comparison above is sharp: another model's law differs from what is drawn."""
    data, x, density, _ = drawn(name, encounters)
    curve, law = next(iter(FITS[name].items()))
    wrong = dist.PiecewiseMixture(law.weights[::-1], law.components)
    body = data[(data["panel"] == "body") & (data["curve"] == curve)]
    assert not np.allclose(body[density], np.exp(wrong.logpdf(body[x].to_numpy())))


@pytest.mark.parametrize("name", FITS)
def test_records_are_counted_right(name, encounters):
    data, x, density, records = drawn(name, encounters)
    bins = data[(data["panel"] == "body") & (data["curve"] == "empirical")]
    width = bins["bin_width_per_m" if "range" in name else "bin_width_per_s"]
    ends = bins[x] + width / 2
    below = np.array([np.count_nonzero(records < end) for end in ends])
    assert abs(below[-1] - 0.99 * records.size) <= 1  # the last edge is the 99 % quantile
    np.testing.assert_array_equal(np.cumsum(bins["count"].astype(int))[:-1], below[:-1])
    np.testing.assert_allclose(bins[density] * width * records.size, bins["count"].astype(int), rtol=1e-12)
    tail = data[(data["panel"] == "tail") & (data["curve"] == "empirical")]
    np.testing.assert_allclose(tail["survival"], [np.mean(records > at) for at in tail[x]], atol=1e-12)


def test_components_add_up_to_the_body(encounters):
    data, x, density, _ = drawn("fig05_inverse_ttc_fit", encounters)
    body = data[data["panel"] == "body"].pivot_table(index=x, columns="curve", values=density)
    normals = [name for name in body if name.startswith("normal")]
    assert len(normals) == 2
    shared = body[[*normals, "piecewise (2 pieces)"]].dropna()
    assert len(shared) > 100
    np.testing.assert_allclose(shared[normals].sum(axis=1), shared["piecewise (2 pieces)"], rtol=1e-12)


def test_concept_shows_f_and_its_acceleration(encounters):
    data = FIGURES["fig01_concept"](encounters)[1]
    laws = {"single": SINGLE, "piecewise": TWO}
    for method, model in laws.items():
        for curve, law in {"f": model.inverse_ttc["5-15"], "f*": PROPOSALS[method]["5-15"].second}.items():
            rows = data[(data["method"] == method) & (data["curve"] == curve)]
            np.testing.assert_array_equal(
                rows["density_s"], np.exp(law.logpdf(rows["inverse_ttc_per_s"].to_numpy()))
            )
    assert data.loc[data["method"] == "single", "count"].sum() == EVENTS["5-15"]


def test_counts_of_the_data_map(encounters):
    data = FIGURES["fig02_data"](encounters)[1]
    assert (data.groupby("panel")["count"].sum() == len(encounters)).all()
    assert (data["count"] > 0).all()
    for row in data.sample(20, random_state=1).itertuples():
        variable, unit = ("range", "m") if row.panel == "range" else ("inverse_ttc", "per_s")
        low, high = getattr(row, f"{variable}_low_{unit}"), getattr(row, f"{variable}_high_{unit}")
        speed = encounters["lead_speed"].between(row.lead_speed_low_m_per_s, row.lead_speed_high_m_per_s)
        assert np.count_nonzero(speed & encounters[variable].between(low, high)) == row.count


@pytest.mark.parametrize("name", FIGURES)
def test_no_record_is_published(name, encounters):
    data = FIGURES[name](encounters)[1]
    numbers = data.select_dtypes("number").astype(float).to_numpy()
    records = encounters[["lead_speed", "range", "closing_speed", "inverse_range", "inverse_ttc"]].to_numpy()
    assert not np.isin(numbers, records).any()
    assert np.isin(encounters["range"], records).all()  # the check finds a record where there is one


def test_parameter_table_lists_every_component():
    table = parameter_table(TWO)
    assert len(table) == 2 + 3 * 3
    np.testing.assert_allclose(table.groupby(["variable", "segment"])["weight"].sum(), 1)
    tail = table[(table["segment"] == "15-25") & (table["to"] == np.inf)].iloc[0]
    assert (tail["family"], tail["parameter"], tail["value_unit"]) == ("bounded exponential", "rate", "s")
    assert tail["value"] == pytest.approx(20 / 0.7)
    pareto = parameter_table(SINGLE).iloc[0]
    assert (pareto["family"], pareto["parameter"], pareto["value"]) == ("Pareto", "shape", 1.7)


def test_published_parameters_of_candidates_have_no_digit_that_depends_on_the_processor():
    texts = ['{"shape": 0.801795523057148, "scale": 5.0}', "{}"]  # another processor: 0.801795
    shown = candidates_table(
        pd.DataFrame({"variable": "x", "segment": "all", "family": ["gamma", "beta"], "aic": 1.0}).assign(
            parameters=texts
        )
    )
    assert shown["parameters"].tolist() == ['{"shape": 0.8018, "scale": 5.0}', "{}"]


def test_rank_table_orders_families_and_marks_missing_fits():
    candidates = pd.DataFrame(
        {
            "variable": ["inverse_range"] * 3 + ["inverse_ttc"] * 3,
            "segment": ["all"] * 3 + ["5-15"] * 3,
            "family": ["a", "b", "c"] * 2,
            "n_parameters": [1, 2, 4, 1, 2, 6],
            "rank": [2, 1, 3, 1, np.nan, 2],
        }
    )
    table = rank_table(candidates)
    assert table.to_dict("list") == {
        "family": ["b", "a", "c"],
        "parameters": ["2", "1", "4 or 6"],
        "R⁻¹, all": ["1", "2", "3"],
        "TTC⁻¹, 5-15": ["–", "1", "2"],
    }


def test_close_calls_against_counts_and_laws(encounters):
    table = close_call_table(encounters, {"two": TWO, "single": SINGLE}, ranges=(10,), ttcs=(5,))
    assert table["cut_in"].tolist() == ["R < 10 m", *["TTC < 5 s"] * 3]
    assert table["segment"].tolist() == ["all", *SEGMENTS]
    assert table["events"].iloc[0] == np.count_nonzero(encounters["range"] < 10)
    slow = encounters[encounters["segment"] == "5-15"]
    assert table["events"].iloc[1] == np.count_nonzero(1 / slow["inverse_ttc"] < 5)
    np.testing.assert_allclose(
        table["empirical"].iloc[1], table["events"].iloc[1] / EVENTS["5-15"], rtol=1e-12
    )
    assert table["single"].iloc[0] == pytest.approx((10 / 75) ** 1.7)
    assert table["single"].iloc[1] == pytest.approx(np.exp(-16 / 5))
    # The records were drawn from the model: within five binomial standard errors of it.
    error = np.sqrt(table["two"] * (1 - table["two"]) / [len(encounters), *EVENTS.values()])
    assert ((table["empirical"] - table["two"]).abs() < 5 * error).all()


def test_the_scores_are_drawn_if_few_records_refuse_all_laws():
    gains = pd.DataFrame({"law": ["all laws, weighted", "hazard", "two kinds 0.9"]})
    for number, region in enumerate(law_figures.REGIONS):
        gains[region] = [5.0, 4.0 - number, 6.0]
        gains[region.replace("gain", "error")] = [0.3, 0.2, 0.0]
    gains = gains.assign(behind=[0.0, 4.0, 3.0], weight=[0.0, 0.4, 0.6], refused=True)
    drawn, _ = law_figures.fig21_scores(gains, "made up")
    assert all(np.isfinite(axes.get_xlim()).all() for axes in drawn.axes)
