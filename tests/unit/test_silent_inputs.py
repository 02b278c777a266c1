"""Inputs that used to end in a traceback, or to be taken in silence: each has one clear message."""

import json

import pandas as pd
import pytest
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.study.configuration import read_yaml, resolved
from accelerated_evaluation.vehicles.loading import section_files
from motorway import motorway_  # noqa: F401


@pytest.mark.parametrize(
    "text", ["a: &x {b: *x}", "a: &x [1, *x]", "a: &x {b: {c: [*x]}}", "data: &x {source: table, table: *x}"]
)
def test_a_configuration_that_holds_itself_is_refused(text, tmp_path):
    (tmp_path / "self.yaml").write_text(text)
    with pytest.raises(InputError, match="a part that holds itself by an alias"):
        read_yaml(tmp_path / "self.yaml")


def test_an_alias_that_is_used_twice_is_no_loop(tmp_path):
    (tmp_path / "twice.yaml").write_text("a: &x {b: 1}\nc: *x\nd: [*x, *x]")
    assert read_yaml(tmp_path / "twice.yaml")["d"] == [{"b": 1}, {"b": 1}]


def test_a_file_of_a_vehicle_has_to_exist():
    with pytest.raises(InputError, match=r"nowhere\.py: seen no such file"):
        section_files({"name": "acc_aeb", "parameters": {}, "files": ["nowhere.py"]})


def test_limits_between_which_there_is_no_record_are_refused(motorway):
    motorway["filters"]["lead_speed_min"] = 99
    with pytest.raises(InputError, match="contains the lead speed of no record"):
        resolved(motorway)


@pytest.mark.parametrize("change", [{"seed": 7}, {"filters.range_max": 1}, None, "x"])
def test_limits_that_were_changed_by_hand_are_read_off_the_records_again(change, motorway, tmp_path):
    kept = tmp_path / "limits.json"
    files = ["data/motorway.csv"]
    right = resolved(motorway, files, kept)
    content = json.loads(kept.read_text())
    content["limits"] = content["limits"] | change if isinstance(change, dict) else change
    kept.write_text(json.dumps(content))
    assert resolved(motorway, files, kept) == right


def test_no_text_of_a_table_is_a_formula(tmp_path):
    table = pd.DataFrame({"file": ["=cmd()", "@sum", "a=b", None], "value": [1.5, -2.0, 3.0, 4.0]})
    write_csv(tmp_path / "t.csv", table)
    text = (tmp_path / "t.csv").read_text()
    assert text == "file,value\n'=cmd(),1.5\n'@sum,-2.0\na=b,3.0\n,4.0\n"
