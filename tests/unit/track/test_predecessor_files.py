"""Runs of a similar vehicle from an earlier campaign, or from the table of an earlier estimate."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from accelerated_evaluation import CUT_IN, Problem, cli, load_vehicle, write_law
from accelerated_evaluation.records.segments import read_encounters
from accelerated_evaluation.track.campaign_file import read_campaign
from accelerated_evaluation.track.results import status_of
from law_folder import LAW, begin_campaign

PROBLEM = Problem(CUT_IN, load_vehicle("acc_aeb"), law=LAW)


def driven(step, name, batches):
    """Drive some batches of a campaign with the built-in car."""
    for _ in range(batches):
        assert step("ask", "next", "--no-scenarios") == 0
        assert cli.main(["simulate", "next/runs.csv", "done.csv"]) == 0
        assert step("tell", "done.csv") == 0
    return read_campaign(name)


@pytest.fixture
def first(tmp_path, monkeypatch):
    """A campaign that has met the event, and a function that runs one step of it."""
    monkeypatch.chdir(tmp_path)
    step = begin_campaign(tmp_path)
    while not status_of(driven(step, "c.json", 1)).may_stop:
        pass
    return step


def begin_next(*options):
    files = ("--law", "law.json", "--encounters", "encounters.parquet", "--half-width", "0.5")
    return cli.main(
        [
            "campaign",
            "new",
            "next.json",
            *files,
            "--deterministic",
            "yes",
            "--predecessor",
            "c.json",
            *options,
        ]
    )


def test_a_campaign_begins_where_its_predecessor_met_the_event(first):
    old = read_campaign("c.json")
    assert begin_next("--batch-size", "5") == 0

    def step(name, *arguments):
        return cli.main(["campaign", name, "next.json", *map(str, arguments)])

    new = driven(step, "next.json", 4)
    assert new.sampler.progress.happened.any()  # a search takes 20 runs and more before it knows anything
    np.testing.assert_array_equal(new.sampler.predecessor.z, old.sampler.progress.z)


def test_another_law_or_event_is_no_predecessor(first, capsys):
    assert begin_next("--event", "min_range=1") == 2
    assert "--predecessor, its event: seen crash; expected range at most 1 m" in capsys.readouterr().err
    write_law("law.json", replace(LAW, description="another"), read_encounters("encounters.parquet"))
    assert begin_next() == 2
    assert "--predecessor, its law: seen" in capsys.readouterr().err
    assert not Path("next.json").exists()


def test_a_campaign_without_events_is_no_predecessor(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    begin_campaign(tmp_path)
    assert begin_next() == 2
    assert "no event in 0 runs of complete batches" in capsys.readouterr().err
