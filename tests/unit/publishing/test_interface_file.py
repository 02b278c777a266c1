"""INTERFACE.yaml: what a user brings to the workflow, and what comes out."""

from pathlib import Path

import yaml
from accelerated_evaluation.publishing.interface import INTERFACE, described_tables, written
from accelerated_evaluation.publishing.study import TABLES, Study
from accelerated_evaluation.study.schema import keys

ROOT = Path(__file__).parents[3]


def known():
    return yaml.safe_load(INTERFACE.read_text(encoding="utf-8"))


def test_the_file_is_up_to_date():
    change = "run python -m accelerated_evaluation.publishing.interface"
    assert INTERFACE.read_text(encoding="utf-8") == written(), change


def test_files_of_a_user_are_keys_of_the_configuration():
    files = known()["configuration"]["files"]
    assert set(files) <= set(dict(keys()))
    assert (ROOT / known()["configuration"]["all_keys"]).is_file()
    assert {"modules", "vehicle.name", "scenario.records", "data.table.path"} <= set(files)


def test_every_table_of_a_study_has_its_path_and_a_description():
    tables = known()["results"]["tables"]
    assert list(tables) == list(TABLES)
    for name, table in tables.items():
        assert table["path"] == f"results/{{study}}/{TABLES[name]}"
        assert table["description"].endswith(".")
    assert described_tables()["segment_counts"][1] == "Number and share of the lane changes in each segment."


def test_a_study_reads_each_table_from_its_path(tmp_path):
    (tmp_path / "results/mine").mkdir(parents=True)
    path = known()["results"]["tables"]["segment_counts"]["path"].format(study="mine")
    (tmp_path / path).write_text("segment,share\n5-15,0.5\n")
    study = Study(str(tmp_path / "results/mine"), str(tmp_path / "figures/mine"))
    assert study.segment_counts["share"].tolist() == [0.5]
