"""Files of the project are found from any folder, and a user's own file of the same name comes first."""

from pathlib import Path

import pytest
from accelerated_evaluation import SCENARIOS
from accelerated_evaluation.base.files import PROJECT, project_file
from accelerated_evaluation.scenarios.record_table import read_scenario_records
from accelerated_evaluation.study.configuration import load

RECORDS = "data/spmd/cut_ins.parquet"


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """Run each test in an empty folder."""
    monkeypatch.chdir(tmp_path)


def test_records_are_those_of_the_project_unless_the_folder_has_its_own():
    assert load()["data"]["spmd"]["path"] == str(PROJECT / RECORDS)
    assert len(read_scenario_records(SCENARIOS["pedestrian"])) == 983
    Path(RECORDS).parent.mkdir(parents=True)
    Path(RECORDS).touch()
    assert load()["data"]["spmd"]["path"] == RECORDS


def test_a_path_that_is_nowhere_is_left_for_the_message():
    assert project_file("data/nowhere.csv") == Path("data/nowhere.csv")
    assert project_file(PROJECT / "config/config.yaml") == PROJECT / "config/config.yaml"


def test_a_relative_folder_of_the_project_gives_relative_paths(monkeypatch):
    monkeypatch.chdir(PROJECT / "workflow")
    assert project_file(RECORDS, Path("..")) == Path("..", RECORDS)
