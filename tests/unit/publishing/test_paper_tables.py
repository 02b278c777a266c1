"""The paper's tables beside ours: numbers against hand-computed ones, and how they are written."""

import math

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.methods.importance_sampling import estimate_from_weights, running
from accelerated_evaluation.publishing.tables import paper as paper_tables
from accelerated_evaluation.publishing.tables import searches as search_tables
from accelerated_evaluation.publishing.tables import spreads
from accelerated_evaluation.publishing.tables.display import readable, save_table
from accelerated_evaluation.publishing.tables.paper_claims import PAPER_SIMULATIONS
from builders import two_laws

Z = 1.2815515655446004  # 90 % quantile of the standard normal


def estimates(simulations, scope="all", **columns):
    rows = [
        {"study": "test", "scope": scope, "method": method, "replicate": number, "simulations": n}
        for method, values in simulations.items()
        for number, n in enumerate(values)
    ]
    default = {
        "probability": 1e-6,
        "ci_low": 8e-7,
        "ci_high": 1.2e-6,
        "relative_half_width": 0.2,
        "events": 120,
        "effective_sample_size": 40.0,
        "largest_weight_share": 0.1,
        "converged": True,
    }
    return pd.DataFrame(rows).assign(**(default | columns))


def course(rows, method="piecewise", scope="all"):
    names = ["replicate", "simulations", "probability", "variance"]
    return pd.DataFrame(rows, columns=names).assign(method=method, scope=scope)


def trace(method, segment, seed, simulations, **parameters):
    total = np.concatenate([[0], np.cumsum(simulations)])
    iterations = range(1, total.size + 1)
    table = pd.DataFrame({"iteration": iterations, "simulations_total": total, **parameters})
    return table.assign(
        method=method,
        segment=segment,
        seed=seed,
        simulations=[math.nan, *simulations],
        sample=[math.nan, *simulations],
        crashes=50.0,
        effective_sample_size=10.0 + seed,
    )


TWO_PIECES = {
    "inverse_range_weight_1": [0.8, 0.3, 0.2],
    "inverse_range_weight_2": [0.2, 0.7, 0.8],
    "inverse_range_theta_1": [0.0, 1.0, 2.0],
    "inverse_range_theta_2": [0.0, 0.0, 0.0],
    "inverse_range_from_1": [0.01, 0.01, 0.01],
    "inverse_range_from_2": [0.04, 0.04, 0.04],
    "inverse_ttc_from_2": [0.1, 0.1, 0.1],
}
COVERAGE = pd.DataFrame(
    {
        "method": ["single", "single"],
        "stopping": ["fixed", "sequential"],
        "replicates": [100, 100],
        "simulations_mean": [999.0, 420.0],
        "simulations_sd": [0.0, 20.0],
    }
)
ONE_RATE = {"inverse_range_rate": [9.0, 5.0, 4.0], "inverse_ttc_rate": [8.0, 3.0, 2.0]}


def exactly(probability):
    return pd.DataFrame({"segment": ["all"], "probability": [probability], "standard_error": [0.0]})


def searches():
    moved = TWO_PIECES | {"inverse_ttc_from_2": [0.1, 0.15, 0.2]}
    return pd.concat(
        [
            trace(method, segment, seed, [1000, extra + 1000 * seed], **parameters)
            for method, parameters in (("single", ONE_RATE), ("piecewise", TWO_PIECES), ("heuristic", moved))
            for segment, extra in (("5-15", 1000), ("15-25", 3000))
            for seed in (0, 1)
        ],
        ignore_index=True,
    )


def test_one_more_mean_is_expected_where_it_lies():
    """Of 4,000 pairs of means of 10 and 5 values, 95 % of the second lie in the interval of the first."""
    values = np.random.default_rng(1).normal(3.0, 2.0, (4000, 15))
    inside, confident = 0, 0
    for first, second in zip(values[:, :10], values[:, 10:].mean(axis=1), strict=True):
        spread = spreads.Mean.of(first).further("mean of 5", size=5)
        inside += spread.low <= second <= spread.high
        own = spreads.Mean.of(first).interval("values")
        confident += own.low <= second <= own.high  # the wrong interval: that of the true mean
    assert abs(inside / 4000 - 0.95) < 4 * math.sqrt(0.95 * 0.05 / 4000)
    assert confident / 4000 < 0.8
    assert spread.of == "95 % interval of one more mean of 5"


def test_one_value_and_equal_values_have_no_spread():
    for values in ([7.0], [7.0, 7.0]):
        spread = spreads.Mean.of(values).further("run")
        assert spread.value == 7
        assert math.isnan(spread.low)
        assert math.isnan(spread.high)


def test_the_interval_of_a_ratio_covers_it():
    generator = np.random.default_rng(2)
    ones, others = generator.normal(8.0, 1.0, (2000, 5)), generator.normal(5.0, 0.2, (2000, 8))
    ratios = [
        spreads.Mean.of(a).over(spreads.Mean.of(b)).interval("") for a, b in zip(ones, others, strict=True)
    ]
    covered = np.mean([ratio.low <= 1.6 <= ratio.high for ratio in ratios])
    assert abs(covered - 0.95) < 4 * math.sqrt(0.95 * 0.05 / 2000)
    exact = spreads.Mean(8.0, 0.0, math.inf).over(spreads.Mean(4.0, 0.4, 3))
    assert exact == spreads.Mean(2.0, pytest.approx(0.2), pytest.approx(3))


def test_sizes_are_compared_with_the_replicates_of_the_coverage():
    ends = estimates({"single": [300, 500], "toy": [100, 300]}, converged=[True, True, True, False])
    mean = spreads.simulations_needed(ends, COVERAGE, "single")
    half_width = 1.984 * 20 * math.sqrt(1 / 100 + 1 / 2)  # Student's t with 99 degrees of freedom
    assert mean.value == 400
    assert (mean.low, mean.high) == pytest.approx((420 - half_width, 420 + half_width), abs=0.02)
    assert mean.of == "95 % interval of one more mean of 2 (from 100 replicates)"
    first = spreads.simulations_needed(ends, COVERAGE, "single", first=True)
    assert first.value == 300
    assert first.high - first.low == pytest.approx(2 * 1.984 * 20 * math.sqrt(1.01), abs=0.05)
    own = spreads.simulations_needed(ends, COVERAGE, "toy")  # it is not in the study of coverage
    assert own.high - own.value == pytest.approx(12.706 * 100 * math.sqrt(2), abs=0.1)
    assert own.of.endswith("(from 2 replicates), 1 not converged")


def test_pooled_probability_by_hand():
    rows = [(0, 50, 9.0, 9.0), (0, 100, 1e-6, 4e-14), (1, 300, 2e-6, 1e-14)]
    pooled = spreads.pooled_probability(course(rows), "piecewise", 0.2)
    half_width = Z * math.sqrt(0.25**2 * 4e-14 + 0.75**2 * 1e-14)
    assert pooled.value == pytest.approx(1.75e-6, rel=1e-12)
    assert pooled.low == pytest.approx(1.75e-6 - half_width, rel=1e-12)
    assert pooled.high == pytest.approx(1.75e-6 + half_width, rel=1e-12)
    assert pooled.of == "80 % interval of 400 simulations"


def test_pooling_replicates_is_estimating_from_all_their_weights():
    weights = 0.1 * np.random.default_rng(1).exponential(size=(10, 5000))
    ends = [running(w, 0.2) for w in weights]
    rows = [(k, 5000, end.probability[-1], end.variance[-1]) for k, end in enumerate(ends)]
    pooled = spreads.pooled_probability(course(rows), "piecewise", 0.2)
    whole = estimate_from_weights(weights.ravel(), 0.2, converged=True)
    assert pooled.value == pytest.approx(whole.probability, rel=1e-12)
    # The spread between replicates is left out of the pooled variance: ten of 50,000 degrees of freedom.
    assert pooled.high - pooled.low == pytest.approx(whole.high - whole.low, rel=1e-3)


def test_crude_sample_size_is_the_papers_for_the_papers_probability():
    size = spreads.crude_sample_size(exactly(7.4e-7), 0.2, 0.2)
    assert float(f"{size.value:.1e}") == PAPER_SIMULATIONS["crude"]
    assert size.value == pytest.approx(Z**2 * (1 - 7.4e-7) / (0.04 * 7.4e-7), rel=1e-12)
    assert math.isnan(size.low)
    assert math.isnan(size.high)


def test_crude_sample_size_without_a_crash_is_infinite():
    assert spreads.crude_sample_size(exactly(0.0), 0.2, 0.2).value == math.inf


def test_table1_by_hand():
    ends = estimates({"single": [300, 500], "piecewise": [100, 300], "heuristic": [40, 60]})
    table = paper_tables.table1_sample_size(ends, COVERAGE, exactly(1e-6), 0.2, 0.2).set_index("method")
    assert list(table.index) == ["piecewise", "single", "crude", "heuristic"]
    assert table["simulations"].drop("crude").to_dict() == {"piecewise": 200, "single": 400, "heuristic": 50}
    assert table.loc["single", ["simulations_low", "simulations_high"]].mean() == pytest.approx(420)
    assert table.loc["single", "ratio_to_piecewise"] == 2
    assert table.loc["crude", "simulations"] == pytest.approx(Z**2 * (1 - 1e-6) / 0.04e-6)
    assert table["paper_simulations"].tolist()[:3] == [7840, 12320, 5.5e7]
    assert math.isnan(table.loc["heuristic", "paper_simulations"])


def test_replicates_of_a_segment_alone_do_not_enter_table1():
    ends = estimates({"single": [300], "piecewise": [100], "heuristic": [40]})
    others = estimates({"single": [7], "piecewise": [7], "heuristic": [7]}, scope="5-15")
    one, two = (
        paper_tables.table1_sample_size(table, COVERAGE, exactly(1e-6), 0.2, 0.2)
        for table in (ends, pd.concat([ends, others]))
    )
    pd.testing.assert_frame_equal(one, two)


def test_search_totals_add_segments_and_keep_seeds_apart():
    totals = search_tables.search_totals(searches())
    # 1000 + 1000 and 1000 + 3000 simulations with seed 0, a thousand more in each segment with seed 1.
    assert totals["single"].to_dict() == {0: 6000, 1: 8000}


def test_parameters_are_counted_where_they_move():
    table = searches()
    # Two rates in two segments; a weight and a theta in each, theta_2 never moving; and the moved knot.
    assert search_tables.searched_parameters(table, "single") == 4
    assert search_tables.searched_parameters(table, "piecewise") == 4
    assert search_tables.searched_parameters(table, "heuristic") == 6
    table.loc[table.index[-1], "inverse_range_theta_2"] = 1.0
    assert search_tables.searched_parameters(table, "heuristic") == 7


def test_table2_by_hand():
    models = two_laws({"5-15": 10, "15-25": 10})
    ends = estimates({"single": [300, 500], "piecewise": [100, 300], "heuristic": [40, 60]})
    table = paper_tables.table2_computation(
        ends, COVERAGE, exactly(1e-6), searches(), **models, alpha=0.2, beta=0.2
    )
    ours = table.set_index(["stage", "quantity", "method"])["ours"]
    assert ours["fitting", "parameters", "single"] == 3
    assert ours["fitting", "parameters", "piecewise"] == 9
    assert ours["Cross-Entropy", "simulations", "single"] == 7000
    assert ours["Cross-Entropy", "parameters", "heuristic"] == 6
    assert ours["simulation", "simulations", "piecewise"] == 200
    assert table["stage"].unique().tolist() == ["fitting", "Cross-Entropy", "simulation"]
    paper = table.dropna(subset="paper").set_index(["stage", "quantity", "method"])["paper"]
    assert paper["Cross-Entropy", "simulations", "piecewise"] == 24000
    assert "heuristic" not in paper.index.get_level_values("method")


def test_probability_table_counts_intervals_that_cover():
    ends = estimates({"piecewise": [1, 1, 1]}, ci_low=[1e-7, 1e-7, 3e-7], ci_high=[1e-6, 2e-7, 9e-7])
    (row,) = paper_tables.probability_table(ends, course([(0, 100, 2.5e-7, 1e-16)]), 0.2).to_dict("records")
    assert (row["covering"], row["replicates"], row["pooled"]) == (1, 3, 2.5e-7)
    assert row["at_convergence"] == pytest.approx(1e-6)


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (7840, "7,840"),
        (np.float64(6316.6), "6,317"),
        (7.4e-7, "7.4 × 10⁻⁷"),
        (5.5e7, "5.5 × 10⁷"),
        (-4.47e7, "-4.47 × 10⁷"),
        (1.5663, "1.57"),
        (0.44, "0.440"),
        (999.7, "1,000"),
        (0.0, "0"),
        (math.nan, "–"),
        (math.inf, "∞"),
        (True, True),
        ("text", "text"),
    ],
)
def test_readable_numbers(value, shown):
    assert readable(value) == shown


def test_tables_keep_numbers_in_csv_and_are_readable_elsewhere(tmp_path):
    table = pd.DataFrame({"label": ["a_b"], "N": [12320.0], "p": [7.4e-7]})
    for folder in ("one", "two"):
        save_table(table, tmp_path / folder, "t", digits=3)
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "one" / "t.csv"), table)
    assert "| 12,320 | 7.4 × 10⁻⁷ |" in (tmp_path / "one" / "t.md").read_text()
    assert r"a\_b & 12,320 & 7.4 $\times$ 10$^{-7}$" in (tmp_path / "one" / "t.tex").read_text()
    for ending in ("csv", "md", "tex"):
        assert (tmp_path / "one" / f"t.{ending}").read_bytes() == (
            tmp_path / "two" / f"t.{ending}"
        ).read_bytes()
