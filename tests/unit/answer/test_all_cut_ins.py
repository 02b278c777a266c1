"""One crash rate of all cut-ins, against the mean and variance of products of independent variables."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import Posterior
from accelerated_evaluation.answer.consequences import all_cut_ins as module
from accelerated_evaluation.answer.consequences.all_cut_ins import (
    NO_EXPOSURE,
    NO_MOTION,
    NO_RECORDS,
    all_cut_ins,
    opening_law,
    rates_table,
)
from accelerated_evaluation.answer.consequences.rates import Rate
from accelerated_evaluation.answer.consequences.total import SIZE
from accelerated_evaluation.answer.ways import posterior

PROBABILITIES = np.array([1e-6, 2e-6, 6e-6])


def motion(factor, error, opening, opening_error, high95=3e-6):
    return pd.DataFrame(
        {
            "vehicle": "car",
            "gap": ["closing", "opening", "all"],
            "cut_ins": [0.4, 0.6, 1.0],
            "moving": [0.0, opening, 0.0],
            "standard_error": [0.0, opening_error, 0.0],
            "high95": [0.0, high95, 0.0],
            "factor": [factor, np.nan, factor],
            "factor_error": [error, np.nan, error],
        }
    )


MOTIONS = {"here": motion(1.2, 0.3, 2e-6, 1e-6), "there": motion(0.4, 0.1, 1e-6, 1e-6)}
LIMITED = motion(0.4, 0.1, np.nan, 0.0)  # hardly any opening cut-in crashed
POSTERIOR = Posterior(PROBABILITIES, np.zeros(3, int))


def expected():
    """Mean and variance of p f + 1.5 q, where (f, q) is independent of p and a mixture of two laws."""
    p, squared = PROBABILITIES.mean(), (PROBABILITIES**2).mean()
    laws = [((1.2, 0.3), (2e-6, 1e-6)), ((0.4, 0.1), (1e-6, 1e-6))]
    mean = np.mean([p * f + 1.5 * q for (f, _), (q, _) in laws])
    second = np.mean(
        [squared * (f**2 + a**2) + 2 * 1.5 * p * f * q + 2.25 * (q**2 + b**2) for (f, a), (q, b) in laws]
    )
    return mean, second - mean**2


def found(motions=MOTIONS, rates=None, opening=100, seed=1):
    rates = {"kilometre": Rate(400, 1e4)} if rates is None else rates
    generator = np.random.default_rng(seed)
    return all_cut_ins("car", POSTERIOR, motions, rates, opening, generator).set_index(["part", "per"])


def test_the_mean_of_all_cut_ins_is_that_of_the_mixture():
    mean, variance = expected()
    table = found()
    reach = 5 * np.sqrt(variance / SIZE)
    assert table.loc[("all", "closing cut-in"), "mean"] == pytest.approx(mean, abs=reach)
    per_km = Rate(400, 1e4).law.mean()
    assert table.loc[("all", "kilometre"), "mean"] == pytest.approx(mean * per_km, abs=1.1 * reach * per_km)
    miles = 2e6 * 1.609344
    assert table.loc[("all", "kilometre"), "in_hundred_car"] == pytest.approx(mean * per_km * miles, rel=0.05)
    assert np.isnan(table.loc[("all", "closing cut-in"), "in_hundred_car"])
    parts = table.xs("closing cut-in", level="per")["share"]
    assert parts["closing"] + parts["opening"] == pytest.approx(1)
    assert table.loc[("closing, here", "closing cut-in"), "mean"] == pytest.approx(3.6e-6, rel=0.05)
    assert (table["missing"] == "").all()


def largest_change(size):
    """Return the largest relative change of a mean of the table if the errors change by this share."""
    changes = []
    for shape in np.geomspace(0.3, 8, 6):
        one = motion(1.2, 0.3, 2e-6, 2e-6 / np.sqrt(shape))
        other = one.assign(standard_error=(1 + size) * one["standard_error"])
        means, others = (found({"law": each})["mean"] for each in (one, other))
        changes.append((others / means - 1).abs().max())
    return max(changes)


class ByRejection(SimpleNamespace):
    """A law that turns a place in the stream of random numbers into draws by rejection."""

    def ppf(self, levels):
        return self.law.rvs(levels.size, random_state=np.random.default_rng(int(levels[0] * 2**52)))


def test_last_digits_of_the_estimates_change_last_digits_of_the_table(monkeypatch):
    """Another processor changes them. Draws by rejection would sometimes change all draws that follow.

    For last digits that is seldom; for a change by 0.1 % it is the rule.
    """
    assert largest_change(1e-3) < 2e-5
    monkeypatch.setattr(module, "opening_law", lambda *given: ByRejection(law=opening_law(*given)))
    assert largest_change(1e-3) > 2e-4


def test_the_interval_contains_what_is_not_known_about_motion():
    """The interval of all laws is wider than that of each; a mean factor in their place would be noticed."""
    tight = {"here": motion(1.2, 1e-9, 2e-9, 1e-12), "there": motion(0.1, 1e-9, 2e-9, 1e-12)}
    table = found(tight).xs("closing cut-in", level="per")
    assert table.loc["all", "low95"] == pytest.approx(0.1e-6 + 3e-9, rel=1e-3)
    assert table.loc["all", "high95"] == pytest.approx(7.2e-6 + 3e-9, rel=1e-3)
    averaged = found({"mean": motion(0.65, 1e-9, 2e-9, 1e-12)}).xs("closing cut-in", level="per")
    assert averaged.loc["all", "high95"] < 0.6 * table.loc["all", "high95"]


def test_a_median_between_two_laws_that_contradict_each_other_is_unknown(monkeypatch):
    """It was the number of the law with more draws, and another processor's last digits changed it."""
    laws = {"here": motion(8.6, 0.5, 2e-9, 1e-12), "there": motion(0.1, 0.01, 2e-9, 1e-12)}
    known = found({"here": laws["here"]})["median"]
    assert known.notna().all()
    median = found(laws).xs("closing cut-in", level="per")["median"]
    assert median[["closing", "all"]].isna().all()
    assert median.drop(["closing", "all"]).notna().all()
    monkeypatch.setattr(posterior, "GAP", np.inf)
    wrong = found(laws).loc[("all", "closing cut-in")]
    assert wrong["high50"] > 5 * wrong["low50"]
    assert np.isfinite(wrong["median"])


def test_the_opening_part():
    law = opening_law(2e-6, 1e-6, 0.0)
    assert (law.mean(), law.std()) == pytest.approx((2e-6, 1e-6))
    assert opening_law(np.nan, 0.0, 3e-6).ppf(0.95) == pytest.approx(3e-6, rel=2e-3)


def test_a_limit_enters_upper_ends_only():
    """Wrong: the law of the limit, whose mean is a third of it, enters the mean and the median of the sum."""
    exact, limited = (
        found({"there": each}).xs("closing cut-in", level="per")
        for each in (motion(0.4, 0.1, 1e-12, 1e-13), LIMITED)
    )
    assert limited.loc[["opening", "all"], ["mean", "median", "share"]].isna().all(axis=None)
    lower, upper = ["low50", "low80", "low95"], ["high50", "high80", "high95", "upper95"]
    assert limited.loc["all", lower].tolist() == pytest.approx(exact.loc["all", lower].tolist(), rel=0.02)
    assert (limited.loc["all", upper] > 1.2 * exact.loc["all", upper]).all()
    assert limited.loc["opening", "upper95"] == pytest.approx(1.5 * 3e-6, rel=0.02)
    assert limited.loc["closing", "mean"] == pytest.approx(0.4 * PROBABILITIES.mean(), rel=0.02)
    assert "a limit, only in upper ends" in limited["missing"].iloc[0]
    both = {"here": MOTIONS["here"], "there": LIMITED}
    mean = found(both).xs("closing cut-in", level="per").loc["all", "mean"]
    p = PROBABILITIES.mean()
    assert mean == pytest.approx((1.2 * p + 1.5 * 2e-6 + 0.4 * p) / 2, rel=0.03)
    assert mean < (1.2 * p + 1.5 * 2e-6 + 0.4 * p + 1.5 * 1e-6) / 2 / 1.08  # the wrong one


def test_the_table_says_what_is_missing():
    assert set(found(opening=0)["missing"]) == {NO_RECORDS}
    assert set(found(rates={})["missing"]) == {NO_EXPOSURE}
    nothing = found(motions={"here": MOTIONS["here"].iloc[:0]})
    assert set(nothing["missing"]) == {NO_MOTION}
    assert set(nothing.index.get_level_values("part")) == {module.KEEPS}
    never = {"here": MOTIONS["here"].assign(factor=np.nan)}
    assert set(found(never)["missing"]) == {NO_MOTION}


def test_vehicles_below_each_other():
    draws = pd.DataFrame({"draw": [1, 2, 3], "law": "a", "probability": PROBABILITIES, "vehicle": "car"})
    other = draws.assign(vehicle="other", probability=1e-3 * np.arange(1, 4))
    exposure = {"kilometres": None, "hours": 100.0}
    table = rates_table(pd.concat([draws, other]), MOTIONS, 400, exposure, 5, np.random.default_rng(2))
    assert table["per"].unique().tolist() == ["closing cut-in", "hour"]
    assert table.groupby("vehicle")["part"].nunique().to_dict() == {"car": 6, "other": 1}
    errors = {"error": 0.1, "shared_error": np.nan, "own_error": np.nan, "batches": 5, "unseen_lapses": 0.0}
    sampled = pd.concat([draws.assign(**errors), other], ignore_index=True)
    wider = rates_table(sampled, MOTIONS, 400, exposure, 5, np.random.default_rng(2))
    high95 = [each.set_index(["vehicle", "part", "per"])["high95"] for each in (table, wider)]
    own, rest = ((name, module.KEEPS, "closing cut-in") for name in ("car", "other"))
    assert high95[1][own] > 1.1 * high95[0][own]
    assert high95[1][rest] == pytest.approx(high95[0][rest], rel=1e-6)
    empty = rates_table(draws.iloc[:0], MOTIONS, 400, exposure, 5, np.random.default_rng(2))
    assert empty.columns.tolist() == module.COLUMNS
