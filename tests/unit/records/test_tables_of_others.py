"""Tables that others exported: separators, decimal commas, no header, dates, and what the messages name."""

import gzip
import re

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from accelerated_evaluation import SCENARIOS, InputError, cli, load
from accelerated_evaluation.laws.motion.recorded import Recorded
from accelerated_evaluation.records.checks import FINE, STOP, Records, inspect_records
from accelerated_evaluation.scenarios.record_table import read_record_table

CUT_INS = ["lead_speed", "range", "closing_speed"]
CELLS = [
    ("1,5", "decimal comma"),
    ("1.234,5", "thousands separators and with a point"),
    ("1,234.5", "thousands separators"),
    ("1 234,567", "thousands separators and"),
    ("1,234,567", "thousands"),
    ("12.5 m", "without their units"),
    ("2024-01-01", "Dates"),
    ("n/a?", ""),
]
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


@pytest.mark.parametrize(("cell", "advice"), CELLS)
@pytest.mark.parametrize("scenario", NAMES)
def test_a_cell_is_shown_with_how_to_correct_it(tmp_path, scenario, cell, advice):
    rows = table(NAMES[scenario]).astype(str)
    rows.iloc[3, 0] = cell
    rows.to_csv(tmp_path / "t.csv", index=False)
    with pytest.raises(InputError, match=rf"row 5, column .*seen '{re.escape(cell)}'; .*{advice}"):
        read_record_table(SCENARIOS[scenario], tmp_path / "t.csv", "driver")


@pytest.mark.parametrize("scenario", NAMES)
def test_dates_in_a_parquet_file_are_one_message(tmp_path, scenario):
    rows = table(NAMES[scenario])
    rows[rows.columns[1]] = pd.Timestamp("2024-01-01")
    rows.to_parquet(tmp_path / "t.parquet")
    with pytest.raises(InputError, match=r"row 2, column .*seen Timestamp"):
        read_record_table(SCENARIOS[scenario], tmp_path / "t.parquet", "driver")


@pytest.mark.parametrize("kind", [pa.binary(2), pa.binary(), pa.large_binary()])
@pytest.mark.parametrize("door", ["table", "records", "motion"])
def test_binary_columns_of_a_parquet_file_are_one_message(tmp_path, kind, door):
    rows = cut_ins().assign(**{f"speed_{k}": 20.0 for k in range(1, 9)})
    if door == "records":
        rows = table(NAMES["left_turn"])
    column, own = rows.columns[1], pa.Table.from_pandas(rows, preserve_index=False)
    cells = pa.array([np.float16(20).tobytes()] * len(rows), kind)
    pq.write_table(own.set_column(1, column, cells), tmp_path / "t.parquet")
    read = {
        "table": lambda path: load(given={"data": {"source": "table", "table": {"path": str(path)}}}),
        "records": lambda path: read_record_table(SCENARIOS["left_turn"], path, "driver"),
        "motion": Recorded.read,
    }[door]
    with pytest.raises(
        InputError, match=rf"t\.parquet, column '{column}': seen the type \w*binary.*; expected"
    ):
        read(tmp_path / "t.parquet")


def cut_ins(size=200):
    generator = np.random.default_rng(1)
    values = generator.uniform([10, 5, 0.5], [30, 60, 6], (size, 3)).round(2)
    return pd.DataFrame(values, columns=CUT_INS)


@pytest.mark.parametrize(("cell", "advice"), CELLS)
@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_cell_of_a_table_of_cut_ins_is_shown(tmp_path, monkeypatch, capsys, cell, advice, ending):
    monkeypatch.chdir(tmp_path)
    rows = cut_ins().assign(range=cell)
    rows.to_csv("t.csv", index=False) if ending == "csv" else rows.to_parquet("t.parquet")
    assert cli.main(["inspect", f"t.{ending}"]) == 2
    message = capsys.readouterr().err
    assert f"none of them with three valid numbers; row 1 has {cell!r} as range; expected" in message
    assert advice in message


def test_empty_cells_and_a_few_cells_are_shown(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    cut_ins().assign(range="").to_csv("t.csv", index=False)
    assert cli.main(["inspect", "t.csv"]) == 2
    assert "row 1 has no value as range" in capsys.readouterr().err
    rows = cut_ins().astype(str)
    rows.loc[7, "range"] = "12,5"
    rows.to_csv("t.csv", index=False)
    assert cli.main(["inspect", "t.csv"]) == 0
    printed = capsys.readouterr().out
    assert "invalid values: 1 of 200 rows; row 8 has '12,5' as range" in printed
    assert "a point in place of a decimal comma" in " ".join(printed.split())


@pytest.mark.parametrize("name", CUT_INS)
@pytest.mark.parametrize(
    "put_in_order",
    [
        lambda rows, name: rows.sort_values(name),
        lambda rows, name: rows.sort_values(name, ascending=False),
        lambda rows, name: pd.concat([part.sort_values(name) for part in (rows[:900], rows[900:])]),
        lambda rows, name: rows.round(1).sort_values(name),
    ],
)
def test_sorted_rows_are_no_stuck_sensor(name, put_in_order):
    columns = ["verdict", "seen", "advice"]
    config = load()
    for order in (put_in_order, lambda rows, _: rows):
        rows = order(cut_ins(2000), name).reset_index(drop=True)
        rows.index += 1
        records = Records.of(rows, config["filters"], config["segments"]["lead_speed_edges"])
        found = inspect_records(records).set_index("check")
        verdict, seen, advice = found.loc["order of rows", columns]
        if order is put_in_order:
            assert (verdict, seen) == (STOP, f"sorted by {name}")
            assert "drift, nearly repeated rows, stuck sensor." in advice
            assert not {"drift", "nearly repeated rows", "stuck sensor"} & set(found.index)
        else:
            assert (verdict, seen) == (FINE, "not sorted")
            assert {"drift", "nearly repeated rows", "stuck sensor"} <= set(found.index)


SLOPES = np.linspace(-1, 1, 40)[:, None] * np.linspace(0.1, 8, 80)
RECORDED = cut_ins(40).join(pd.DataFrame(SLOPES, columns=[f"speed_{k / 10:.1f}" for k in range(1, 81)]))
SPEEDS = [name for name in RECORDED if name.startswith("speed_")]
RECORDED[SPEEDS] = RECORDED[SPEEDS].add(RECORDED["lead_speed"], axis=0).clip(lower=0)
DATE = pd.Timestamp("2024-01-01")
MOTIONS = {
    "as recorded": (lambda rows: rows, ""),
    "each twice": (lambda rows: pd.concat([rows, rows]), ""),
    "constant range": (lambda rows: rows.assign(range=30.1), "column range: seen 30.1 in all 40 cut-ins"),
    "one repeated": (lambda rows: rows.iloc[[3] * 40], "seen 40 cut-ins, 1 of them different"),
    "few": (lambda rows: rows.iloc[:9], "seen 9 cut-ins, 9 of them different"),
    "wrong column": (lambda rows: rows.rename(columns={"range": "gap"}), "column 'range': seen only"),
    "dates": (lambda rows: rows.assign(range=DATE), "cut-in 0, column range: seen Timestamp"),
    "decimal comma": (lambda rows: rows.assign(range="12,5"), "seen '12,5'; expected a number. Write"),
    "lists": (lambda rows: rows.assign(range=[[1, 2]] * 40), "column range: seen array([1, 2])"),
    "far too fast": (lambda rows: rows * [1e300 if "speed" in name else 1 for name in rows], "up to 300 m/s"),
    "no speeds": (lambda rows: rows.assign(**dict.fromkeys(SPEEDS, np.nan)), "seen no speed after"),
}


@pytest.mark.parametrize("spoiled", MOTIONS)
def test_lead_motion_of_replay_is_taken_or_one_message(tmp_path, monkeypatch, capsys, spoiled):
    monkeypatch.chdir(tmp_path)
    change, message = MOTIONS[spoiled]
    change(RECORDED).to_parquet("m.parquet")
    encounter = [*map(str, RECORDED.loc[0, CUT_INS]), "states.csv"]
    assert cli.main(["replay", *encounter, "--motion", "m.parquet"]) == (2 if message else 0)
    assert message in capsys.readouterr().err
    assert (tmp_path / "states.csv").exists() == (not message)
    if not message:
        assert np.isfinite(pd.read_csv("states.csv")["lead_speed_m_per_s"]).all()


def test_equally_far_recorded_cut_ins_are_drawn_alike():
    """Repeated cut-ins are all neighbours, at one distance, to which tricube weights would give no weight."""
    rows = pd.concat([RECORDED.iloc[[0] * 200], RECORDED.iloc[1:]])
    encounter = RECORDED[CUT_INS].to_numpy(float)[:1].T + np.array([[0.01], [0.0], [0.0]])
    speeds = Recorded.of(rows).lead_speeds(encounter, np.array([[0.5]]))
    changes = RECORDED[SPEEDS].iloc[0] - RECORDED["lead_speed"].iloc[0]
    np.testing.assert_allclose(speeds[0, 1:] - encounter[0], changes, atol=1e-9)


@pytest.mark.parametrize("name", ["place", "place.csv", "place.parquet"])
@pytest.mark.parametrize(
    "command",
    [
        ["inspect", "{}"],
        ["simulate", "{}", "o.csv"],
        ["replay", "20", "15", "6", "o.csv", "--motion", "{}"],
        ["simulate", "t.csv", "{}"],
        ["replay", "20", "15", "6", "{}"],
        ["inspect", "t.csv", "--report", "{}"],
        ["estimate", "--config", "{}"],
        ["campaign", "tell", "{}", "t.csv"],
    ],
    ids=" ".join,
)
def test_a_folder_in_place_of_a_file_is_one_message(tmp_path, monkeypatch, capsys, command, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).mkdir()
    cut_ins().to_csv("t.csv", index=False)
    try:
        status = cli.main([word.format(name) for word in command])
    except SystemExit as end:
        status = end.code
    message = capsys.readouterr().err
    assert status == 2
    assert name in message
    assert re.search("folder|directory|end(s|ing) in|.csv or .parquet", message)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([name, "t.csv"])


@pytest.mark.parametrize("damage", ["no archive", "cut off", "changed"])
def test_a_damaged_archive_is_one_message(tmp_path, monkeypatch, capsys, damage):
    monkeypatch.chdir(tmp_path)
    text = cut_ins(2000).to_csv(index=False).encode()
    content = bytearray(gzip.compress(text))
    content[500:700] = b"x" * 200
    damaged = {"no archive": b"text", "cut off": gzip.compress(text)[:-100], "changed": content}
    (tmp_path / "t.csv.gz").write_bytes(damaged[damage])
    assert cli.main(["simulate", "t.csv.gz", "o.csv"]) == 2
    message = capsys.readouterr().err
    assert message.startswith("error: t.csv.gz: seen content that cannot be read")
    assert not (tmp_path / "o.csv").exists()
