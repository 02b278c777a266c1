"""What the answer rests on: parts by distance from the records, against exact shares of simple laws."""

from dataclasses import replace
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import CUT_IN, Answer, Crashes, Posterior
from accelerated_evaluation.answer.ways.extrapolation import (
    ALL,
    CAP,
    CAPPED,
    DISJOINT,
    FAR,
    HOST_UNSEEN,
    NEAR,
    RECORDED,
    extrapolation_in_words,
    extrapolation_table,
    parts_by_distance,
    parts_by_speed,
    rank_scores,
    speed_limits,
)
from accelerated_evaluation.answer.ways.near_misses import dispersion, level_factors, near_miss_table
from accelerated_evaluation.crash_map.lines import CrashLines, divided_at
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.publishing.figures.extrapolation import fig37_extrapolation
from accelerated_evaluation.publishing.tables.evidence import rests_in_words

# Lead speed, range and closing speed of four records.
RECORDS = np.array([[10.0, 20.0, 5.0], [10.5, 22.0, 8.0], [20.0, 50.0, 12.0], [30.0, 52.0, 3.0]])


def test_parts_by_speed():
    cut_ins = np.array(
        [
            [10.0, 21.0, 8.0],  # as fast as the second record
            [10.0, 21.0, 8.1],  # faster than it, not than the third; the host is faster than any near 10 m/s
            [10.0, 35.0, 1.0],  # no record at a similar range
            [30.0, 50.0, 12.5],  # faster than all, behind a faster lead than that of the third record
            [20.0, 50.0, CAP + 0.1],
        ]
    )
    parts = parts_by_speed(RECORDS, cut_ins)
    assert parts[RECORDED].tolist() == [True, False, False, False, False]
    assert parts[NEAR].tolist() == [False, True, True, False, False]
    assert parts[FAR].tolist() == [False, False, False, True, True]
    assert parts[CAPPED].tolist() == [False, False, False, False, True]
    # Largest host speeds near 10, 30 and 20 m/s: 18.5, 33 and 32 m/s.
    assert parts[HOST_UNSEEN].tolist() == [False, False, False, True, True]


def test_intervals_are_cut_at_the_limits_and_keep_their_probability():
    lines = CrashLines(
        Places.of([10.0, 20.0], [21.0, 50.0]),
        np.ones(2),
        np.array([0, 0, 1]),
        np.array([1.0, 9.0, 11.0]),
        np.array([4.0, np.inf, 30.0]),
    )
    limits = speed_limits(RECORDS, lines.places.lead_speed, lines.places.range_)
    cut, index = divided_at(lines, limits.values())
    np.testing.assert_array_equal(lines.row[index], cut.row)
    assert np.all(cut.start < cut.end)
    for row in (0, 1):
        for at in (0.0, 1.0, 12.0, 25.0):  # the same probability of a unit exponential speed above any point
            inside = [
                np.sum(
                    np.exp(-np.maximum(part.start, at)) - np.exp(-np.maximum(part.end, at)),
                    where=part.row == row,
                )
                for part in (lines, cut)
            ]
            assert inside[0] == pytest.approx(inside[1], rel=1e-12)
    limit = np.column_stack(list(limits.values()))[cut.row]
    below = (cut.start[:, None] >= limit) | (cut.end[:, None] <= limit)
    assert below.all()
    assert np.all(cut.inside[:, 2] > cut.start)
    uncut = np.column_stack(list(limits.values()))[lines.row]
    assert not ((lines.start[:, None] >= uncut) | (lines.end[:, None] <= uncut)).all()


def plain(text):
    """Return a text with plain spaces for line breaks and non-breaking spaces."""
    return " ".join(text.split())


def test_the_table_divides_the_answer():
    parts = {RECORDED: np.array([True, False, False]), NEAR: np.array([False, True, False])}
    parts |= {FAR: np.array([False, False, True])}
    weights = np.array([[1.0, 2.0, 1.0], [1.0, 4.0, 7.0]]) * 1e-6
    replayed = {RECORDED: np.array([True]), NEAR: np.array([False]), FAR: np.array([False])}
    table = extrapolation_table(parts, weights, 146_054, replayed).set_index("part")
    assert table["share"].to_dict() == pytest.approx({ALL: 1, RECORDED: 1 / 8, NEAR: 3 / 8, FAR: 4 / 8})
    assert table.loc[FAR, "probability"] == pytest.approx(4e-6)
    assert table.loc[list(DISJOINT), "probability"].sum() == pytest.approx(table.loc[ALL, "probability"])
    assert table.loc[ALL, "expected"] == pytest.approx(8e-6 * 146_054)
    assert table["recorded"].to_dict() == {ALL: 1, RECORDED: 1, NEAR: 0, FAR: 0}
    assert table.loc[ALL, "replay_low95"] == pytest.approx(1.7e-7, rel=0.03)  # 0.0253 / 146,054
    assert table.loc[ALL, "replay_high95"] == pytest.approx(5.572 / 146_054, rel=1e-3)
    assert "88 % of the predicted events" in extrapolation_in_words(table.reset_index())
    nearly_all = table.assign(share=[1.0, 0.003, 0.993, 0.004]).reset_index()
    assert "more than 99 % of the predicted events" in extrapolation_in_words(nearly_all)
    assert "less than 1 % farther than any of them" in extrapolation_in_words(nearly_all)
    by_speed = pd.concat([nearly_all, nearly_all[:1].assign(part=HOST_UNSEEN)])
    assert "less than 1 % faster than any record at all" in extrapolation_in_words(by_speed)
    assert "It is an extrapolation: the median of the crash probability is 8 × 10⁻⁶" in plain(
        rests_in_words(table.reset_index())
    )
    near_records = table.assign(share=[1.0, 0.63, 0.36, 0.01]).reset_index()
    assert "is 8 × 10⁻⁶, and that of crashes like those that were recorded is 1 × 10⁻⁶" in plain(
        rests_in_words(near_records)
    )
    assert extrapolation_table(parts, weights, 10)["recorded"].isna().all()


def test_sampled_events_have_the_shares_of_another_law_and_the_probabilities_of_the_answer():
    """Exponential variables of mean 1 above 1, weighted for the means 2 and 1: the share beyond 3."""
    x = 1 + np.random.default_rng(1).standard_exponential(200_000)
    weights = np.exp([x / 2, np.zeros(x.size)])
    crashes = Crashes(x[:, None], np.full((x.size, 1), np.nan), weights)
    known = Posterior(np.array([0.5, 0.25]), np.zeros(2, int))
    crash = CUT_IN.events[0]
    own = Answer(SimpleNamespace(event=crash), None, {crash: known}, crashes)
    np.testing.assert_allclose(own.crash_weights.sum(axis=1), [0.5, 0.25])
    share = own.crash_weights[:, x > 3].sum(axis=1) / [0.5, 0.25]
    assert share[0] == pytest.approx(np.exp(-1), rel=0.05)
    assert share[1] == pytest.approx(np.exp(-2), rel=0.05)
    none = replace(own, crashes=replace(crashes, weights=np.zeros((2, x.size))))
    assert not none.crash_weights.any()


def test_parts_by_distance():
    generator = np.random.default_rng(2)
    records = np.exp(generator.normal(size=(4000, 2))) * [1.0, 100.0]
    inside = np.exp(generator.normal(size=(4000, 2))) * [1.0, 100.0]
    parts = parts_by_distance(records, inside)
    assert sum(parts[name].astype(int) for name in DISJOINT).tolist() == [1] * 4000
    # New events of the same law are as near to a record as the records are to each other.
    assert parts[RECORDED].mean() == pytest.approx(0.95, abs=4 * np.sqrt(2 * 0.95 * 0.05 / 4000))
    far = parts_by_distance(records, 3 * records.max(axis=0, keepdims=True))
    assert far[FAR].all()
    assert not parts_by_distance(records, records[:10])[FAR].any()


def test_rank_scores_are_normal_inside_and_grow_beyond():
    records = np.random.default_rng(3).exponential(size=(5000, 1))
    scores = rank_scores(records, records)
    assert scores.mean() == pytest.approx(0, abs=1e-9)
    assert scores.std() == pytest.approx(1, abs=0.01)
    top, step = records.max(), records.std()
    beyond = rank_scores(records, np.array([[top], [top + step], [top + 2 * step]]))
    assert np.diff(beyond[:, 0]) == pytest.approx([1, 1])


def test_clusters_widen_the_intervals_of_near_misses():
    generator, blocks, length = np.random.default_rng(4), 20, 15_000
    rates = np.repeat(generator.gamma(4, 0.001 / 4, blocks), length)  # a standard deviation of a half
    clustered = generator.random(blocks * length) < rates
    independent = generator.random(blocks * length) < 0.001
    assert dispersion(independent, 5_000) == pytest.approx(1, abs=4 * np.sqrt(2 / 59))
    # Variance / mean of a mixed Poisson count of mean 15 whose mean has the relative variance 1 / 4.
    assert dispersion(clustered, 15_000) == pytest.approx(1 + 15 / 4, rel=0.75)
    assert np.isnan(dispersion(np.zeros(blocks * length, dtype=bool), 5_000))
    factors = level_factors(clustered, 20_000, generator)
    counts = clustered.reshape(blocks, length).sum(axis=1)
    assert factors.mean() == pytest.approx(1, abs=0.01)
    exact = counts.std() / counts.mean() / np.sqrt(blocks + 1)  # variance of a Dirichlet mean
    assert factors.std() == pytest.approx(exact, rel=0.03)
    posterior = Posterior(1e-3 * np.exp(0.05 * generator.normal(size=4000)), np.zeros(4000, int))
    (row,) = near_miss_table({"near": posterior}, {"near": clustered}, clustered, generator).to_dict(
        "records"
    )
    assert row["recorded"] == clustered.sum()
    width = np.log(row["high95"] / row["low95"])
    assert np.log(row["clustered_high95"] / row["clustered_low95"]) == pytest.approx(
        width * np.sqrt(1 + (exact / 0.05) ** 2), rel=0.1
    )


def test_the_figure_counts_every_record_and_says_where_the_crashes_are():
    """Records with a long time to collision are shown, too; those of one cell are counted together."""
    encounters = pd.DataFrame(
        {"lead_speed": 10.0, "range": [10.1, 10.2, 70.0], "closing_speed": [1.01, 1.02, 0.1]}
    )
    shares = pd.DataFrame({"part": [ALL, RECORDED, NEAR, FAR], "share": [1.0, 0.2, 0.3, 0.5]})
    crashes = pd.DataFrame({"lead_speed": 10.0, "range": [5.0, 40.0], "closing_speed": [4.0, 25.0]})
    places = crashes.assign(part=[RECORDED, FAR])
    shares = pd.concat([shares, pd.DataFrame({"part": [CAPPED], "share": [0.4]})])
    drawn, data = fig37_extrapolation(shares, places, encounters, CUT_IN, "made up")
    plt.close(drawn)
    shown = {text.get_text().replace("\n", " "): text.get_position()[1] for text in drawn.axes[0].texts}
    assert shown["50 % of the crashes are faster than any record"] > shown["fastest record"]
    assert shown["30 % faster than records at a similar range"] < 1.02
    assert data["records"].dropna().tolist() == [2, 1]
    assert data["part"].dropna().tolist() == [RECORDED, FAR]
    middles = data.dropna(subset="records")[["range", "closing_speed"]].to_numpy()
    # Cells of few records are a fiftieth of the largest values wide: 1.4 m and 0.0204 m/s.
    np.testing.assert_allclose(middles, [[7.5 * 1.4, 49.5 * 0.0204], [49.5 * 1.4, 4.5 * 0.0204]])
