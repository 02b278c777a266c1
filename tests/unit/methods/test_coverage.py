"""The study of coverage: closed forms, its stream of replicates, and a verdict on dishonest intervals."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.methods import Stopping, coverage
from accelerated_evaluation.methods.coverage import (
    INTERVALS,
    Stream,
    coverage_of_replicates,
    predicted_size,
    replicate_rows,
    stop_crude,
    stop_importance_sampling,
)
from accelerated_evaluation.methods.importance_sampling import crude_simulations, first_converged, running
from accelerated_evaluation.methods.intervals import Sums

STOPPING = Stopping(alpha=0.2, beta=0.2, minimum_events=20, maximum_simulations=20_000)
EVENT_SHARE = 0.1


@pytest.fixture
def toy(monkeypatch):
    """Exponential weights of mean 1 for a tenth of the simulations, instead of simulated cut-ins."""

    def draw(problem, proposals, generator, size):
        crash = generator.random(size) < EVENT_SHARE
        return np.where(crash, generator.standard_exponential(size), 0.0)

    monkeypatch.setattr(coverage, "draw_weights", draw)


def rows_of(stop, replicates, weight_bound=None):
    rows = [
        {"method": "toy", "replicate": replicate, **row}
        for replicate in range(replicates)
        for row in replicate_rows(stop(), weight_bound)
    ]
    return pd.DataFrame(rows)


def test_foretold_size_is_that_of_the_weights_variance(toy):
    pilot = 200_000
    size = predicted_size(None, [{}, {}], np.random.default_rng(1), pilot, STOPPING)
    cov = math.sqrt(2 / EVENT_SHARE - 1)  # E w^2 = 2 share, E w = share
    # Of E w^2 / (E w)^2: sqrt(E w^4 / (E w^2)^2 / n) and twice the relative error of the mean.
    error = math.sqrt(24 / (4 * EVENT_SHARE) / (2 * pilot)) + 2 * cov / math.sqrt(2 * pilot)
    assert size == pytest.approx((1.2815515655446004 / 0.2 * cov) ** 2, rel=4 * error)


def test_replicates_follow_one_another_in_the_stream(toy):
    stream = Stream(None, {}, np.random.default_rng(2))
    first = stream.first(1500).copy()
    assert np.array_equal(stream.first(400), first[:400])
    stream.end_replicate(1000)
    assert np.array_equal(stream.first(500), first[1000:])
    assert stream.first(60_000).size == 60_000  # longer than a block


def test_every_way_to_stop_reads_the_same_simulations(toy):
    stream, fixed = Stream(None, {}, np.random.default_rng(3)), 900
    weights = Stream(None, {}, np.random.default_rng(3)).first(20_000)
    stopped = stop_importance_sampling(stream, fixed, STOPPING)
    first = first_converged(running(weights, 0.2), STOPPING)
    ours = stopped["sequential_gamma"][0].simulations
    for name, size in {
        "fixed": fixed,
        "fixed_gamma": fixed,
        "sequential": first,
        "sequential_gamma": ours,
    }.items():
        sums, converged = stopped[name]
        assert converged
        assert (sums.simulations, sums.events) == (size, np.count_nonzero(weights[:size]))
        assert sums.total == pytest.approx(weights[:size].sum(), rel=1e-12)
    used = max(fixed, first, ours)
    assert np.array_equal(stream.first(100), weights[used : used + 100])


def test_rules_that_are_not_met_are_reported(toy):
    limits = replace(STOPPING, maximum_simulations=600, beta=0.01)
    stopped = stop_importance_sampling(Stream(None, {}, np.random.default_rng(4)), 500, limits)
    for name in ("sequential", "sequential_gamma"):
        sums, converged = stopped[name]
        assert (sums.simulations, converged) == (600, False)
    assert stopped["fixed"][0].simulations == 500


def test_crude_monte_carlo_follows_its_law():
    probability, replicates = 1e-4, 1000
    generator = np.random.default_rng(5)
    table = rows_of(lambda: stop_crude(probability, generator, STOPPING), replicates, 1.0)
    sequential = table[table["stopping"] == "sequential"]
    assert set(sequential["events"]) == {42}  # (1.2816 / 0.2)^2 = 41.06
    error = math.sqrt(42 / replicates) / probability  # of the mean of a sum of 42 geometric numbers
    assert sequential["simulations"].mean() == pytest.approx(42 / probability, abs=4 * error)
    fixed = table[table["stopping"] == "fixed"]
    assert set(fixed["simulations"]) == {math.ceil(crude_simulations(probability, 0.2, 0.2))}
    assert fixed["events"].mean() == pytest.approx(41.06, abs=4 * math.sqrt(41.06 / replicates))


def test_the_rule_of_the_paper_under_covers_and_the_gamma_rule_does_not(monkeypatch):
    def draw(problem, proposals, generator, size):
        crash = generator.random(size) < EVENT_SHARE
        return np.where(crash, np.exp(1.2 * generator.standard_normal(size) - 0.72), 0.0)

    monkeypatch.setattr(coverage, "draw_weights", draw)
    stream = Stream(None, {}, np.random.default_rng(6))
    table = rows_of(lambda: stop_importance_sampling(stream, 1700, STOPPING), 1500)
    verdict = coverage_of_replicates(table, EVENT_SHARE).set_index("stopping")
    assert list(verdict.index) == list(INTERVALS)
    papers, ours = verdict.loc["sequential"], verdict.loc["sequential_gamma"]
    assert papers["coverage80"] < 0.8 - 2 * papers["coverage80_se"]
    assert papers["cov_true"] > papers["cov_reported"] + 2 * papers["cov_true_se"]
    assert ours["coverage80"] > 0.8
    assert ours["coverage95"] > 0.95
    assert ours["simulations_mean"] < 2 * papers["simulations_mean"]
    assert abs(verdict.loc["fixed", "bias"]) < 4 * verdict.loc["fixed", "bias_se"]


def test_verdict_by_hand():
    rows = pd.DataFrame(
        {
            "method": "toy",
            "stopping": "fixed",
            "converged": [True, True, False, True],
            "simulations": [10, 20, 30, 40],
            "probability": [0.9, 1.1, 1.3, 1.1],
            "cov_reported": [0.1, 0.2, 0.3, np.nan],
            "ci80_low": [0.8, 1.0, 1.2, 1.05],
            "ci80_high": [1.0, 1.2, 1.4, 1.15],
            "ci95_low": [0.0, 0.9, 1.1, 1.0],
            "ci95_high": [2.0, 1.3, 1.5, 1.2],
        }
    )
    (row,) = coverage_of_replicates(rows, 1.0, 0.3).to_dict("records")
    assert (row["replicates"], row["converged"], row["simulations_mean"]) == (4, 0.75, 25)
    assert row["bias"] == pytest.approx(0.1)
    assert row["cov_true"] == pytest.approx(math.sqrt(0.08 / 3))
    assert row["bias_se"] == pytest.approx(math.hypot(math.sqrt(0.08 / 12), 0.3))
    assert row["cov_reported"] == pytest.approx(0.2)
    assert (row["coverage80"], row["coverage95"]) == (0.5, 0.75)
    assert row["coverage80_se"] == pytest.approx(0.25)


@pytest.mark.parametrize(("reported", "honest"), [(1.0, True), (0.8, False)])
def test_a_method_that_reports_too_little_is_found(reported, honest):
    generator, cov = np.random.default_rng(7), 0.15
    probability = 1 + cov * generator.standard_normal(4000)
    z80, z95 = 1.2815515655446004, 1.959963984540054
    rows = pd.DataFrame(
        {"method": "toy", "stopping": "fixed", "converged": True, "simulations": 100}, range(4000)
    )
    rows = rows.assign(probability=probability, cov_reported=reported * cov)
    for level, z in ((80, z80), (95, z95)):
        rows = rows.assign(
            **{
                f"ci{level}_low": probability - z * reported * cov,
                f"ci{level}_high": probability + z * reported * cov,
            }
        )
    (row,) = coverage_of_replicates(rows, 1.0).to_dict("records")
    assert (abs(row["cov_true"] - row["cov_reported"]) < 4 * row["cov_true_se"]) == honest
    assert row["cov_true_se"] == pytest.approx(cov / math.sqrt(2 * 4000), rel=0.1)
    for level in (80, 95):
        near = abs(row[f"coverage{level}"] - level / 100) < 4 * math.sqrt(
            level / 100 * (1 - level / 100) / 4000
        )
        assert near == honest


def test_rows_of_a_replicate_without_a_crash():
    sums = Sums.of(np.zeros(100))
    by_stopping = {row["stopping"]: row for row in replicate_rows(dict.fromkeys(INTERVALS, (sums, False)))}
    for row in by_stopping.values():
        assert math.isnan(row["cov_reported"])
        assert (row["ci80_low"], row["ci80_high"]) == (0, 1)
