"""The answer from near misses alone: exact tails, margins of a known crash set, clusters, wrong variants."""

import numpy as np
import pytest
from accelerated_evaluation.answer.ways import near_miss_answer as module
from accelerated_evaluation.answer.ways.near_miss_answer import (
    CHOSEN,
    COLUMNS,
    IN_CHOICES,
    LARGEST,
    as_choice,
    exceedances,
    margin_curve,
    margins,
    near_miss_answer,
    record_margins,
    tail_posterior,
)
from accelerated_evaluation.methods.problem import Problem
from scipy.stats import binom, genpareto

SIZE, DRAWS, WORLDS = 20_000, 400, 60


def first_crash(encounters):
    """The closing speed [m/s] at which the vehicle of these tests begins to crash, shape (n,)."""
    return 4 + 0.1 * encounters[0] + 0.2 * encounters[1]


@pytest.fixture
def records():
    """Lead speeds, ranges, and closing speeds of which 0.4 % crash, shape (3, n)."""
    generator = np.random.default_rng(3)
    places = generator.uniform([[5.0], [5.0]], [[30.0], [75.0]], (2, SIZE))
    return np.vstack([places, first_crash(places) * generator.exponential(1 / 5.5, SIZE)])


def test_margins_are_the_ratios_to_the_first_crash(records):
    q = margins(lambda x: x[2] >= first_crash(x), records, 2)
    known, exact = q > 0, records[2] / first_crash(records)
    assert known.sum() > max(LARGEST)
    np.testing.assert_allclose(q[known], exact[known], rtol=1e-6)
    assert exact[~known].max() < q[known].min()
    assert np.array_equal(q >= 1, exact >= 1)
    wrong = margins(lambda x: x[2] >= first_crash(x), records, 1)  # along the range, in which no crash is new
    assert not np.allclose(wrong[known], exact[known], rtol=0.1)


def test_margins_that_no_value_reaches_are_zero(records):
    assert not margins(lambda x: np.zeros(x.shape[1], bool), records, 2).any()


def covered(draw, truth, answer):
    """Return in how many of `WORLDS` samples of margins the 80 % interval covers, and the mean log ratio."""
    logs, inside = [], 0
    for seed in range(WORLDS):
        generator = np.random.default_rng(seed)
        draws = answer(draw(generator), generator)
        low, middle, high = np.quantile(draws, [0.1, 0.5, 0.9])
        inside += low <= truth <= high
        logs.append(np.log(max(middle, np.finfo(float).tiny) / truth))
    return inside, np.mean(logs)


def right(q, generator):
    return exceedances(q, CHOSEN, np.ones(1), DRAWS, generator)[1][:, 0]


def without_threshold(q, generator):
    """The wrong variant that takes margins for excesses over a threshold."""
    largest = np.sort(q)[-CHOSEN:]
    shape, scale, probability = tail_posterior(largest)
    chosen = generator.choice(shape.size, DRAWS, p=probability)
    return CHOSEN / q.size * genpareto.sf(1.0, shape[chosen], scale=scale[chosen])


# Of intervals that cover 80 %, so many of 60 cover with a probability of 99.8 %. The prior of the shape is
# centred at 0, so that the intervals may cover too often there.
LEAST = int(binom.ppf(0.001, WORLDS, 0.8))


@pytest.mark.parametrize("shape", [0.0, 0.1, -0.05])
def test_known_tails_are_covered(shape):
    law = genpareto(shape, scale=0.09)
    inside, bias = covered(lambda g: law.rvs(SIZE, random_state=g), law.sf(1.0), right)
    assert inside >= LEAST
    if shape == 0:  # the mean of the prior, so that the median is nearly unbiased
        assert abs(bias) < 0.3


def test_margins_without_their_threshold_are_wrong():
    law = genpareto(0.0, scale=0.09)
    inside, _ = covered(lambda g: law.rvs(SIZE, random_state=g), law.sf(1.0), without_threshold)
    assert inside < LEAST


def test_the_posterior_of_the_tail_is_that_of_many_excesses():
    """With 20,000 excesses the prior is negligible: the errors are those of the likelihood, 1 / sqrt(n)."""
    excess = genpareto.rvs(0.1, scale=0.5, size=20_000, random_state=1)
    shape, scale, probability = tail_posterior(excess)
    assert probability.sum() == pytest.approx(1)
    assert probability @ shape == pytest.approx(0.1, abs=4 * 1.1 / np.sqrt(20_000))
    assert probability @ scale == pytest.approx(0.5, rel=4 * 1.5 / np.sqrt(20_000))


def test_clusters_widen_the_interval():
    generator = np.random.default_rng(8)
    spread = generator.exponential(0.09, SIZE)
    together = np.sort(spread)[::-1].copy()  # all critical records in the first block
    widths = []
    for q in (spread, together):
        low, high = np.quantile(right(q, np.random.default_rng(1)), [0.1, 0.9])
        widths.append(np.log(high / low))
    assert widths[1] > 1.3 * widths[0]


def test_table_and_choice():
    q = np.random.default_rng(2).exponential(0.09, SIZE)
    table = near_miss_answer(q, DRAWS, np.random.default_rng(1))
    assert list(table) == COLUMNS
    assert list(table["largest"]) == list(LARGEST)
    own = table.set_index("largest").loc[CHOSEN]
    assert own["threshold"] == np.sort(q)[-CHOSEN - 1]
    assert own["near_crash"] == (q > (1 + own["threshold"]) / 2).sum()
    row = as_choice(table)
    assert list(row["choice"]) == [IN_CHOICES]
    assert row["median"].iloc[0] == own["median"]
    again = near_miss_answer(q, DRAWS, np.random.default_rng(1))
    assert again.equals(table)


def test_few_margins_have_fewer_rows_or_none():
    q = np.random.default_rng(2).exponential(0.09, 1500)
    assert list(near_miss_answer(q, DRAWS, np.random.default_rng(1))["largest"]) == [50, 100]
    none = near_miss_answer(np.zeros(SIZE), DRAWS, np.random.default_rng(1))
    assert list(none) == COLUMNS
    assert none.empty
    assert as_choice(none).empty
    curve = margin_curve(np.zeros(SIZE), DRAWS, np.random.default_rng(1))
    assert curve.empty


def test_the_curve_meets_the_records_and_the_answer():
    q = np.random.default_rng(2).exponential(0.09, SIZE)
    curve = margin_curve(q, DRAWS, np.random.default_rng(1))
    records, fit = (curve[curve["kind"] == kind] for kind in ("record", "fit"))
    assert records["share"].iloc[CHOSEN - 1] == CHOSEN / SIZE
    assert (fit["low80"] <= fit["share"]).all()
    assert fit["share"].iloc[0] == pytest.approx(CHOSEN / SIZE, rel=0.25)
    at_crash = np.interp(1.0, fit["margin"], np.log(fit["share"]))
    assert np.exp(at_crash) == pytest.approx(np.median(right(q, np.random.default_rng(1))), rel=1e-6)


def test_scenarios_without_an_upper_set_have_no_margins(records, monkeypatch):
    turns = np.array([[14.0, 4.0, 5.0], [14.0, 4.0, 60.0]])
    assert not record_margins(Problem("left_turn", "acc_aeb"), turns).any()
    cut_ins = records.T[:200]
    assert (record_margins(Problem("cut_in", "acc_aeb"), cut_ins) > 0).any()
    monkeypatch.setattr(module.Problem, "deterministic", False)
    assert not record_margins(Problem("cut_in", "acc_aeb"), cut_ins).any()
