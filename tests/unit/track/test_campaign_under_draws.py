"""A campaign reports the answer under all draws of a mean law, also if it was begun under a single law."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from accelerated_evaluation import CUT_IN, InputError, cli, write_law
from accelerated_evaluation.answer.ways.by_few_runs import laws_of
from accelerated_evaluation.records.segments import write_encounters
from accelerated_evaluation.track.campaign import Campaign
from accelerated_evaluation.track.campaign_file import law_of, source_of, stopping, write_campaign
from accelerated_evaluation.track.driven import DrivenOutcome
from accelerated_evaluation.track.under_draws import ALONE, _reach, laws_under, read_draws, whole_in_words
from accelerated_evaluation.vehicles.protocol import CRASH
from mean_law import braking_probabilities, encounters_, law_, one_draw  # noqa: F401

LIMIT = 6.0  # [m/s^2], constant deceleration from which a cut-in ends in a crash
RUNS = 220  # number of runs of a campaign


def drive(own, name, encounters, folder, seed=3):
    """Return a campaign under a law that was driven in batches of 20 runs or fewer."""
    write_encounters(folder / "encounters.parquet", encounters, "made up")
    write_law(folder / name, own, encounters)
    sources = source_of(folder / name), source_of(folder / "encounters.parquet")
    given = *sources, CRASH, stopping(0.8, 0.2, anytime=False)
    begun = Campaign.begin(*given, batch_size=20, seed=seed, scenario=CUT_IN)
    while len(begun.runs) < RUNS:
        runs = begun.ask(own)
        begun.tell({run.number: driven(run) for run in runs})
    return begun


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("campaign")


@pytest.fixture(scope="module")
def campaign(law, encounters, folder):
    return drive(law.thinned(12), "law.json", encounters, folder)


def driven(run):
    _, range_, closing_speed = run.encounter
    needed = max(closing_speed, 0.0) ** 2 / (2 * range_)
    return DrivenOutcome(bool(needed > LIMIT), {"min_ttc": float(LIMIT / (needed + 0.01))})


def test_the_status_reports_the_answer_under_all_draws(campaign):
    lines = "\n".join(whole_in_words(campaign, law_of(campaign)))
    median = float(re.search(r"cut-in (\S+) \(median, 1 in", lines)[1])
    low, high = map(float, re.search(r"80%: (\S+) to (\S+);", lines).groups())
    known = braking_probabilities(law_of(campaign), LIMIT)
    assert abs(np.log(median / np.median(known))) < 0.6  # three relative errors of the sampling
    assert low < np.median(known) < high
    assert "only more records reduce" in lines


def test_one_law_alone_says_how_to_read_it_under_all(campaign, law):
    assert whole_in_words(campaign, one_draw(law, 0)) == [ALONE]


def test_a_campaign_under_one_law_is_read_under_all(campaign, law, encounters, folder, capsys):
    few = law_of(campaign)
    known = braking_probabilities(few, LIMIT)
    middle = int(np.argsort(known)[-3])  # crashes often, so that its runs reach those of the others
    # Runs under one law reach where the others have their crashes only in some campaigns: of six seeds, in
    # three. `_reach` warns of the rest.
    other = drive(one_draw(few, middle), "one.json", encounters, folder, seed=5)
    draws = read_draws(folder / "law.json", other)
    found = laws_under(law_of(other), draws).refined(other.sampler)
    errors = np.abs(np.log(found.probabilities / known)) / found.errors  # in stated errors of the sampling
    assert errors[middle] < 3
    assert np.median(errors) < 3
    write_campaign(folder / "campaign.json", other)
    command = ["campaign", "status", str(folder / "campaign.json")]
    assert cli.main([*command, "--under", str(folder / "law.json")]) == 0
    printed = capsys.readouterr().out
    assert (
        "80%: " in printed or "not known from these runs" in printed
    )  # if half of the draws are out of reach
    assert "\neffective   " in printed
    assert cli.main(command) == 0
    assert ALONE in capsys.readouterr().out


def test_a_law_with_draws_read_under_itself_is_unchanged(campaign):
    few = law_of(campaign)
    itself = laws_under(few, few).refined(campaign.sampler).probabilities
    known = laws_of(few, few.from_normal_scores).refined(campaign.sampler).probabilities
    np.testing.assert_allclose(itself, known, rtol=1e-6)


def test_runs_at_the_cap_count_for_all_speeds_from_the_cap_on(law):
    """The ratios average to one under each draw, although the draws have another cap."""
    few, own = law.thinned(6), one_draw(law, 30, cap=6.0)
    z = np.random.default_rng(7).standard_normal((40_000, 3))
    x, ratios = own.from_normal_scores(z), laws_under(own, few).ratios(z)
    apart = np.abs(ratios.mean(axis=1) - 1) / ratios.std(axis=1) * np.sqrt(len(x))
    assert apart.max() < 4.5
    wrong = np.exp(few.log_densities(x) - own.log_density(x))  # densities at the cap, but not under its law
    assert np.min(np.abs(wrong.mean(axis=1) - 1) / wrong.std(axis=1) * np.sqrt(len(x))) > 9


def test_runs_that_do_not_reach_other_laws_are_warned_of():
    def reach(*effective):
        laws = SimpleNamespace(effective_events=lambda _: np.repeat([30.0, 3.0], effective))
        return _reach(laws, SimpleNamespace(is_counted=False, progress=None))

    assert len(reach(96, 4)) == 1
    (line, warning) = reach(80, 20)
    assert line.startswith("effective   30 events under the median draw, 3 or more under 95 % of the draws")
    assert "fewer than 10 effective events under 20% of the draws" in warning


def test_a_single_law_cannot_be_read_under(campaign, law, encounters, folder):
    write_law(folder / "single.json", one_draw(law, 0), encounters)
    with pytest.raises(InputError, match=r"--under: seen the single law .*; expected a law with draws"):
        read_draws(folder / "single.json", campaign)
