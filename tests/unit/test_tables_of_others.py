"""Tables that others exported: separators, decimal commas, no header, dates, and what the messages name."""

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import SCENARIOS, InputError, cli
from accelerated_evaluation.laws.motion.recorded import Recorded
from accelerated_evaluation.scenarios.record_table import read_record_table

NAMES = {name: [*SCENARIOS[name].names, "driver"] for name in ("left_turn", "pedestrian")}
SPOILED = {
    "semicolons": lambda text: text.replace(",", ";"),
    "tabs": lambda text: text.replace(",", "\t"),
    "vertical bars": lambda text: text.replace(",", "|"),
    "the table has no header": lambda text: text.split("\n", 1)[1],
}


def table(names):
    return pd.DataFrame({name: np.linspace(1.25, 9.5, 20) for name in names})


@pytest.mark.parametrize("named", SPOILED)
@pytest.mark.parametrize("scenario", NAMES)
def test_the_separator_that_was_seen_is_named(tmp_path, monkeypatch, capsys, scenario, named):
    monkeypatch.chdir(tmp_path)
    text = SPOILED[named](table(NAMES[scenario]).to_csv(index=False))
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(InputError, match=rf"t\.csv, row 1: seen .*{named}.*commas"):
        read_record_table(SCENARIOS[scenario], "t.csv", "driver")
    assert cli.main(["simulate", "t.csv", "o.csv", "--scenario", scenario]) == 2
    assert named in capsys.readouterr().err


@pytest.mark.parametrize(
    ("cell", "advice"),
    [("1,5", "decimal comma"), ("1,234.5", "thousands separators"), ("1,234,567", "thousands")],
)
@pytest.mark.parametrize("scenario", NAMES)
def test_a_cell_is_shown_with_how_to_correct_it(tmp_path, scenario, cell, advice):
    rows = table(NAMES[scenario]).astype(str)
    rows.iloc[3, 0] = cell
    rows.to_csv(tmp_path / "t.csv", index=False)
    with pytest.raises(InputError, match=rf"row 5, column .*seen '{cell}'; .*{advice}"):
        read_record_table(SCENARIOS[scenario], tmp_path / "t.csv", "driver")


@pytest.mark.parametrize("scenario", NAMES)
def test_dates_in_a_parquet_file_are_one_message(tmp_path, scenario):
    rows = table(NAMES[scenario])
    rows[rows.columns[1]] = pd.Timestamp("2024-01-01")
    rows.to_parquet(tmp_path / "t.parquet")
    with pytest.raises(InputError, match=r"row 2, column .*seen Timestamp"):
        read_record_table(SCENARIOS[scenario], tmp_path / "t.parquet", "driver")


def test_dates_in_a_table_of_lead_motion_are_one_message(tmp_path):
    rows = pd.DataFrame({"lead_speed": [20.0] * 40, "range": 30.0, "closing_speed": 2.0})
    rows = rows.assign(**{f"speed_{k}": 20.0 for k in range(1, 9)})
    for column in ("range", "speed_3"):
        rows.assign(**{column: pd.Timestamp("2024-01-01")}).to_parquet(tmp_path / "m.parquet")
        with pytest.raises(InputError, match=rf"m\.parquet, cut-in 0, column {column}: seen Timestamp"):
            Recorded.read(tmp_path / "m.parquet")
