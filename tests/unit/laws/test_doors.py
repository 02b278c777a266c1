"""Every door that takes a law asks whether it is the law of the encounters, and takes no damaged law."""

import json
import math
import re

import numpy as np
import pytest
from accelerated_evaluation import cli
from accelerated_evaluation.laws.files import signed
from accelerated_evaluation.records.segments import NUMBERS, read_encounters, write_encounters
from law_folder import write_law_folder

DOORS = {"campaign new": ["campaign", "new", "c.json"], "export": ["export", "set"]}
OTHERS = {
    "a sample": lambda table: table.sample(900, random_state=1),
    "the rows in another order": lambda table: table.sample(frac=1, random_state=1),
    "speeds times .9": lambda table: table.assign(lead_speed=5 + 0.9 * (table["lead_speed"] - 5)),
    "one digit": lambda table: table.assign(range=table["range"] * (1 + 1e-9 * (table.index == 3))),
    "ranges of others": lambda table: table.assign(range=np.roll(table["range"], 7)),
}


@pytest.fixture(params=DOORS.values(), ids=DOORS)
def door(request, tmp_path, monkeypatch, capsys):
    """Return a function that passes a door with the law and table of a folder, and says what it printed."""
    monkeypatch.chdir(tmp_path)
    write_law_folder(tmp_path)

    def through():
        status = cli.main([*request.param, "--law", "law.json", "--encounters", "encounters.parquet"])
        printed = capsys.readouterr()
        assert "Traceback" not in printed.err
        return status, printed.err

    return through


def test_a_law_passes_with_its_own_table(door):
    assert door()[0] == 0


@pytest.mark.parametrize("change", OTHERS.values(), ids=OTHERS)
def test_a_law_is_refused_with_any_other_table(door, change):
    table = change(read_encounters("encounters.parquet"))
    assert set(NUMBERS) < set(table)
    write_encounters("encounters.parquet", table, "another")
    status, reported = door()
    assert status != 0
    assert "the encounter table of this law: seen another table" in reported


def leaves(value, place=()):
    """Yield the places of all numbers in JSON."""
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in parts:
        yield from leaves(part, (*place, key))
    if isinstance(value, float) and not isinstance(value, bool):
        yield place


@pytest.mark.parametrize("wrong", [math.nan, None, "x", []], ids=["NaN", "null", "text", "list"])
def test_no_number_of_a_law_may_be_missing(wrong, door, tmp_path):
    whole = json.loads((tmp_path / "law.json").read_text())
    for place in leaves(whole):
        if place == ("variables", 2, "upper") and wrong is None:
            continue  # no cap
        content = json.loads(json.dumps(whole))
        inner = content
        for key in place[:-1]:
            inner = inner[key]
        inner[place[-1]] = wrong
        (tmp_path / "law.json").write_text(json.dumps(signed(content)))
        status, reported = door()
        assert status != 0, place
        assert re.search(r"law\.json(, Box, argument \w+)?: seen", reported), (place, reported)
