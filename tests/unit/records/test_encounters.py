import copy
import hashlib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import SOURCES, InputError
from accelerated_evaluation.base.tables import read_csv
from accelerated_evaluation.records.dependence import CONFIDENCE, dependence, similarity, tau_interval
from accelerated_evaluation.records.ingest import Account, drop_invalid, ingest, opening_cut_ins
from accelerated_evaluation.records.named import CutInRecords
from accelerated_evaluation.records.segments import (
    COLUMNS,
    NUMBERS,
    assign_segments,
    complete,
    read_encounters,
    segment_counts,
    segment_names,
    write_encounters,
)
from accelerated_evaluation.records.sources import describe, read_source, spmd, table
from accelerated_evaluation.study.configuration import ConfigurationError, load
from scipy.stats import binom, kendalltau

REPOSITORY = Path(__file__).resolve().parents[3]
RECORDS = REPOSITORY / "data" / "spmd" / "cut_ins.parquet"
# SHA-256 of the published 157,757 x 3 doubles, row by row as little-endian bytes.
PUBLISHED = "c023f3a447becd77f8117d1c39adf6f087b02184ca002bcc00360415695602fd"

CSV_HEADER = "lead_speed,range,closing_speed\n"
GOOD_ROWS = "10,50,2\n20,40,3\n30,60,4\n"  # one for each segment


@pytest.fixture
def config():
    config = copy.deepcopy(load())
    config["data"]["source"] = "table"
    return config


@pytest.fixture
def csv_config(config, tmp_path):
    """Write rows below the default header and return a configuration that reads them."""

    def write(rows, header=CSV_HEADER, **changes):
        path = tmp_path / "events.csv"
        path.write_text(header + rows)
        config["data"]["table"]["path"] = str(path)
        config["data"].update(changes)
        return config

    return write


def sections(config):
    """Return the sections of a configuration that `ingest` takes."""
    return config["data"], config["filters"], config["segments"]["lead_speed_edges"]


def ingested(config):
    """Return the encounter table and the account of a configuration's records."""
    raw = read_source(config["data"], np.random.default_rng())
    account = Account(len(raw))
    return ingest(raw, *sections(config), account), account.table()


def normal_pairs(generator, rows, rho):
    """Encounters whose R^-1 and TTC^-1 are functions, rising, of normal variables with correlation rho."""
    z = generator.multivariate_normal([0, 0], [[1, rho], [rho, 1]], rows)
    values = {
        "lead_speed": generator.uniform(5, 15, rows),
        "inverse_range": np.exp(z[:, 0]),
        "inverse_ttc": np.exp(z[:, 1]),
    }
    return pd.DataFrame(values).assign(segment="5-15")


# ---------------------------------------------------------------- contract


def test_complete_derives_the_same_numbers_from_every_way_to_state_them():
    speed, range_, closing = np.array([10.0, 20.0]), np.array([50.0, 8.0]), np.array([2.0, 4.0])
    distances = {"range": range_, "inverse_range": 1 / range_}
    closings = {
        "closing_speed": closing,
        "range_rate": -closing,
        "ttc": range_ / closing,
        "inverse_ttc": closing / range_,
    }
    for distance, x in distances.items():
        for name, y in closings.items():
            result = complete(pd.DataFrame({"lead_speed": speed, distance: x, name: y}))
            expected = np.column_stack((speed, range_, closing, 1 / range_, closing / range_))
            np.testing.assert_allclose(result[list(NUMBERS)], expected, rtol=4 * np.finfo(float).eps)
            assert (result[distance] == x).all()
            assert name not in result or (result[name] == y).all()


def test_encounter_table_has_the_same_bytes_twice_and_reads_back_equal(csv_config, tmp_path):
    encounters, _ = ingested(csv_config(GOOD_ROWS))
    paths = [tmp_path / "a.parquet", tmp_path / "b.parquet"]
    for path in paths:
        write_encounters(path, encounters, "made up for a test")
    assert paths[0].read_bytes() == paths[1].read_bytes()
    again = read_encounters(paths[0])
    pd.testing.assert_frame_equal(again, encounters)
    assert again.attrs["description"] == "made up for a test"
    assert list(again.columns) == list(COLUMNS)


@pytest.mark.parametrize(
    ("change", "seen"),
    [
        (lambda t: t.head(0), "no rows"),
        (lambda t: t.assign(segment=1), "segments without a name"),
        (lambda t: t.assign(segment=t["segment"].where(t.index > 0)), "segments without a name"),
        (
            lambda t: t.assign(range=t["range"].where(t.index > 0)),
            "missing, infinite, below 0 or not numbers",
        ),
        (lambda t: t.assign(closing_speed=-1.0), "missing, infinite, below 0 or not numbers"),
        (lambda t: t.assign(lead_speed=pd.Timestamp("2020-01-01")), "below 0 or not numbers"),
        (lambda t: t[[*t.columns[::-1]]], "columns "),
    ],
)
def test_an_edited_encounter_table_is_refused(csv_config, tmp_path, change, seen):
    encounters, _ = ingested(csv_config(GOOD_ROWS))
    change(encounters).to_parquet(tmp_path / "encounters.parquet", index=False)
    with pytest.raises(InputError, match=rf"encounters\.parquet: seen .*{seen}"):
        read_encounters(tmp_path / "encounters.parquet")


@pytest.mark.parametrize("content", [None, b"no parquet", "other columns"])
def test_read_encounters_refuses_what_is_no_encounter_table(tmp_path, content):
    path = tmp_path / "encounters.parquet"
    if content == "other columns":
        pd.DataFrame({"x": [1.0]}).to_parquet(path)
    elif content:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"encounters\.parquet"):
        read_encounters(path)


def test_write_encounters_leaves_nothing_behind_when_it_fails(tmp_path):
    with pytest.raises(KeyError):
        write_encounters(tmp_path / "encounters.parquet", pd.DataFrame({"lead_speed": [1.0]}), "")
    assert not list(tmp_path.iterdir())


# ---------------------------------------------------------------- the recorded lane changes


@pytest.fixture(scope="module")
def recorded():
    """The default configuration, its records, the encounter table and the account."""
    config = load()
    config["data"]["spmd"]["path"] = str(RECORDS)
    raw = read_source(config["data"], np.random.default_rng())
    account = Account(len(raw))
    return config, raw, ingest(raw, *sections(config), account), account.table()


def test_records_are_those_of_the_published_file(recorded):
    raw = recorded[1]
    assert list(raw.columns) == ["lead_speed", "inverse_range", "inverse_ttc"]
    assert raw.shape == (157_757, 3)
    assert hashlib.sha256(raw.to_numpy("<f8").tobytes()).hexdigest() == PUBLISHED


def test_rows_of_the_records_are_counted_from_one(recorded):
    assert (recorded[1].index[0], recorded[1].index[-1], recorded[1].index.name) == (1, 157_757, "row")


def test_spmd_refuses_a_missing_file(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        spmd.read({"path": tmp_path / "cut_ins.parquet", "sha256": "0" * 64})


@pytest.mark.parametrize("kept", [0.0, 0.5, 0.999])
def test_spmd_refuses_an_altered_file(tmp_path, kept):
    content, path = RECORDS.read_bytes(), tmp_path / "cut_ins.parquet"
    path.write_bytes(content[: int(kept * len(content))])
    sha256 = hashlib.sha256(content).hexdigest()
    with pytest.raises(InputError, match=rf"expected sha256 {sha256}"):
        spmd.read({"path": path, "sha256": sha256})


@pytest.mark.parametrize(
    "columns",
    [
        {"x": [1.0]},
        {"lead_speed": [1.0], "inverse_range": [1], "inverse_ttc": [1.0]},
        {"inverse_range": [1.0], "lead_speed": [1.0], "inverse_ttc": [1.0]},
    ],
)
def test_spmd_refuses_another_table(tmp_path, columns):
    path = tmp_path / "cut_ins.parquet"
    pd.DataFrame(columns).to_parquet(path)
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    with pytest.raises(InputError, match="expected columns of doubles: lead_speed, inverse_range"):
        spmd.read({"path": path, "sha256": sha256})


def test_recorded_events_all_pass_the_filters_of_the_paper(recorded):
    _, raw, encounters, account = recorded
    assert len(encounters) == 157_757
    assert (account["rows_dropped"] == 0).all()
    assert account.set_index("step").loc["repeated", "rows_found"] == 11_703
    assert dict(segment_counts(encounters)[["segment", "rows"]].to_numpy()) == {
        "5-15": 75_783,
        "15-25": 37_580,
        "25-35": 44_394,
    }
    for column in ("lead_speed", "inverse_range", "inverse_ttc"):
        assert (encounters[column].to_numpy() == raw[column].to_numpy()).all()
    assert encounters["range"].max() <= 75 * (1 + np.finfo(float).eps)
    assert encounters["closing_speed"].max() == pytest.approx(22.13, abs=0.005)


def test_recorded_repeated_rows_are_dropped_on_request(recorded):
    config, raw, _, _ = recorded
    config = copy.deepcopy(config)
    config["data"]["repeated_rows"] = "drop"
    encounters = ingest(raw, *sections(config), Account(len(raw)))
    assert len(encounters) == 157_757 - 11_703
    assert not encounters.duplicated().any()


# ---------------------------------------------------------------- a user's table


def test_csv_and_parquet_give_the_same_table(csv_config, tmp_path):
    config = csv_config(GOOD_ROWS)
    from_csv, _ = ingested(config)
    frame = pd.read_csv(config["data"]["table"]["path"])
    config["data"]["table"]["path"] = str(tmp_path / "events.parquet")
    frame.to_parquet(config["data"]["table"]["path"])
    pd.testing.assert_frame_equal(ingested(config)[0], from_csv)


def test_csv_numbers_are_read_exactly(csv_config):
    values = np.random.default_rng(3).uniform(5, 15, (300, 3))
    rows = "".join(",".join(map(repr, row)) + "\n" for row in values.tolist())
    config = csv_config(rows)
    assert (read_source(config["data"], np.random.default_rng()).to_numpy(float) == values).all()


def in_units(row, **changes):
    """A row of a user's table, with other units or quantities of some of its columns."""
    return pytest.param(row, changes, id=row)


@pytest.mark.parametrize(
    ("row", "changes"),
    [
        *(
            in_units(f"{cell},50,{cell}", lead_speed={"unit": unit}, closing={"unit": unit})
            for unit, cell in (("m/s", 10), ("km/h", 36), ("mph", 10 / 0.44704), ("ft/s", 10 / 0.3048))
        ),
        *(
            in_units(f"10,{cell},10", range={"unit": unit})
            for unit, cell in (
                ("m", 50),
                ("km", 0.05),
                ("ft", 50 / 0.3048),
                ("1/m", 0.02),
                ("1/ft", 0.02 * 0.3048),
            )
        ),
        in_units("10,50,36", closing={"quantity": "closing_speed", "unit": "km/h"}),
        in_units("10,50,-10", closing={"quantity": "range_rate", "unit": "m/s"}),
        in_units("10,50,5", closing={"quantity": "ttc", "unit": "s"}),
        in_units("10,50,5000", closing={"quantity": "ttc", "unit": "ms"}),
        in_units("10,50,0.2", closing={"quantity": "ttc", "unit": "1/s"}),
    ],
)
def test_units_and_ways_to_state_how_the_gap_closes(csv_config, row, changes):
    config = csv_config(f"{row}\n20,40,3\n")
    for column, change in changes.items():
        config["data"]["table"]["columns"][column].update(change)
    first = complete(read_source(config["data"], np.random.default_rng()).astype(float)).iloc[0]
    np.testing.assert_allclose(first, [10, 50, 10, 1 / 50, 10 / 50], rtol=1e-15)


@pytest.mark.parametrize(
    ("rows", "reason", "cell"),
    [
        ("10,,2\n", "missing value", "range nan"),
        ("10,NaN,2\n", "missing value", "range nan"),
        ("fast,50,2\n", "text in place of a number", "lead_speed fast"),
        ("10,True,2\n", "text in place of a number", "range True"),
        ("10,50,-inf\n", "infinite value", "closing_speed -inf"),
        ("10,0,2\n", "infinite value, or zero for a range", "range 0.0"),
        ("10,-50,2\n", "negative lead speed or range", "range -50.0"),
        ("-10,50,2\n", "negative lead speed or range", "lead_speed -10.0"),
    ],
)
def test_invalid_rows_are_refused_or_dropped_and_always_named(csv_config, rows, reason, cell):
    with pytest.raises(InputError, match=rf"{reason}.* in row 4 \(.*{cell}.*data\.invalid_rows"):
        ingested(csv_config(GOOD_ROWS + rows))
    encounters, account = ingested(csv_config(GOOD_ROWS + rows, invalid_rows="drop"))
    assert len(encounters) == 3
    found = account[account["rows_found"] > 0]
    assert len(found) == 1
    assert found["reason"].item().startswith(reason)
    assert found["example_rows"].item() == "4"


def test_zero_time_to_collision_is_invalid(csv_config):
    config = csv_config(GOOD_ROWS + "10,50,0\n")
    config["data"]["table"]["columns"]["closing"].update(quantity="ttc", unit="s")
    with pytest.raises(InputError, match="zero for a range or TTC in row 4"):
        ingested(config)


def test_all_invalid_rows_are_reported_at_once(csv_config):
    rows = "".join(f"10,-{number},2\n" for number in range(1, 8)) + "10,,2\n"
    with pytest.raises(InputError) as error:
        ingested(csv_config(GOOD_ROWS + rows))
    assert "missing value in row 11" in str(error.value)
    assert "range -5.0, closing_speed 2.0) and 2 more" in str(error.value)


@pytest.mark.parametrize(
    ("rows", "step"),
    [
        ("10,50,0\n", "closing"),
        ("10,50,-1\n", "closing"),
        ("4.999,50,2\n", "lead_speed"),
        ("35,50,2\n", "lead_speed"),
        ("10,75.001,2\n", "range"),
    ],
)
def test_filters_drop_and_name_rows(csv_config, rows, step):
    encounters, account = ingested(csv_config(rows + GOOD_ROWS))
    assert len(encounters) == 3
    found = account[account["rows_dropped"] > 0]
    assert found["step"].tolist() == [step]
    assert found["example_rows"].tolist() == ["1"]


def test_rows_on_the_included_limits_are_kept(csv_config):
    encounters, _ = ingested(csv_config("5,75,2\n15,75,2\n25,75,2\n34.999,75,2\n"))
    assert encounters["segment"].tolist() == ["5-15", "15-25", "25-35", "25-35"]


@pytest.mark.parametrize("unit", ["m", "1/m"])
def test_no_row_at_the_range_limit_is_lost_to_rounding(csv_config, unit):
    lost_by_ranges = []
    for limit in (49.0, 75.0, 93.0):  # 1 / (1 / R) is above R, R and below R
        cell = limit if unit == "m" else 1 / limit
        config = csv_config("".join(f"{speed},{cell!r},2\n" for speed in (10, 20, 30)))
        config["data"]["table"]["columns"]["range"]["unit"] = unit
        config["filters"]["range_max"] = limit
        encounters, _ = ingested(config)
        assert len(encounters) == 3
        assert (encounters["inverse_range"] >= 1 / limit).all()
        if (encounters["range"] > limit).any():  # a comparison of ranges would lose these
            lost_by_ranges.append(limit)
    assert lost_by_ranges == ([49.0] if unit == "1/m" else [])


def test_account_adds_up(csv_config):
    rows = GOOD_ROWS + "30,60,4\n" + "x,1,1\n" + "10,50,-1\n" + "50,50,1\n" + "10,80,1\n"
    encounters, account = ingested(csv_config(rows, invalid_rows="drop", repeated_rows="drop"))
    assert account["rows_in"].iloc[0] == 8
    assert (account["rows_in"] - account["rows_dropped"] == account["rows_kept"]).all()
    assert (account["rows_in"].iloc[1:].to_numpy() == account["rows_kept"].iloc[:-1].to_numpy()).all()
    assert account["rows_kept"].iloc[-1] == len(encounters) == 3
    examples = account[account["rows_dropped"] > 0].set_index("step")["example_rows"]
    assert examples.to_dict() == {
        "invalid": "5",
        "repeated": "4",
        "closing": "6",
        "lead_speed": "7",
        "range": "8",
    }


def test_repeated_rows_are_counted_when_kept(csv_config):
    encounters, account = ingested(csv_config("10,50,2\n10,50,2\n20,40,3\n10,50,2\n30,60,4\n"))
    repeated = account.set_index("step").loc["repeated"]
    assert (repeated["rows_found"], repeated["rows_dropped"], len(encounters)) == (1, 0, 5)


def test_a_very_wide_header_is_refused_in_few_words(tmp_path):
    path = tmp_path / "wide.csv"
    path.write_text(",".join(["x" * 1000, *(f"speed_{k}" for k in range(100_000))]) + "\n")
    with pytest.raises(InputError, match=r"'speed_7', 'xxx.* and 99,996 more") as error:
        read_csv(path, {"data.table.columns.range.name": "speed7"})
    assert len(str(error.value)) < 500


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"lead_speed": {"name": "v", "unit": "m/s"}}, r"column 'v': seen only the columns 'lead_speed'"),
        ({"range": {"name": "range", "unit": "furlong"}}, "range.unit: seen 'furlong'; expected one of m"),
        (
            {"closing": {"name": "closing_speed", "quantity": "ttc", "unit": "m/s"}},
            "expected one of s, ms, 1/s",
        ),
    ],
)
def test_table_refuses_a_mapping_that_does_not_fit(csv_config, changes, message):
    settings = csv_config(GOOD_ROWS)["data"]["table"]
    with pytest.raises(InputError, match=message):
        table.read({**settings, "columns": settings["columns"] | changes})


CLOSING = {
    "closing_speed": ("m/s", ["2.0", "-1.0", "5.0", "x"]),
    "range_rate": ("m/s", ["-2.0", "1.0", "-5.0", "x"]),
    "ttc": ("s", ["15.0", "-40.0", "4.0", "x"]),
}


@pytest.mark.parametrize("quantity", CLOSING)
def test_the_lead_speed_is_the_host_speed_minus_the_closing_speed(config, tmp_path, quantity):
    unit, closing = CLOSING[quantity]
    rows = zip(["72", "36", "18", "72"], ["30", "40", "20", "50"], closing, strict=True)
    path = tmp_path / "events.csv"
    path.write_text("own,gap,closing\n" + "".join(",".join(row) + "\n" for row in rows) + "n/a,30,1\n")
    columns = config["data"]["table"]["columns"] | {
        "host_speed": {"name": "own", "unit": "km/h"},
        "range": {"name": "gap", "unit": "m"},
        "closing": {"name": "closing", "unit": unit, "quantity": quantity},
    }
    raw = table.read(config["data"]["table"] | {"path": path, "columns": columns})
    assert "host_speed" not in raw
    encounters = drop_invalid(raw, account := Account(len(raw)), policy="drop", where="")
    np.testing.assert_allclose(encounters["lead_speed"], [18, 11, 0], atol=1e-12)
    assert account.table().set_index("reason").loc["missing value", "rows_found"] == 2


def test_only_one_of_the_two_speeds_is_a_column(tmp_path):
    path = tmp_path / "x.yaml"
    speeds = "{lead_speed: {name: v_lead}, host_speed: {name: own}}"
    path.write_text(f"study: x\ndata: {{source: table, table: {{path: x.csv, columns: {speeds}}}}}\n")
    with pytest.raises(ConfigurationError, match="the lead speed follows from the host speed"):
        load([path])


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("missing.csv", None, "no such file"),
        ("empty.csv", b"", "cannot be read"),
        ("latin.csv", b"lead_speed,range,caf\xe9\n1,2,3\n", "cannot be read"),
        ("ragged.csv", (CSV_HEADER + "1,2,3\n1,2,3,4\n").encode(), "cannot be read"),
        ("shifted.csv", (CSV_HEADER + "1,2,3,4\n1,2,3,4\n").encode(), "more cells in a row than"),
        ("damaged.parquet", b"PAR1", "cannot be read"),
        ("events.xlsx", b"x", "name ending in '.xlsx'"),
    ],
)
def test_table_refuses_files_that_it_cannot_read(config, tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=message) as error:
        table.read(config["data"]["table"] | {"path": tmp_path / name})
    assert name in str(error.value)


# ---------------------------------------------------------------- segments and dependence


def test_segments_hold_their_lower_edge_only():
    encounters = pd.DataFrame({"lead_speed": [5.0, np.nextafter(7.5, 0), 7.5, 12.0]})
    result = assign_segments(encounters, [5, 7.5, 15])
    assert result["segment"].tolist() == ["5-7.5", "5-7.5", "7.5-15", "7.5-15"]
    assert segment_names([5, 7.5, 15]) == ["5-7.5", "7.5-15"]
    counts = segment_counts(result)
    assert counts["rows"].tolist() == [2, 2]
    assert counts["share"].tolist() == [0.5, 0.5]


def test_empty_segments_are_an_error(csv_config):
    with pytest.raises(InputError, match="segment 15-25, 25-35 m/s: seen none of the 1 rows"):
        ingested(csv_config("10,50,2\n"))


def test_interval_covers_the_true_tau_of_dependent_variables():
    rho, repetitions = 0.7, 100
    tau = 2 / np.pi * np.arcsin(rho)  # Kendall's tau of the bivariate normal distribution
    generator = np.random.default_rng(2016)
    covered = 0
    for _ in range(repetitions):
        rows = normal_pairs(generator, 300, rho)
        estimate, half_width = tau_interval(rows["inverse_range"], rows["inverse_ttc"])
        covered += abs(estimate - tau) <= half_width
    low, high = binom.interval(0.998, repetitions, CONFIDENCE)
    assert low <= covered <= high


def test_repeated_rows_do_not_narrow_the_interval():
    """Each row five times: tau-b is the same, and so is its interval, for each block repeats its own rows."""
    rows = normal_pairs(np.random.default_rng(7), 600, 0.5)
    repeated = rows.loc[rows.index.repeat(5)]
    once, five = dependence(rows), dependence(repeated)
    np.testing.assert_allclose(
        five[["tau", "ci_low", "ci_high"]], once[["tau", "ci_low", "ci_high"]], rtol=1e-12
    )
    scattered = dependence(repeated.sample(frac=1, random_state=1))  # the order of the record is needed
    assert ((scattered["ci_high"] - scattered["ci_low"]) < 0.7 * (once["ci_high"] - once["ci_low"])).all()


def test_dependence_has_a_line_for_each_pair_and_segment():
    rows = pd.concat(
        [normal_pairs(np.random.default_rng(8), 100, 0), normal_pairs(np.random.default_rng(9), 50, 0)]
    )
    rows["segment"] = ["5-15"] * 100 + ["15-25"] * 50
    rows.loc[rows["segment"] == "15-25", "lead_speed"] += 10
    result = dependence(rows)
    assert list(result.columns) == ["segment", "pair", "tau", "ci_low", "ci_high", "n"]
    assert result["segment"].tolist() == ["5-15"] * 3 + ["15-25"] * 3
    assert result["n"].tolist() == [100] * 3 + [50] * 3
    first = rows[rows["segment"] == "5-15"]
    assert result["tau"][1] == kendalltau(first["lead_speed"], first["inverse_ttc"]).statistic
    assert result["ci_low"].notna().tolist() == [True] * 3 + [False] * 3  # 50 rows: fewer than two a block


def test_segments_are_similar_if_their_quantiles_are():
    """Exponential TTC^-1 with a mean that doubles from one segment to the next, and with the same mean."""
    generator, rows = np.random.default_rng(4), []
    for segment, mean in (("5-15", 1.0), ("15-25", 2.0), ("25-35", 4.0)):
        rows.append(pd.DataFrame({"segment": segment, "inverse_ttc": generator.exponential(mean, 6000)}))
    unlike = pd.concat(rows, ignore_index=True)
    found = similarity(unlike)
    assert found["quantile"].tolist() == [0.5, 0.9, 0.95, 0.99]
    assert found["largest_in"].tolist() == ["25-35"] * 4
    assert found["smallest_in"].tolist() == ["5-15"] * 4
    np.testing.assert_allclose(found["largest"] / found["smallest"], found["ratio"])
    assert ((found["ci_low"] < 4) & (found["ci_high"] > 4)).all()
    # The variance of the log of a quantile of n exponential values is p / ((1 - p) n log(1 - p)^2).
    p = found["quantile"]
    error = np.sqrt(2 * p / (1 - p) / 6000) / -np.log(1 - p)
    assert (np.log(found["ci_high"] / found["ratio"]) / (2.541 * error)).between(0.6, 1.6).all()
    means = unlike["segment"].map({"5-15": 1.0, "15-25": 2.0, "25-35": 4.0})
    alike = similarity(unlike.assign(inverse_ttc=unlike["inverse_ttc"] / means))
    assert (alike["ci_low"] < 1).sum() >= 3  # one interval in twenty misses the ratio of one


# ---------------------------------------------------------------- sources and samples


def test_a_sample_keeps_rows_and_order_and_says_that_it_is_one(csv_config):
    config = csv_config("".join(f"{5 + row / 100},50,2\n" for row in range(1000)), sample=200)
    first, again, other = (read_source(config["data"], np.random.default_rng(seed)) for seed in (1, 1, 2))
    pd.testing.assert_frame_equal(first, again)
    assert not first.index.equals(other.index)
    assert len(first) == first.index.nunique() == 200
    assert first.index.is_monotonic_increasing
    np.testing.assert_allclose(first["lead_speed"].astype(float), 5 + (first.index - 1) / 100, rtol=1e-15)
    assert describe(config["data"]) == "lane changes of a user's table, a sample of 200"
    # Each half of the table has its share, within five standard deviations of a hypergeometric count.
    assert abs((first.index <= 500).sum() - 100) < 5 * np.sqrt(200 * 0.25 * 800 / 999)


def test_a_sample_of_all_records_is_all_of_them_and_a_larger_one_is_refused(csv_config):
    config = csv_config(GOOD_ROWS, sample=3)
    pd.testing.assert_frame_equal(
        read_source(config["data"], np.random.default_rng()), SOURCES["table"].read(config["data"]["table"])
    )
    config["data"]["sample"] = 4
    with pytest.raises(InputError, match=r"data\.sample: seen 4, but only 3 records in .*events\.csv"):
        read_source(config["data"], np.random.default_rng())


# ---------------------------------------------------------------- nothing left


@pytest.mark.parametrize(
    ("rows", "reported"),
    [
        ("10,50,-2\n10,80,2\n", "1 by closing: range rate not negative; 1 by range: R above 75 m"),
        ("1,50,2\n1,50,3\n1,50,4\n", r"3 by lead_speed: v_L outside \[5, 35\) m/s"),
        ("", "none were dropped"),
    ],
)
def test_when_no_row_is_left_the_file_and_the_counts_are_told_and_the_account_is_kept(
    csv_config, rows, reported
):
    config = csv_config(rows)
    raw = read_source(config["data"], np.random.default_rng())
    account = Account(len(raw))
    with pytest.raises(
        InputError, match=rf"events\.csv: seen {len(raw)} rows, none of which passed the filters \({reported}"
    ):
        ingest(raw, *sections(config), account)
    assert account.table()["rows_dropped"].sum() == len(raw)
    kept = []
    with pytest.raises(InputError, match="none of which passed the filters"):
        CutInRecords.of(config).encounters(raw, kept.append)
    pd.testing.assert_frame_equal(kept[0], account.table())  # also without a table of encounters


@pytest.mark.parametrize("speed", [4.999, 15.0, 20.0, np.nan])
def test_rows_outside_the_edges_are_refused_and_go_to_no_other_segment(speed):
    encounters = pd.DataFrame({"lead_speed": [7.0, speed, 12.0]})
    with pytest.raises(InputError, match=r"5 10 15 m/s: seen 1 of 3 rows outside, the first with"):
        assign_segments(encounters, [5, 10, 15])


def test_outlier_rows_beyond_the_table_are_refused(csv_config):
    config = csv_config(GOOD_ROWS)
    config["data"]["table"]["outlier_rows"] = [2, 3]
    assert len(ingested(config)[0]) == 3
    config["data"]["table"]["outlier_rows"] = [2, 4]
    with pytest.raises(InputError, match=r"data\.table\.outlier_rows: seen row 4; expected .* has 3"):
        ingested(config)


def test_a_column_given_twice_is_refused(csv_config):
    config = csv_config("10,50,60,2\n", header="lead_speed,range,range,closing_speed\n")
    with pytest.raises(InputError, match="column 'range' twice"):
        ingested(config)


@pytest.mark.parametrize("row", ["1e307,50,2\n", "10,50,1e307\n", "999,50,2\n"])
def test_impossible_speeds_are_refused_or_dropped_and_named(csv_config, row):
    with pytest.raises(InputError, match="speed above 300 m/s in row 4"):
        ingested(csv_config(GOOD_ROWS + row))
    encounters, account = ingested(csv_config(GOOD_ROWS + row, invalid_rows="drop"))
    assert len(encounters) == 3
    assert account.set_index("reason").loc["speed above 300 m/s", "example_rows"] == "4"
    assert "speed above 300 m/s" not in ingested(csv_config(GOOD_ROWS))[1]["reason"].tolist()


def test_opening_cut_ins_are_kept_within_the_limits_of_the_closing_ones(csv_config):
    rows = "10,40,-3\n20,50,0\n30,60,-31\n4,40,-1\n36,40,-1\n20,76,-1\n10,40,-3\n"
    config = csv_config(GOOD_ROWS + rows + "10,40,-3\n")
    raw = read_source(config["data"], np.random.default_rng(1))
    opening = opening_cut_ins(raw, config["data"], config["filters"])
    assert list(opening.columns) == list(NUMBERS)
    assert (
        opening[["lead_speed", "range", "closing_speed"]].to_numpy().tolist()
        == [[10, 40, -3], [20, 50, 0], [10, 40, -3], [10, 40, -3]][: len(opening)]
    )
    assert len(opening) == (3 if config["data"]["repeated_rows"] == "drop" else 4)
    closing = ingest(raw, *sections(config), Account.of(raw))
    assert (closing["closing_speed"] > 0).all()
    raw = read_source(csv_config(GOOD_ROWS)["data"], np.random.default_rng(1))
    assert opening_cut_ins(raw, config["data"], config["filters"]).empty
