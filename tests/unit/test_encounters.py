import copy
import hashlib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.configuration import load
from accelerated_evaluation.encounters import spmd, table, twin
from accelerated_evaluation.encounters.contract import (
    COLUMNS,
    NUMBERS,
    complete,
    read_encounters,
    write_encounters,
)
from accelerated_evaluation.encounters.ingest import ingest, read_source
from accelerated_evaluation.encounters.segments import (
    assign_segments,
    dependence,
    segment_counts,
    segment_names,
    tau_interval,
)
from accelerated_evaluation.errors import InputError
from scipy.io import savemat
from scipy.stats import binom, kendalltau

REPOSITORY = Path(__file__).resolve().parents[2]
PUBLISHED = REPOSITORY / ".." / "shared" / "data" / "spmd" / "lane_changes.mat"
needs_published = pytest.mark.skipif(not PUBLISHED.exists(), reason="no copy of the published SPMD file")

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


def ingested(config):
    return ingest(read_source(config["data"]), config)


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
        write_encounters(path, encounters, "simulated twin of SPMD")
    assert paths[0].read_bytes() == paths[1].read_bytes()
    again = read_encounters(paths[0])
    pd.testing.assert_frame_equal(again, encounters)
    assert again.attrs["description"] == "simulated twin of SPMD"
    assert list(again.columns) == list(COLUMNS)


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


# ---------------------------------------------------------------- the published file


@pytest.fixture
def mat_file(tmp_path):
    """A small file of the published form; its path and checksum."""
    path = tmp_path / "source" / "lane_changes.mat"
    path.parent.mkdir()
    values = np.random.default_rng(1).uniform(0.1, 0.2, (500, 3))
    savemat(path, {"mixture_data": values}, do_compression=True)
    return path, hashlib.sha256(path.read_bytes()).hexdigest(), values


def test_spmd_keeps_the_values_of_the_file(mat_file):
    path, sha256, values = mat_file
    raw = spmd.read(path, sha256)
    assert (raw[["lead_speed", "inverse_range", "inverse_ttc"]].to_numpy() == values).all()
    assert raw.index[0] == 1


def test_retrieve_downloads_the_file(mat_file, tmp_path):
    path, sha256, _ = mat_file
    target = tmp_path / "raw" / "lane_changes.mat"
    spmd.retrieve(path.as_uri(), sha256, target)
    assert target.read_bytes() == path.read_bytes()


@pytest.mark.parametrize("fault", ["checksum", "address"])
def test_failed_retrieve_leaves_what_was_there(mat_file, tmp_path, fault):
    path, sha256, _ = mat_file
    target = tmp_path / "raw" / "lane_changes.mat"
    target.parent.mkdir()
    target.write_text("older copy")
    url = path.as_uri() if fault == "checksum" else (tmp_path / "nowhere.mat").as_uri()
    with pytest.raises(InputError, match="sha256 0{64}" if fault == "checksum" else "nowhere"):
        spmd.retrieve(url, "0" * 64 if fault == "checksum" else sha256, target)
    assert target.read_text() == "older copy"
    assert [file.name for file in target.parent.iterdir()] == [target.name]


def test_spmd_refuses_a_missing_file(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        spmd.read(tmp_path / "lane_changes.mat", "0" * 64)


def test_spmd_refuses_a_wrong_checksum(mat_file):
    with pytest.raises(InputError, match=r"expected sha256 0{64}"):
        spmd.read(mat_file[0], "0" * 64)


@pytest.mark.parametrize("kept", [0.0, 0.0005, 0.01, 0.02, 0.5, 0.999])
def test_spmd_refuses_a_truncated_file(mat_file, kept):
    path, _, _ = mat_file
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content))])
    with pytest.raises(InputError, match="mixture_data"):
        spmd.read(path, hashlib.sha256(path.read_bytes()).hexdigest())


@pytest.mark.parametrize("content", [{"other": np.ones((2, 3))}, {"mixture_data": np.ones((2, 4))}])
def test_spmd_refuses_another_matlab_file(tmp_path, content):
    path = tmp_path / "other.mat"
    savemat(path, content)
    with pytest.raises(InputError, match="three columns of doubles"):
        spmd.read(path, hashlib.sha256(path.read_bytes()).hexdigest())


@pytest.fixture(scope="module")
def published():
    config = copy.deepcopy(load())
    config["data"]["source"] = "spmd"
    config["data"]["spmd"]["path"] = str(PUBLISHED)
    raw = read_source(config["data"])
    return config, raw, *ingest(raw, config)


@needs_published
def test_published_events_all_pass_the_filters_of_the_paper(published):
    _, raw, encounters, account = published
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


@needs_published
def test_published_repeated_rows_are_dropped_on_request(published):
    config, raw, _, _ = published
    config = copy.deepcopy(config)
    config["data"]["repeated_rows"] = "drop"
    encounters, _ = ingest(raw, config)
    assert len(encounters) == 157_757 - 11_703
    assert not encounters.duplicated().any()


@needs_published
def test_published_time_to_collision_depends_on_lead_speed_inside_segments(published):
    result = dependence(published[2]).set_index(["pair", "segment"]).sort_index()
    tau = result["tau"]
    expected = {"5-15": -0.24, "15-25": -0.07, "25-35": -0.15}
    for segment, value in expected.items():
        assert tau["lead_speed vs inverse_ttc", segment] == pytest.approx(value, abs=0.01)
        assert result.loc[("lead_speed vs inverse_ttc", segment), "ci_high"] < 0
    assert tau.drop("lead_speed vs inverse_ttc").abs().max() <= 0.07
    assert tau["inverse_range vs inverse_ttc", "5-15"] == pytest.approx(-0.0406, abs=5e-5)


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
    assert (read_source(config["data"]).to_numpy(float) == values).all()


@pytest.mark.parametrize(
    ("unit", "cell"),
    [("m/s", "10"), ("km/h", "36"), ("mph", repr(10 / 0.44704)), ("ft/s", repr(10 / 0.3048))],
)
def test_units_of_speed(csv_config, unit, cell):
    config = csv_config(f"{cell},50,{cell}\n20,40,3\n")
    columns = config["data"]["table"]["columns"]
    columns["lead_speed"]["unit"] = columns["closing"]["unit"] = unit
    first = complete(read_source(config["data"]).astype(float)).iloc[0]
    np.testing.assert_allclose(first, [10, 50, 10, 1 / 50, 10 / 50], rtol=1e-15)


@pytest.mark.parametrize(
    ("unit", "cell"),
    [("m", "50"), ("km", "0.05"), ("ft", repr(50 / 0.3048)), ("1/m", "0.02"), ("1/ft", repr(0.02 * 0.3048))],
)
def test_units_of_range(csv_config, unit, cell):
    config = csv_config(f"10,{cell},2\n")
    config["data"]["table"]["columns"]["range"]["unit"] = unit
    first = complete(read_source(config["data"]).astype(float)).iloc[0]
    np.testing.assert_allclose(first, [10, 50, 2, 1 / 50, 2 / 50], rtol=1e-15)


@pytest.mark.parametrize(
    ("quantity", "unit", "cell"),
    [
        ("closing_speed", "km/h", "7.2"),
        ("range_rate", "m/s", "-2"),
        ("ttc", "s", "25"),
        ("ttc", "ms", "25000"),
        ("ttc", "1/s", "0.04"),
    ],
)
def test_ways_to_state_how_the_gap_closes(csv_config, quantity, unit, cell):
    config = csv_config(f"10,50,{cell}\n")
    config["data"]["table"]["columns"]["closing"].update(quantity=quantity, unit=unit)
    first = complete(read_source(config["data"]).astype(float)).iloc[0]
    np.testing.assert_allclose(first, [10, 50, 2, 1 / 50, 2 / 50], rtol=1e-15)


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


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"lead_speed": {"name": "v", "unit": "m/s"}},
            r"column 'v': seen only the columns lead_speed",
        ),
        (
            {"range": {"name": "range", "unit": "furlong"}},
            "range.unit: seen 'furlong'; expected one of m",
        ),
        (
            {"closing": {"name": "closing_speed", "quantity": "ttc", "unit": "m/s"}},
            "expected one of s, ms, 1/s",
        ),
    ],
)
def test_table_refuses_a_mapping_that_does_not_fit(csv_config, changes, message):
    config = csv_config(GOOD_ROWS)
    with pytest.raises(InputError, match=message):
        table.read(config["data"]["table"]["path"], config["data"]["table"]["columns"] | changes)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("missing.csv", None, "no such file"),
        ("empty.csv", b"", "cannot be read"),
        ("latin.csv", b"lead_speed,range,caf\xe9\n1,2,3\n", "cannot be read"),
        ("ragged.csv", (CSV_HEADER + "1,2,3\n1,2,3,4\n").encode(), "cannot be read"),
        (
            "shifted.csv",
            (CSV_HEADER + "1,2,3,4\n1,2,3,4\n").encode(),
            "more cells in a row than",
        ),
        ("damaged.parquet", b"PAR1", "cannot be read"),
        ("events.xlsx", b"x", "name ending in '.xlsx'"),
    ],
)
def test_table_refuses_files_that_it_cannot_read(config, tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=message) as error:
        table.read(tmp_path / name, config["data"]["table"]["columns"])
    assert name in str(error.value)


def test_dates_in_a_parquet_file_are_no_numbers(config, tmp_path):
    path = tmp_path / "events.parquet"
    dates = pd.to_datetime(["2024-01-01", "2024-01-02"])
    pd.DataFrame({"lead_speed": dates, "range": [50.0, None], "closing_speed": [2, 3]}).to_parquet(path)
    config["data"]["table"]["path"] = str(path)
    with pytest.raises(InputError, match=r"missing value in row 2 .*text in place of a number in row 1"):
        ingested(config)


# ---------------------------------------------------------------- segments and dependence


def test_segments_hold_their_lower_edge_only():
    encounters = pd.DataFrame({"lead_speed": [5.0, np.nextafter(7.5, 0), 7.5, 12.0]})
    result = assign_segments(encounters, [5, 7.5, 15])
    assert result["segment"].tolist() == ["5-7.5", "5-7.5", "7.5-15", "7.5-15"]
    assert segment_names([5, 7.5, 15]) == ["5-7.5", "7.5-15"]
    counts = segment_counts(result)
    assert counts["rows"].tolist() == [2, 2]
    assert counts["share"].tolist() == [0.5, 0.5]


def test_segment_counts_are_in_order_of_speed_not_of_name():
    encounters = assign_segments(pd.DataFrame({"lead_speed": [12.0, 6.0, 6.0]}), [5, 10, 15])
    assert segment_counts(encounters)["segment"].tolist() == ["5-10", "10-15"]


def test_empty_segments_are_an_error(csv_config):
    with pytest.raises(InputError, match="segment 15-25, 25-35 m/s: seen none of the 1 rows"):
        ingested(csv_config("10,50,2\n"))


def test_interval_covers_the_true_tau_of_dependent_variables():
    rho, level, repetitions = 0.7, 0.9, 100
    tau = 2 / np.pi * np.arcsin(rho)  # Kendall's tau of the bivariate normal distribution
    generator = np.random.default_rng(2016)
    covered = 0
    for _ in range(repetitions):
        rows = normal_pairs(generator, 300, rho)
        estimate, half_width = tau_interval(rows["inverse_range"], rows["inverse_ttc"], level)
        covered += abs(estimate - tau) <= half_width
    assert binom.ppf(0.001, repetitions, level) <= covered <= binom.ppf(0.999, repetitions, level)


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


# ---------------------------------------------------------------- the twin


class Exponential:
    """Beginning at ``start``, with the given mean above it."""

    def __init__(self, mean, start=0.0):
        self.mean, self.start = mean, start

    def rvs(self, generator, size):
        return self.start + generator.exponential(self.mean, size)


@pytest.fixture
def model():
    segments = {"5-15": 5000, "15-25": 2500, "25-35": 3000}
    quantiles = pd.concat(
        pd.DataFrame({"segment": segment, "probability": [0.0, 0.5, 1.0], "lead_speed [m/s]": speeds})
        for segment, speeds in zip(segments, ([5, 6, 14.9], [15, 20, 24.9], [25, 34, 34.9]), strict=True)
    )
    inverse_ttc = dict(zip(segments, map(Exponential, (0.06, 0.03, 0.02)), strict=True))
    return twin.Twin(Exponential(0.02, 1 / 75), inverse_ttc, segments, quantiles)


def test_twin_follows_its_model(model, config):
    config["data"]["source"] = "twin"
    raw = read_source(config["data"], model=model, generator=np.random.default_rng(4))
    encounters, account = ingest(raw, config)
    assert (account["rows_dropped"] == 0).all()
    assert segment_counts(encounters)["rows"].tolist() == [5000, 2500, 3000]
    for segment, part in encounters.groupby("segment"):
        error = 1 / np.sqrt(len(part))  # standard deviation of an exponential mean, relative
        mean = model.inverse_ttc[segment].mean
        assert abs(part["inverse_ttc"].mean() / mean - 1) < 5 * error
        assert abs((part["inverse_range"] - 1 / 75).mean() / 0.02 - 1) < 5 * error
        median = model.lead_speed.set_index(["segment", "probability"])["lead_speed [m/s]"][segment, 0.5]
        assert abs((part["lead_speed"] < median).mean() - 0.5) < 5 * 0.5 * error


def test_twin_is_the_same_for_the_same_seed_only(model):
    first, second, other = (twin.generate(model, np.random.default_rng(seed)) for seed in (1, 1, 2))
    pd.testing.assert_frame_equal(first, second)
    assert not first.equals(other)


@pytest.mark.parametrize(
    ("counts", "events", "expected"),
    [
        ({"a": 75_783, "b": 37_580, "c": 44_394}, 157_757, [75_783, 37_580, 44_394]),
        ({"a": 1, "b": 1, "c": 1}, 100, [34, 33, 33]),
        ({"a": 75_783, "b": 37_580, "c": 44_394}, 1000, [480, 238, 282]),  # shares 480.4, 238.2, 281.4
    ],
)
def test_events_are_shared_out_by_largest_remainders(counts, events, expected):
    assert list(twin.share_out(counts, events).values()) == expected


def test_twin_draws_the_number_of_events_asked_for(model):
    assert len(twin.generate(model, np.random.default_rng(0), events=777)) == 777


def test_twin_refuses_parts_of_different_segments(model):
    parts = {**vars(model), "lead_speed": model.lead_speed[model.lead_speed["segment"] != "15-25"]}
    with pytest.raises(InputError, match="seen segments 5-15, 25-35; expected segments 5-15, 15-25"):
        twin.generate(twin.Twin(**parts), np.random.default_rng(0))


def test_lead_speed_quantiles_stay_in_their_segment_and_read_back_equal(csv_config, tmp_path):
    generator = np.random.default_rng(6)
    rows = "".join(f"{speed!r},50,2\n" for speed in generator.uniform(5, 35, 3000).tolist())
    encounters, _ = ingested(csv_config(rows))
    quantiles = twin.lead_speed_quantiles(encounters, np.linspace(0, 1, 21))
    for segment, part in quantiles.groupby("segment"):
        low, high = map(float, segment.split("-"))
        assert low <= part["lead_speed [m/s]"].min() <= part["lead_speed [m/s]"].max() < high
    path = tmp_path / "quantiles.csv"
    quantiles.to_csv(path, index=False)
    pd.testing.assert_frame_equal(twin.read_lead_speed(path), quantiles)


@pytest.mark.parametrize(
    "content",
    [
        None,
        "segment,probability\n5-15,0\n",
        "segment,probability,lead_speed [m/s]\n5-15,0,6\n5-15,0.9,7\n",
        "segment,probability,lead_speed [m/s]\n5-15,0,7\n5-15,1,6\n",
        "segment,probability,lead_speed [m/s]\n5-15,0,six\n5-15,1,7\n",
    ],
)
def test_read_lead_speed_refuses_what_is_no_quantile_table(tmp_path, content):
    path = tmp_path / "quantiles.csv"
    if content:
        path.write_text(content)
    with pytest.raises(InputError, match=r"quantiles\.csv"):
        twin.read_lead_speed(path)
