"""Criteria: verdicts and what would decide them, against closed forms and wrong variants."""

from pathlib import Path
from types import SimpleNamespace

import accelerated_evaluation as ae
import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import InputError, Posterior, SampledPosterior
from accelerated_evaluation.answer.consequences.counted_crashes import (
    HUNDRED_CAR_CRASHES,
    HUNDRED_CAR_MOST,
    LANE_CHANGE,
    STRUCK,
    count_events,
    count_of,
    read_events,
)
from accelerated_evaluation.answer.consequences.criterion import (
    BY_MODELS,
    SHOWN,
    UNDECIDED,
    Basis,
    criteria_table,
    criterion_in_words,
    criterion_of,
    crude_runs,
    exit_status,
    judge,
    under,
)
from accelerated_evaluation.answer.consequences.deciding import (
    criteria_tables,
    deciding_table,
    encounters_needed,
)
from accelerated_evaluation.answer.ways.extrapolation import exact_interval
from scipy.special import ndtri
from scipy.stats import gamma, norm

ROOT = Path(__file__).parents[3]
WHERE, K = "criteria", 4_000
UNKNOWN = {"kilometres": None, "hours": None}


def lognormal(median: float, deviation: float, size: int = K) -> Posterior:
    """Return a posterior whose draws are the quantiles of a lognormal distribution, of one law."""
    levels = (np.arange(size) + 0.5) / size
    return Posterior(median * np.exp(deviation * ndtri(levels)), np.zeros(size, dtype=int))


def of(text: str, levels: tuple[str, ...] = ()):
    return criterion_of(text, WHERE, "cut-in", levels)


def test_texts():
    assert (of("1e-7 per hour").limit, of("1e-7 per hour").per) == (1e-7, "hour")
    assert of("2e-6 per cut-in").per == of("2e-6 per encounter").per == "encounter"
    assert of("1e-9 per km").per == "kilometre"
    assert (of("0.5 x cc_human").reference, of("0.5 x cc_human").per) == ("cc_human", "")
    assert of("1e-8 MAIS3+ per hour", ("MAIS3+",)).harm == "MAIS3+"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "1e-7",
        "-1 per hour",
        "nan per hour",
        "1e-7 per mile",
        "1e-7 deaths per hour",
        "x cc_human",
        "0 per hour",
        "1_0 per hour",
        "٣ per hour",
        "1.1 per cut-in",  # no probability is so large, so that everything meets it
        "5 per encounter",
        "1 x cc_human per hour",
    ],
)
def test_other_texts_are_refused(text):
    with pytest.raises(InputError, match=r"criteria.*expected.*per hour"):
        of(text, ("MAIS3+",))


@pytest.mark.parametrize(
    ("limit", "verdict"),
    [(3e-6, BY_MODELS[True]), (1.2e-6, UNDECIDED), (1e-6, UNDECIDED), (3e-7, BY_MODELS[False])],
)
def test_a_lognormal_posterior(limit, verdict):
    judged = judge(of(f"{limit} per cut-in"), lognormal(1e-6, 0.5), 100, UNKNOWN)
    assert judged.probability_met == pytest.approx(norm.cdf(np.log(limit / 1e-6) / 0.5), abs=2 / K)
    assert judged.upper == pytest.approx(1e-6 * np.exp(0.5 * ndtri(0.95)), rel=1e-2)
    assert judged.verdict == verdict


def test_the_uncertainty_of_the_rate_of_encounters_counts():
    # One law without uncertainty: the rate per hour is p times a gamma variable.
    posterior = Posterior(np.full(3, 1e-3), np.zeros(3, dtype=int))
    judged = judge(of("6e-4 per hour"), posterior, 4, {"kilometres": None, "hours": 10.0})
    exact = gamma(4.5, scale=1e-4)
    assert judged.probability_met == pytest.approx(exact.cdf(6e-4), abs=0.04)
    assert judged.probability_met < 0.9  # a rate that is taken as known, 4.5 in 10 hours, would give 1
    reason = judge(of("6e-4 per km"), posterior, 4, {"kilometres": None, "hours": 10.0})
    assert reason == "it is not stated in how many kilometres the records were made"


def test_the_sampling_error_counts():
    exact = lognormal(1e-6, 1e-3, 50)
    sampled = SampledPosterior(exact.probabilities, exact.member, np.full(50, 0.3), 20)
    of_limit = of("1.3e-6 per cut-in")
    assert judge(of_limit, exact, 100, UNKNOWN).verdict == BY_MODELS[True]
    assert judge(of_limit, sampled, 100, UNKNOWN).verdict == UNDECIDED


def test_ratios_share_their_draws():
    """Both probabilities vary by a factor of 10, but their ratio is 0.5 in each draw."""
    own, other = lognormal(1e-6, 1.0), lognormal(2e-6, 1.0)
    judged = judge(of("0.6 x cc_human"), own, 100, UNKNOWN, others={"cc_human": other})
    assert judged.verdict == BY_MODELS[True]
    assert judged.upper == pytest.approx(0.5)
    apart = Posterior(np.random.default_rng(1).permutation(other.probabilities), other.member)
    assert judge(of("0.6 x cc_human"), own, 100, UNKNOWN, others={"cc_human": apart}).verdict == UNDECIDED
    assert "was not compared" in judge(of("0.6 x nobody"), own, 100, UNKNOWN, others={"cc_human": other})
    never = Posterior(np.zeros(K), own.member)
    assert "no event" in judge(of("0.6 x cc_human"), own, 100, UNKNOWN, others={"cc_human": never})


def test_a_ratio_to_counted_crashes():
    """The ratio of two rates with Jeffreys' prior, by draws; more crashes are easier to fall below."""
    own, size = lognormal(2e-6, 0.5, 400), 150_000
    exposed = {"kilometres": 3.3e6, "hours": None}
    generator = np.random.default_rng(3)
    drawn = generator.choice(own.probabilities, 200_000) * generator.gamma(size + 0.5, 1 / 3.3e6, 200_000)
    met = {}
    for events, shares in ((0, ""), (1, ""), (1, " with 0.3 to 0.6 reported")):
        criterion = of(f"1 x {events} counted in 3.2e6 km{shares}")
        assert criterion.reference == ""
        rate = generator.gamma(events + 0.5, 1 / 3.2e6, 200_000)
        rate /= np.exp(generator.uniform(np.log(0.3), np.log(0.6), 200_000)) if shares else 1
        met[events, shares] = judge(criterion, own, size, exposed).probability_met
        assert met[events, shares] == pytest.approx(np.mean(drawn <= rate), abs=0.02)
    assert met[0, ""] + 0.1 < met[1, ""] < met[1, " with 0.3 to 0.6 reported"] - 0.05
    of_drivers = of("1 x counted")
    assert (of_drivers.counted.events, round(of_drivers.counted.exposure)) == (0, 3_218_688)
    assert "in how many hours" in judge(of("1 x 2 counted in 1e4 hours"), own, size, exposed)
    with pytest.raises(InputError, match=r"0\.5 x counted"):
        of("1 x 2 counted in 0 km")
    with pytest.raises(InputError, match=r"0\.5 x counted"):
        of("1 x 2 counted in 10 km with 0.5 to 0.3 reported")
    assert criterion_of("1 x counted", WHERE, "left turn").counted is None  # no counts are known


def test_the_counts_of_the_100_car_study():
    counts = count_events(read_events(ROOT / "data/crash_counts/hundred_car_events.tsv.gz"))
    assert count_of(counts, STRUCK, "crash") == HUNDRED_CAR_CRASHES
    assert count_of(counts, LANE_CHANGE, "crash") == HUNDRED_CAR_MOST


def test_references_that_counts_contradict_are_marked():
    """At .05 cut-ins a kilometre, 1e-4 are 16 crashes in two million miles, and 1e-6 are .16."""
    own, basis = lognormal(1e-6, 0.1), Basis(ae.CUT_IN.scope)
    exposed = {"kilometres": 2000.0, "hours": None}
    others = {"cc_human": lognormal(1e-4, 0.1), "careful": lognormal(1e-6, 0.1)}
    given = own, basis, 100, exposed, others, {}
    table = criteria_tables([of("0.5 x cc_human"), of("2 x careful")], *given)["criteria"]
    assert "contradicted by counts: 13 crashes" in table["reason"][0]
    assert "contradicted by counts" in criterion_in_words(table.iloc[0])
    assert table["reason"][1] == ""


def test_injuries_per_event():
    own = lognormal(1e-6, 0.5)
    judged = judge(
        of("5e-7 MAIS3+ per cut-in", ("MAIS3+",)),
        own,
        100,
        UNKNOWN,
        injured={"MAIS3+": np.column_stack([0.1 * own.probabilities, 0.3 * own.probabilities])},
    )
    expected = np.mean([norm.cdf(np.log(5e-7 / (share * 1e-6)) / 0.5) for share in (0.1, 0.3)])
    assert judged.probability_met == pytest.approx(expected, abs=2 / K)


def test_encounters_without_the_event():
    """With two values of the probability, Bayes' formula gives the number in closed form."""
    low, high = 1e-6, 1e-4
    posterior = Posterior(np.array([low, high]), np.zeros(2, dtype=int))
    judged = judge(of("1e-5 per cut-in"), posterior, 100, UNKNOWN)
    needed = np.log(0.95 / 0.05) / (high - low)
    assert encounters_needed(judged) == pytest.approx(needed, rel=1e-6)
    assert judged.met_after(needed) == pytest.approx(0.95)
    assert judged.chance_without_event(needed) == pytest.approx(
        (np.exp(-low * needed) + np.exp(-high * needed)) / 2
    )
    impossible = judge(of("1e-7 per cut-in"), posterior, 100, UNKNOWN)
    assert encounters_needed(impossible) == np.inf


def test_the_table_of_what_would_decide():
    posterior = lognormal(1e-6, 0.5)
    exposure = {"kilometres": 2e4, "hours": None}
    judged = judge(of("1.5e-6 per cut-in"), posterior, 1_000, exposure)
    table = deciding_table(judged, 1_000, exposure).set_index("effort")
    assert list(table.index) == ["records", "encounters without the event", "kilometres without the event"]
    assert np.isnan(table.loc["records", "needed"])  # how fast the choice of law would shrink is not known
    ratio = (
        table.loc["kilometres without the event", "needed"]
        / table.loc["encounters without the event", "needed"]
    )
    assert ratio == pytest.approx(20)
    decided = judge(of("1 per cut-in"), posterior, 1_000, exposure)
    assert deciding_table(decided, 1_000, exposure).empty


PARTS = pd.DataFrame({"part": ["all", "recorded"], "upper95": [4e-6, 1e-6], "recorded": 0, "records": 299})


def test_the_table_of_criteria():
    criteria, basis = [of("3e-6 per cut-in"), of("1e-7 per hour")], Basis.of(PARTS, "closing cut-ins")
    judged = [judge(each, lognormal(1e-6, 0.5), 100, UNKNOWN, basis=basis) for each in criteria]
    table = criteria_table(criteria, judged)
    assert table["verdict"].tolist() == [BY_MODELS[True], "not known"]
    assert table["beyond"][0] == 0.75
    assert table["replayed_upper95"][0] == pytest.approx(1 - 0.05 ** (1 / 299))
    lines = [criterion_in_words(row) for row in table.to_dict("records")]
    assert "met under the models, for closing cut-ins" in lines[0]
    assert "75 %" in lines[0]
    assert lines[1].endswith("because it is not stated in how many hours the records were made")
    undecided = SimpleNamespace(verdict=UNDECIDED, probability=0.5)
    row = table.iloc[0].to_dict() | vars(undecided)
    assert "not refuted" in criterion_in_words(row)


@pytest.mark.parametrize(
    ("beyond", "replayed", "shown"),
    [
        (0.05, (0.0, 2e-6), True),
        (0.95, (0.0, 2e-6), False),  # nearly all of the bound is extrapolated
        (0.05, (0.0, 1e-2), False),  # the replays could have missed far more than the limit
        (0.05, (np.nan, np.nan), False),
    ],
)
def test_a_criterion_is_shown_to_be_met_only_by_records(beyond, replayed, shown):
    basis = Basis("", beyond, replayed)
    found = judge(of("3e-6 per cut-in"), lognormal(1e-6, 0.5), 100, UNKNOWN, basis=basis)
    assert found.verdict == (SHOWN if shown else BY_MODELS)[True]
    refuting = Basis("", beyond, (replayed[1], replayed[1]))
    found = judge(of("3e-7 per cut-in"), lognormal(1e-6, 0.5), 100, UNKNOWN, basis=refuting)
    assert found.verdict == (SHOWN if beyond < 0.5 and not np.isnan(replayed[0]) else BY_MODELS)[False]


def test_a_rate_of_all_encounters_is_judged_if_it_is_known():
    """Events that were not recorded make the rate ten times as large, and no replay speaks about them."""
    own, basis = lognormal(1e-6, 0.5), Basis("closing cut-ins", 0.0, (0.0, 2e-6))
    every = lognormal(1e-5, 1.0), basis.of_every("cut-in")
    given = [of("3e-6 per cut-in")], own, basis, 100, UNKNOWN, {}, {}
    closing, whole = (criteria_tables(*given, each)["criteria"].iloc[0] for each in (None, every))
    assert (closing["verdict"], closing["encounters"]) == (SHOWN[True], "closing cut-ins")
    assert (whole["verdict"], whole["encounters"]) == (UNDECIDED, "all cut-ins")
    assert np.isnan(whole["replayed_upper95"])


def row_of(choice, median, sigma):
    """Return a row of the table of choices of a lognormal probability."""
    levels = {"median": 0.5} | {
        f"{end}{each}": 0.5 + sign * each / 200
        for each in (50, 80, 95)
        for end, sign in (("low", -1), ("high", 1))
    }
    return {"choice": choice} | {name: median * np.exp(sigma * norm.ppf(at)) for name, at in levels.items()}


def test_a_posterior_under_another_choice():
    """The ratio of the quantiles of two lognormal rows makes one posterior the other, also if shuffled."""
    rows, shuffle = (row_of("a", 1e-6, 0.5), row_of("b", 3e-7, 0.8)), np.random.default_rng(1).permutation(K)
    own = lognormal(1e-6, 0.5).probabilities[shuffle]
    moved = under(Posterior(own, np.zeros(K, int)), *rows).probabilities
    at = np.array([0.05, 0.25, 0.5, 0.9, 0.95])
    np.testing.assert_allclose(np.quantile(moved, at), 3e-7 * np.exp(0.8 * norm.ppf(at)), rtol=0.03)
    assert np.array_equal(np.argsort(moved), np.argsort(own))
    wrong = under(Posterior(own, np.zeros(K, int)), *rows[::-1]).probabilities
    assert np.median(wrong) > 2e-6


@pytest.mark.parametrize(
    ("limit", "alone", "weakest"),
    [
        (3e-6, BY_MODELS[True], "high"),  # met with P = .986, and with P = .5 under the choice "high"
        (3e-7, BY_MODELS[False], "low"),  # the same with the choice "low", whose median is the limit
        (1e-5, BY_MODELS[True], None),  # met under all choices
        (1e-6, UNDECIDED, None),
    ],
)
def test_the_weakest_verdict_under_all_choices_is_the_verdict(limit, alone, weakest):
    choices = [row_of("as in the answer", 1e-6, 0.5), row_of("low", 3e-7, 0.5), row_of("high", 3e-6, 0.5)]
    given = [of(f"{limit} per cut-in")], lognormal(1e-6, 0.5), Basis(), 100, UNKNOWN, {}, {}
    assert criteria_tables(*given)["criteria"]["verdict"][0] == alone
    tables = criteria_tables(*given, choices=pd.DataFrame(choices))
    row = tables["criteria"].iloc[0]
    assert row["verdict"] == (UNDECIDED if weakest else alone)
    if weakest:
        assert row["weakest_choice"] == weakest
        assert row["weakest_probability"] == pytest.approx(0.5, abs=0.02)
        assert f"under the choice '{weakest}'" in criterion_in_words(row)
    assert tables["deciding"].empty == (limit != 1e-6)  # efforts are for the choices of the answer


def test_injuries_and_all_encounters_change_with_the_choice():
    own = lognormal(1e-6, 0.5)
    choices = pd.DataFrame([row_of("as in the answer", 1e-6, 0.5), row_of("tenfold", 1e-5, 0.5)])
    injured = {"MAIS3+": 0.1 * own.probabilities[:, None]}
    exposed = {"kilometres": 1000.0, "hours": None}
    criteria = [of("3e-7 MAIS3+ per cut-in", ("MAIS3+",)), of("3e-5 per cut-in"), of("1 x human")]
    every = lognormal(1e-5, 0.5), Basis()
    table = criteria_tables(criteria, own, Basis(), 100, exposed, {"human": own}, injured, every, choices)[
        "criteria"
    ]
    same = norm.cdf(np.log(0.3) / 0.5)
    assert table["weakest_probability"][:2].tolist() == pytest.approx([same, same], abs=0.01)
    assert table["weakest_choice"].tolist() == ["tenfold", "tenfold", ""]  # a ratio has no other choices


def test_no_verdict_without_an_estimate():
    found = criteria_tables([of("3e-6 per cut-in")], None, Basis(), 100, UNKNOWN, {}, {})
    assert "replayed records contradict" in criterion_in_words(found["criteria"].iloc[0])


def test_bounds_without_a_model():
    assert crude_runs(1e-2) == pytest.approx(298.07, abs=0.01)  # the engineer's 299 runs
    assert exact_interval(0, 299, 0.9)[1] == pytest.approx(1 - 0.05 ** (1 / 299))
    assert exact_interval(3, 3, 0.9)[1] == 1


@pytest.mark.parametrize(
    ("verdicts", "status"),
    [
        ((), 0),
        (("shown to be met", "met under the models"), 0),
        (("shown to be met", "not decided"), 1),
        (("shown not to be met",), 1),
        (("not met under the models",), 1),
        (("not known",), 1),
    ],
)
def test_a_release_can_depend_on_the_exit_status(verdicts, status):
    assert exit_status(verdicts) == status
