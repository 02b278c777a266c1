"""A campaign under a mean law reports the answer under all draws; one under a single law says why not."""

import re
from dataclasses import replace

import numpy as np
import pytest
from accelerated_evaluation.laws.files import write_law
from accelerated_evaluation.laws.smooth.dependent import DependentLaw
from accelerated_evaluation.records.encounter_table import complete, write_encounters
from accelerated_evaluation.track.campaign import Campaign
from accelerated_evaluation.track.campaign_file import law_of, source_of, stopping
from accelerated_evaluation.track.driven import DrivenOutcome
from accelerated_evaluation.track.weighted_set import _places
from accelerated_evaluation.track.whole import ALONE, whole_in_words
from accelerated_evaluation.vehicles.events import CRASH
from test_mean_law import SUPPORT, encounters, law  # noqa: F401

LIMIT = 6.0  # [m/s^2], constant deceleration from which a cut-in ends in a crash
BATCHES = 11


@pytest.fixture(scope="module")
def campaign(law, encounters, tmp_path_factory):  # noqa: F811
    """Return a campaign that was driven for some batches of 20 runs."""
    folder, few = tmp_path_factory.mktemp("campaign"), replace(law.thinned(12))
    table = complete(encounters).assign(segment=encounters["segment"])
    write_encounters(folder / "encounters.parquet", table, "made up")
    write_law(folder / "law.json", few, table)
    sources = source_of(folder / "law.json"), source_of(folder / "encounters.parquet")
    begun = Campaign.begin(*sources, CRASH, stopping(0.8, 0.2, anytime=False), batch_size=20, seed=3)
    for _ in range(BATCHES):
        runs = begun.ask(few)
        begun.tell({run.number: driven(run) for run in runs})
    return begun


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


def test_one_law_alone_has_no_such_answer(campaign, law):  # noqa: F811
    draws = law.draws
    one = DependentLaw("", law.counts, draws.ranges[0], draws.laws[0], law.lead_speeds, support=SUPPORT)
    assert whole_in_words(campaign, one) == [ALONE]
