"""Checks of records: what they find in the real ones, and deliberately spoiled copies that each is caught."""

from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import SOURCES, InputError, load_vehicle
from accelerated_evaluation.base.tables import CLUSTER
from accelerated_evaluation.records.checks import (
    CHECKS,
    FINE,
    STOP,
    VERDICTS,
    WARNING,
    Records,
    inspect_records,
)
from accelerated_evaluation.records.segments import complete
from accelerated_evaluation.study.configuration import load

ROOT = Path(__file__).resolve().parents[3]
PART = slice(30_000, 60_000)  # a part of the record, in its order


@cache
def real():
    config = load()
    return SOURCES["spmd"].read(config["data"]["spmd"] | {"path": ROOT / config["data"]["spmd"]["path"]})


@cache
def sound():
    return complete(real()).iloc[PART][["lead_speed", "range", "closing_speed"]]


def records_of(raw):
    config = load()
    return Records.of(
        raw, config["filters"], config["segments"]["lead_speed_edges"], load_vehicle("acc_aeb").simulate
    )


@cache
def control(check):
    return CHECKS[check](records_of(sound()))


@pytest.fixture(scope="module")
def report():
    return inspect_records(records_of(real())).set_index("check")


def test_the_checks_find_by_themselves_what_is_known_of_the_real_records(report):
    assert report.loc["repeated rows", "rows"] == 11_703
    assert report.loc["cut edges", "seen"].startswith("27 rows at the largest range, 75")
    assert report.loc["short ranges", "rows"] == 7
    assert set(report.loc["outliers", "example_rows"].split("; ")) == {"26382", "114923", "117159"}
    assert report.loc["replayed crashes", "number"] == 1
    assert report.loc["replayed crashes", "example_rows"].split("; ")[0] == "136426"
    assert report.loc["drift", "verdict"] == WARNING
    assert STOP not in set(report["verdict"])
    assert (report["advice"] == "").equals(report["verdict"] == FINE)


def of_column(name, change):
    """Return what changes one column of the records."""
    return lambda rows: rows.assign(**{name: change(rows[name])})


def rounded_to_5_m(rows):
    chosen = np.arange(len(rows)) % 20 == 0
    return rows.assign(range=rows["range"].where(~chosen, (rows["range"] / 5).round().clip(lower=1) * 5))


def every_row_thrice(rows):
    return numbered(rows.iloc[np.repeat(np.arange(len(rows)), 3)])


def with_noisy_copies(rows):
    """Put behind each of 300 rows another target of the same cut-in."""
    noise = np.random.default_rng(1).uniform(-0.04, 0.04, (300, 3))
    copies = rows.iloc[:30_000:100] + noise
    return numbered(pd.concat([rows, copies]).sort_index(kind="stable"))


def with_a_block_twice(rows):
    return numbered(pd.concat([rows, rows.iloc[5_000:7_000]]))


def with_a_stuck_range(rows):
    return rows.assign(
        range=rows["range"].where(~np.isin(np.arange(len(rows)), np.arange(9_000, 9_500)), 40.0)
    )


def swapped(one, other):
    return lambda rows: rows.rename(columns={one: other, other: one})[list(rows)]


def some(column, value, every):
    return lambda rows: rows.assign(**{column: rows[column].where(np.arange(len(rows)) % every != 0, value)})


def turned_in_a_mixture(rows):
    """Add cars that open the gap, near ones most as they do, and turn the sign of all."""
    opening = rows.assign(closing_speed=-3 * (80 - rows["range"]) / 80)
    both = numbered(pd.concat([rows, opening]))
    return both.assign(closing_speed=-both["closing_speed"])


MEASURES = {
    "closing speed": lambda rows: rows["closing_speed"],
    "1/TTC": lambda rows: rows["closing_speed"] / rows["range"],
    "deceleration": lambda rows: rows["closing_speed"] ** 2 / rows["range"],
}


def without_the_most_critical(name, share):
    def spoil(rows):
        values = MEASURES[name](rows)
        return rows[values < values.quantile(1 - share)]

    return spoil


def most_critical(name):
    return lambda rows: rows[MEASURES[name](rows) > MEASURES[name](rows).quantile(0.8)]


def numbered(rows):
    return rows.set_index(pd.RangeIndex(1, len(rows) + 1, name="row"))


SPOILED = {
    "lead speed in km/h": ("speed_unit", of_column("lead_speed", lambda v: 3.6 * v)),
    "lead speed in mph": ("speed_unit", of_column("lead_speed", lambda v: v / 0.44704)),
    "closing speed in km/h": ("unavoidable_crashes", of_column("closing_speed", lambda v: 3.6 * v)),
    "speeds of m/s taken for km/h": ("time_gap", lambda rows: rows / [3.6, 1, 3.6]),
    "host speed": ("known_records", lambda x: x.assign(lead_speed=x["lead_speed"] + x["closing_speed"])),
    "range in feet": ("time_gap", of_column("range", lambda v: v / 0.3048)),
    "sign of the range rate": ("sign_of_range_rate", of_column("closing_speed", lambda v: -v)),
    "sign in a mixture": ("sign_of_range_rate", turned_in_a_mixture),
    "lead speed and range swapped": ("speed_unit", swapped("lead_speed", "range")),
    "range and closing speed swapped": ("unavoidable_crashes", swapped("range", "closing_speed")),
    "a row for each time step": ("repeated_rows", every_row_thrice),
    "a block twice": ("rows_repeated_elsewhere", with_a_block_twice),
    "two targets of a cut-in": ("nearly_repeated_rows", with_noisy_copies),
    "stuck sensor": ("stuck_sensor", with_a_stuck_range),
    "a gap": ("gaps", lambda rows: rows[~rows["lead_speed"].between(18, 20)]),
    "one range in twenty rounded to 5 m": ("round_numbers", rounded_to_5_m),
    "saturated closing speed": ("cut_edges", of_column("closing_speed", lambda v: v.clip(upper=8))),
    "false targets": ("outliers", some("range", 0.4, 6_000)),
    "rows sorted by range": ("order_of_rows", lambda rows: numbered(rows.sort_values("range"))),
    "drift of the range": ("drift", lambda rows: rows * np.linspace([1, 1, 1], [1, 0.6, 1], len(rows))),
    "marks for missing values": ("invalid_values", some("range", -1.0, 500)),
    "marks for far targets": ("far_ranges", some("range", 999.0, 50)),
    "range from the wrong place": ("short_ranges", of_column("range", lambda v: (v - 8).clip(lower=0.1))),
    "limits that do not fit": ("rows_outside_limits", of_column("lead_speed", lambda v: v + 22)),
    "a few rows": ("sample_size", lambda rows: rows.iloc[:80]),
    "a tail of a few rows": ("size_of_tail", lambda rows: rows.iloc[:400]),
    "a code for missing speeds": ("equal_values", some("lead_speed", 12.34, 10)),
    **{
        f"the most critical {share} left out by {name}": ("selection", without_the_most_critical(name, share))
        for name in MEASURES
        for share in (0.01, 0.05)
    },
    **{f"the most critical fifth by {name}": ("selection", most_critical(name)) for name in MEASURES},
    "records that nobody survives": ("replayed_crashes", some("closing_speed", 40.0, 50)),
}  # fmt: skip


@pytest.mark.parametrize("spoiling", SPOILED)
def test_a_spoiled_copy_is_caught_and_the_sound_one_is_not(spoiling):
    check, spoil = SPOILED[spoiling]
    found, before = CHECKS[check](records_of(spoil(sound()))), control(check)
    assert VERDICTS.index(found.verdict) > VERDICTS.index(before.verdict), (found, before)
    assert found.advice


def test_a_selection_of_the_tail_is_a_stop_and_one_of_the_rest_a_warning():
    verdicts = {
        name: CHECKS["selection"](records_of(spoil(sound()))).verdict
        for name, (check, spoil) in SPOILED.items()
        if check == "selection"
    }
    assert verdicts == {name: STOP if "left out" in name else WARNING for name in verdicts}


@pytest.mark.parametrize("cap", [12.0, 14.0])
def test_a_cap_of_the_sensor_is_a_stop_however_few_rows_have_it(cap):
    rows = complete(real())[["lead_speed", "range", "closing_speed"]]
    assert 0 < (rows["closing_speed"] > cap).mean() < 0.01
    capped = rows.assign(closing_speed=rows["closing_speed"].clip(upper=cap))
    assert CHECKS["cut_edges"](records_of(capped)).verdict == STOP


@pytest.mark.parametrize("power", [0.8, 1.0, 1.3, 1.6])
@pytest.mark.parametrize("rows", [500, 20_000])
def test_tails_that_thin_out_are_no_selection(power, rows):
    """Weibull tails, from heavier to lighter than those of recorded closing speeds."""
    generator = np.random.default_rng(7)
    table = pd.DataFrame(
        {"lead_speed": generator.uniform(5, 35, rows), "range": generator.uniform(9, 75, rows)}
    )
    table["closing_speed"] = 2 * generator.exponential(size=rows) ** (1 / power)
    found = CHECKS["selection"](records_of(numbered(table)))
    assert found.verdict == FINE, found
    assert CHECKS["selection"](records_of(table[table["closing_speed"] < 4.5])).verdict == (
        STOP if rows > 500 else FINE
    )


def test_every_check_is_tried():
    of_others = {name for name, check in CHECKS.items() if CLUSTER in getattr(check, "needs", ())}
    assert {check for check, _ in SPOILED.values()} == set(CHECKS) - of_others  # see test_spoiled_scenarios


def test_pure_chance_is_fine():
    """Cut-ins drawn independently, without resolution, repeats or drift, pass every test of chance."""
    generator = np.random.default_rng(3)
    size = 20_000
    drawn = pd.DataFrame(
        {
            "lead_speed": generator.uniform(5, 35, size),
            "range": 75 * generator.beta(3, 1, size),
            "closing_speed": generator.exponential(2, size),
        }
    )
    drawn["range"] = drawn["range"].clip(lower=4) + 0.01 * generator.uniform(size=size)
    found = inspect_records(records_of(numbered(drawn))).set_index("check")["verdict"]
    chance = ["gaps", "round numbers", "cut edges", "drift", "repeated rows", "rows repeated elsewhere"]
    assert set(found[[*chance, "nearly repeated rows", "stuck sensor"]]) == {FINE}


def test_too_few_rows_are_refused():
    with pytest.raises(InputError, match="at least 30 valid rows"):
        inspect_records(records_of(sound().iloc[:20]))


def test_a_table_whose_rows_are_all_invalid_or_open_is_told_and_not_a_crash():
    opening = sound().assign(closing_speed=-1.0)
    table = inspect_records(records_of(opening)).set_index("check")
    assert table.loc["sign of range rate", "verdict"] == STOP
    assert table.index[0] in set(table.index[table["verdict"] == STOP])
