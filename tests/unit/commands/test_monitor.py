"""Kilometres in service: the update against a closed form, the test against simulated fleets, the command."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import InputError, Posterior, StudyError, cli
from accelerated_evaluation.answer.consequences.criterion import counted_in_service, criterion_of, judge
from accelerated_evaluation.answer.consequences.in_service import (
    FALSE_ALARMS,
    InService,
    in_service_table,
    judged_after,
    log_mean_ratio,
    updated_rates,
)
from scipy.integrate import quad
from scipy.stats import gamma, poisson

LEVELS = (np.arange(20_000) + 0.5) / 20_000


def fleet(rate, periods, generator, size):
    """Cumulative counts of fleets that drive one unit in each period, shape (size, periods)."""
    return generator.poisson(rate, (size, periods)).cumsum(axis=1)


def largest(rates, counts, exposure):
    """Return the largest e-value of each fleet, and the index of its first alarm (-1 without one)."""
    e_values = np.array([InService(exposure, each.astype(float)).e_values(rates) for each in counts])
    alarms = e_values >= 1 / FALSE_ALARMS
    return e_values.max(axis=1), np.where(alarms.any(axis=1), alarms.argmax(axis=1), -1)


@pytest.mark.parametrize(("events", "expected"), [(0, 0.0), (0, 30.0), (3, 1.0), (7, 2.0), (40, 35.0)])
def test_the_mean_ratio_is_the_integral(events, expected):
    found = np.exp(log_mean_ratio(np.array(float(events)), np.array(expected)))
    wanted, _ = quad(lambda g: np.exp(events * np.log1p(g) - g * expected - g), 0, np.inf)
    assert found == pytest.approx(wanted, rel=1e-6)


def test_the_mean_ratio_of_far_fewer_events_than_expected():
    assert log_mean_ratio(np.array(2.0), np.array(5000.0)) == pytest.approx(-np.log(4999), abs=1e-3)


def test_the_update_of_a_gamma_prediction_is_a_gamma_distribution():
    prior = gamma(2.0, scale=1 / 4.0)
    table = in_service_table(
        prior.ppf(LEVELS), np.ones(LEVELS.size), InService(np.array([6.0]), np.array([5.0]))
    )
    before, after = table.set_index("when").loc["before"], table.set_index("when").loc["after"]
    posterior = gamma(7.0, scale=1 / 10.0)
    for row, law in ((before, prior), (after, posterior)):
        assert row["median"] == pytest.approx(law.median(), rel=2e-3)
        assert (row["low80"], row["high95"]) == pytest.approx((law.ppf(0.1), law.ppf(0.975)), rel=5e-3)
    assert after["effective"] < before["effective"] == LEVELS.size
    # If half of the crashes are counted, as many counted ones mean twice the rate.
    prior = gamma(2.0, scale=1 / 2.0)
    half = in_service_table(
        prior.ppf(LEVELS), np.full(LEVELS.size, 0.5), InService(np.array([6.0]), np.array([5.0]))
    )
    assert half["median"].iloc[1] == pytest.approx(2 * posterior.median(), rel=5e-3)


def test_counts_that_contradict_the_prediction_are_told_and_not_fitted():
    rates = gamma(50.0, scale=1 / 50.0).ppf(LEVELS)
    with pytest.raises(
        StudyError, match="the counts contradict the prediction: 30 crashes were counted and 10 "
    ):
        in_service_table(rates, np.ones(rates.size), InService(np.array([10.0]), np.array([30.0])))


def test_false_alarms_over_a_life_and_the_delay_for_a_doubled_rate():
    generator, rates, size = np.random.default_rng(5), np.array([0.5]), 400
    exposure = np.arange(1.0, 201.0)
    right = fleet(0.5, 200, generator, size)
    _, alarm = largest(rates, right, exposure)
    assert (alarm >= 0).mean() < FALSE_ALARMS + 2 * np.sqrt(FALSE_ALARMS / size)
    # A usual test that is repeated in every period is wrong: it gives false alarms far more often.
    repeated = poisson.sf(right - 1, 0.5 * exposure) < FALSE_ALARMS
    assert repeated.any(axis=1).mean() > 3 * FALSE_ALARMS
    doubled = largest(rates, fleet(1.0, 200, generator, size), exposure)[1]
    assert (doubled >= 0).mean() > 0.99
    # The guide states this number of predicted crashes.
    assert np.median(0.5 * exposure[doubled]) == pytest.approx(9, abs=1.5)


def test_the_test_knows_that_the_prediction_is_uncertain():
    """Fleets whose rate is one of the predicted values give no alarm, although half exceed the median."""
    generator, rates = np.random.default_rng(6), np.exp(np.random.default_rng(7).normal(-1, 0.8, 300))
    exposure = np.arange(1.0, 61.0)
    counts = np.array([fleet(rate, 60, generator, 1)[0] for rate in rates])
    assert (largest(rates, counts, exposure)[1] >= 0).mean() < FALSE_ALARMS + 2 * np.sqrt(FALSE_ALARMS / 300)
    assert (largest(np.array([np.median(rates)]), counts, exposure)[1] >= 0).mean() > 4 * FALSE_ALARMS


@pytest.fixture
def study(tmp_path, monkeypatch):
    """A study with a predicted rate of 0.5 crashes in a million kilometres, known within a factor of 1.5."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "results" / "one"
    (folder / "laws").mkdir(parents=True)
    (folder / "config.json").write_text(json.dumps({"study": "one", "seed": 1}))
    (folder / "exposure.json").write_text(json.dumps({"kilometres": 1e6, "hours": None}))
    draws = {"draw": [1, 2], "law": ["a", "a"], "probability": [4e-7, 6e-7]}
    pd.DataFrame(draws).to_csv(folder / "laws/answer_draws.csv", index=False)
    parts = pd.DataFrame({"part": ["all", "recorded"], "records": 10**6, "recorded": 0, "upper95": 1e-5})
    parts.to_csv(folder / "laws/extrapolation.csv", index=False)
    (folder / "contents.json").write_text(json.dumps(["laws/extrapolation.csv"]))
    return tmp_path


@pytest.mark.parametrize(
    ("crashes", "status", "words"),
    [
        ((0, 1, 0), 0, "no alarm"),
        ((4, 5, 6), 1, "ALARM since row 3"),
        ((0, 0, 60), 1, "the counts contradict"),
    ],
)
def test_the_command_monitors_a_fleet(study, capsys, crashes, status, words):
    pd.DataFrame({"kilometres": 1e6, "crashes": crashes}).to_csv("fleet.csv", index=False)
    assert cli.main(["monitor", "one", "fleet.csv"]) == status
    assert words in capsys.readouterr().out
    table = pd.read_csv("results/monitor.csv")
    assert table["expected"].tolist() == pytest.approx([0.5, 1.0, 1.5], rel=0.01)
    assert table["counted"].tolist() == np.cumsum(crashes).tolist()


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("km,crashes\n1,0\n", [], "fleet.csv, column 'kilometres': seen only the columns 'km', 'crashes'"),
        ("kilometres,crashes\n1,0.5\n", [], "fleet.csv, row 2: seen kilometres 1, crashes 0.5; expected"),
        ("kilometres,crashes\n5,0\n-1,0\n", [], "fleet.csv, row 3: seen kilometres -1"),
        ("kilometres,crashes\n5,0\nmany,0\n", [], "fleet.csv, row 3, column kilometres: seen 'many'"),
        ("kilometres,crashes\n", [], "seen no row"),
        ("kilometres,crashes\n1,0\n", ["--reported", "0.8", "0.4"], "--reported: seen 0.8 0.4; expected two"),
        ("hours,crashes\n1,0\n", ["--per", "hour"], "seen records of unknown hours"),
    ],
)
def test_fleets_that_cannot_be_monitored(study, capsys, text, options, message):
    (study / "fleet.csv").write_text(text)
    assert cli.main(["monitor", "one", "fleet.csv", *options]) == 2
    assert message in capsys.readouterr().err
    assert not (study / "results/monitor.csv").exists()


def test_rates_of_zero_are_possible_values_of_a_prediction():
    """Some draws of a vehicle that hardly ever crashes have no crash; they explain no counted one."""
    counts = InService(np.array([1.0, 2.0]), np.array([0.0, 1.0]))
    rates = np.repeat([0.0, 0.7], 2000)
    weights = counts.weights(rates)
    assert weights[:2000].sum() == 0
    assert weights.sum() == pytest.approx(1)
    own, without = counts.e_values(rates), counts.e_values(rates[2000:])
    assert own[1] == pytest.approx(without[1])
    assert np.isfinite(own).all()


RECORDS = SimpleNamespace(size=400_000, exposure={"kilometres": 2e6, "hours": None})


def test_crashes_in_service_update_the_rate_by_the_same_likelihood():
    """With 400,000 encounters, their rate of 0.2 per kilometre is known to a permille."""
    prior = gamma(2.0, scale=1 / 4e6)
    known = Posterior(prior.ppf(LEVELS) / 0.2, np.zeros(LEVELS.size, int))
    counted = counted_in_service("3 counted in 5e6 km", "cut-in")
    table = updated_rates(known, counted, RECORDS, np.random.default_rng(1))
    after, exact = table.set_index("when").loc["after"], gamma(5.0, scale=1 / 9e6)
    assert (after["low80"], after["high80"]) == pytest.approx((exact.ppf(0.1), exact.ppf(0.9)), rel=0.04)
    half = counted_in_service("3 counted in 5e6 km with 0.5 to 0.5 reported", "cut-in")
    more = updated_rates(known, half, RECORDS, np.random.default_rng(1))["median"].iloc[1]
    assert more == pytest.approx(gamma(5.0, scale=1 / 6.5e6).median(), rel=0.04)
    assert more > 1.2 * after["median"]  # unreported crashes must count


@pytest.mark.parametrize(("share", "events"), [(0.1, 0), (0.3, 3), (0.8, 0)])
def test_a_rate_that_has_only_a_limit_is_no_value_of_the_update(share, events):
    """The ends are those of the lowest and of the highest values that the unknown rates may have."""
    known, unknown = gamma(2.0, scale=1 / 4.0).ppf(LEVELS), np.arange(LEVELS.size) % 10 < 10 * share
    bounds = np.where(unknown, 0.0, known), np.where(unknown, 8.0, known)
    counts, whole = InService(np.array([2.0]), np.array([float(events)])), np.ones(LEVELS.size)
    both = in_service_table(np.array(bounds), whole, counts).iloc[1]
    low, high = (in_service_table(each, whole, counts).iloc[1] for each in bounds)
    assert (both["low80"], both["high80"]) == pytest.approx((low["low80"], high["high80"]))
    assert low["low80"] < high["low80"] or events
    assert np.isnan(both["median"]) == (share > 0.5)


@pytest.mark.parametrize(
    ("text", "message"),
    [("40 counted in 5e6 km", "contradict"), ("0 counted in 1e3 h", "records whose hours are known")],
)
def test_crashes_in_service_that_the_draws_cannot_follow_are_an_error(text, message):
    known = Posterior(np.full(1000, 1e-6), np.zeros(1000, int))
    with pytest.raises(StudyError, match=message):
        updated_rates(known, counted_in_service(text, "cut-in"), RECORDS, np.random.default_rng(1))


@pytest.mark.parametrize("text", ["4e-7 per kilometre", "2e-6 per cut-in", "0.5 x other"])
def test_criteria_are_judged_after_the_crashes_in_service(text):
    """All three limits are the same, because the other vehicle crashes in 4e-6 of the cut-ins."""
    prior = gamma(2.0, scale=1 / 4e6)
    known = Posterior(prior.ppf(LEVELS) / 0.2, np.zeros(LEVELS.size, int))
    other = replace(known, probabilities=np.full(LEVELS.size, 4e-6))
    counted = counted_in_service("0 counted in 5e6 km", "cut-in")
    before = judge(
        criterion_of(text, "here", "cut-in"), known, RECORDS.size, RECORDS.exposure, {"other": other}
    )
    after = judged_after(before, counted, RECORDS)
    assert before.probability_met == pytest.approx(prior.cdf(4e-7), abs=0.005)
    assert after.probability_met == pytest.approx(gamma(2.0, scale=1 / 9e6).cdf(4e-7), abs=0.005)
    assert after.row()["reason"].endswith(f"it was met with probability {before.probability_met:.2g}")


@pytest.mark.parametrize(
    "text",
    ["", "few", "3 counted", "3 counted in 0 km", "1 counted in 5 km with 0.8 to 0.4 reported", "counted"],
)
def test_counts_in_service_in_another_form_are_one_message(text):
    with pytest.raises(InputError, match=r"in_service: seen .*; expected counts such as"):
        counted_in_service(text, "cut-in")
