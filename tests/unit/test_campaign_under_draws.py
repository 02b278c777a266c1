"""A campaign reports the answer under all draws of a mean law, also if it was begun under a single law."""

import re

import numpy as np
import pytest
from accelerated_evaluation import cli
from accelerated_evaluation.answer.averaged import Course
from accelerated_evaluation.answer.reweighting import draws_of
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.distributions import BoundedExponential, Empirical
from accelerated_evaluation.laws.files import write_law
from accelerated_evaluation.laws.paper.independent import IndependentLaw
from accelerated_evaluation.laws.smooth.dependent import DependentLaw
from accelerated_evaluation.records.encounter_table import complete, write_encounters
from accelerated_evaluation.track.campaign import Campaign
from accelerated_evaluation.track.campaign_file import law_of, source_of, stopping, write_campaign
from accelerated_evaluation.track.driven import DrivenOutcome
from accelerated_evaluation.track.weighted_set import _places
from accelerated_evaluation.track.whole import (
    ALONE,
    _reach,
    log_density,
    read_draws,
    read_under,
    whole_in_words,
)
from accelerated_evaluation.vehicles.events import CRASH
from scipy.stats import norm
from test_mean_law import SUPPORT, encounters, law  # noqa: F401

LIMIT = 6.0  # [m/s^2], constant deceleration from which a cut-in ends in a crash
BATCHES = 11


def drive(own, name, encounters, folder):  # noqa: F811
    """Return a campaign under a law that was driven for some batches of 20 runs."""
    table = complete(encounters).assign(segment=encounters["segment"])
    write_encounters(folder / "encounters.parquet", table, "made up")
    write_law(folder / name, own, table)
    sources = source_of(folder / name), source_of(folder / "encounters.parquet")
    begun = Campaign.begin(*sources, CRASH, stopping(0.8, 0.2, anytime=False), batch_size=20, seed=3)
    for _ in range(BATCHES):
        runs = begun.ask(own)
        begun.tell({run.number: driven(run) for run in runs})
    return begun


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("campaign")


@pytest.fixture(scope="module")
def campaign(law, encounters, folder):  # noqa: F811
    return drive(law.thinned(12), "law.json", encounters, folder)


def single(law, number):  # noqa: F811
    """Return one of the draws as a law of its own."""
    draws, speeds = law.draws, law.draws.laws[number]
    return DependentLaw(
        "one", law.counts, draws.ranges[draws.shared[number]], speeds, law.lead_speeds, support=SUPPORT
    )


def driven(run):
    _, range_, closing_speed = run.encounter
    needed = max(closing_speed, 0.0) ** 2 / (2 * range_)
    return DrivenOutcome(bool(needed > LIMIT), {"min_ttc": float(LIMIT / (needed + 0.01))})


def exact(few):
    """P(C^2 / (2 R) > LIMIT) under every draw, over a lattice of lead speeds and ranges."""
    draws, probabilities = few.draws, []
    for shared, speeds in zip(draws.shared, draws.laws, strict=True):
        one = DependentLaw("", few.counts, draws.ranges[shared], speeds, few.lead_speeds, support=SUPPORT)
        places, _ = _places(one, np.random.default_rng(1))
        speed = np.sqrt(2 * LIMIT * places.range_)
        second = one.strata["5-15"].second(places.lead_speed, places.inverse_range, speed)
        probabilities.append(np.exp(-second).mean())
    return np.array(probabilities)


def test_the_status_reports_the_answer_under_all_draws(campaign):
    lines = "\n".join(whole_in_words(campaign, law_of(campaign)))
    median = float(re.search(r"cut-in (\S+) \(median\)", lines)[1])
    low, high = map(float, re.search(r"80%: (\S+) to (\S+);", lines).groups())
    known = exact(law_of(campaign))
    assert abs(np.log(median / np.median(known))) < 0.6  # three relative errors of the sampling
    assert low < np.median(known) < high
    assert "only more records reduce" in lines


def test_one_law_alone_says_how_to_read_it_under_all(campaign, law):  # noqa: F811
    assert whole_in_words(campaign, single(law, 0)) == [ALONE]


def test_the_density_of_one_law_is_that_of_the_draw(law):  # noqa: F811
    few, z = law.thinned(6), np.random.default_rng(5).normal(size=(80, 3)) * [1, 1.5, 1.5]
    for number in range(few.draws.size):
        one = single(few, number)
        densities = few.log_densities(one.from_normal_scores(z))
        np.testing.assert_allclose(log_density(one, z), densities[number], rtol=1e-6, atol=1e-6)
    densities = few.log_densities(few.from_normal_scores(z))
    np.testing.assert_allclose(log_density(few, z), np.log(np.exp(densities).mean(axis=0)), atol=1e-6)


def test_the_density_of_the_papers_law_is_normalised():
    """The mean of g / f over draws of f is 1 for every density g of log R and C: here a narrow normal one."""
    segments = {"slow": Empirical(np.linspace(5, 15, 50)), "fast": Empirical(np.linspace(15, 25, 50))}
    tails = {name: BoundedExponential(rate) for name, rate in (("slow", 8.0), ("fast", 5.0))}
    counts = {"slow": 60, "fast": 40}
    paper = IndependentLaw("", counts, BoundedExponential(20.0, 0.0125), tails, segments)
    z = np.random.default_rng(6).normal(size=(40_000, 3))
    cut_ins = paper.from_normal_scores(z)
    other = norm.logpdf(np.log(cut_ins.range_), 2.5, 0.3) + norm.logpdf(cut_ins.closing_speed, 2.0, 0.5)
    weights = np.exp(other - log_density(paper, z))
    assert abs(weights.mean() - 1) < 4.5 * weights.std() / 200
    wrong = np.exp(other - log_density(paper, z) + np.log(cut_ins.inverse_range))  # one slope forgotten
    assert abs(wrong.mean() - 1) > 4.5 * wrong.std() / 200


def test_a_campaign_under_one_law_is_read_under_all(campaign, law, encounters, folder, capsys):  # noqa: F811
    few = law_of(campaign)
    known = exact(few)
    middle = int(np.argsort(known)[-3])  # crashes often, so that its runs reach those of the others
    other = drive(single(few, middle), "one.json", encounters, folder)
    draws = read_draws(folder / "law.json", other)
    found = read_under(other, law_of(other), draws).refined().probabilities
    assert abs(np.log(found[middle] / known[middle])) < 0.6  # three relative errors of the sampling
    assert np.median(np.abs(np.log(found / known))) < 0.6
    write_campaign(folder / "campaign.json", other)
    command = ["campaign", "status", str(folder / "campaign.json")]
    assert cli.main([*command, "--under", str(folder / "law.json")]) == 0
    printed = capsys.readouterr().out
    assert "80%: " in printed
    assert "\neffective   " in printed
    assert cli.main(command) == 0
    assert ALONE in capsys.readouterr().out


def test_a_law_with_draws_read_under_itself_is_unchanged(campaign):
    few = law_of(campaign)
    itself = read_under(campaign, few, few).refined().probabilities
    np.testing.assert_allclose(
        itself, Course(few, campaign.sampler, draws_of(few)).refined().probabilities, rtol=1e-6
    )


def test_runs_that_do_not_reach_other_laws_are_warned_of():
    assert len(_reach(np.r_[np.full(96, 30.0), np.full(4, 3.0)])) == 1
    (line, warning) = _reach(np.r_[np.full(80, 30.0), np.full(20, 3.0)])
    assert line.startswith("effective   30 events under the median draw, 3 or more under 95 % of the draws")
    assert "fewer than 10 effective events under 20% of the draws" in warning


def test_a_single_law_cannot_be_read_under(campaign, law, encounters, folder):  # noqa: F811
    table = complete(encounters).assign(segment=encounters["segment"])
    write_law(folder / "single.json", single(law, 0), table)
    with pytest.raises(InputError, match=r"--under: seen the single law .*; expected a law with draws"):
        read_draws(folder / "single.json", campaign)
