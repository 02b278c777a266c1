"""The comparison with known records: which faults it finds, and which sound tables it leaves in peace."""

import re
import warnings
from functools import cache

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.base.arrays import LENGTH, SPEED
from accelerated_evaluation.records.checks import CHECKS, FINE, STOP, WARNING, Records, shapes
from accelerated_evaluation.records.checks.known import SIMILAR, Comparison, known_cut_ins

NAMES = ["lead_speed", "range", "closing_speed"]
FEET = 1 / 0.3048


def records_of(rows):
    filters = {"lead_speed_min": 0, "lead_speed_max": 70, "range_max": 300}
    return Records.of(rows.set_axis(range(1, len(rows) + 1)), filters, [0, 70])


def found(rows, check="known_records"):
    return CHECKS[check](records_of(rows))


@cache
def recorded(rows=2_000):
    return known_cut_ins()["Safety Pilot"][NAMES].sample(rows, random_state=1)


def drawn(kind, rows, seed=1):
    """Return made-up cut-ins of a kind of traffic that the known records do not contain."""
    generator, n = np.random.default_rng(seed), 6 * rows

    def around(median, spread):
        return median * np.exp(spread * generator.standard_normal(n))

    speed, gap, offset, closing, farthest = {
        "dense motorway": (
            generator.normal(29, 4, n),
            around(0.97, 0.5),
            0,
            generator.exponential(1.3, n),
            75,
        ),
        "rapid motorway": (generator.normal(38, 6, n), around(1.2, 0.5), 0, generator.exponential(3, n), 150),
        "lorries": (generator.normal(22.5, 2, n), around(1.6, 0.45), 0, generator.exponential(0.8, n), 120),
        "a town": (generator.uniform(2, 17, n), around(1.8, 0.5), 3, generator.exponential(1.6, n), 75),
        "a jam": (generator.gamma(3, 1.5, n), around(2, 0.5), 2, generator.exponential(0.7, n), 60),
    }[kind]
    table = pd.DataFrame(dict(zip(NAMES, (speed, gap * (speed + offset), closing), strict=True)))
    usual = table["range"].between(3, farthest) & (table["lead_speed"] > 0.2)
    return table[usual & (table["closing_speed"] ** 2 < 6 * table["range"])].head(rows)


TRAFFIC = ["dense motorway", "rapid motorway", "lorries", "a town", "a jam"]
SIZES = [120, 2_000]


@pytest.mark.parametrize("kind", TRAFFIC)
def test_sound_cut_ins_of_other_traffic_are_not_stopped(kind):
    verdicts = [found(drawn(kind, rows, seed)).verdict for rows in SIZES for seed in range(5)]
    assert STOP not in verdicts
    if kind not in ("a town", "a jam"):  # no known cut-ins are so slow
        assert verdicts.count(FINE) >= 8


PARTS = {
    "all": lambda x: x,
    "near": lambda x: x[x["range"] < 30],
    "far": lambda x: x[x["range"] > 50],
    "fast closing": lambda x: x[x["closing_speed"] > 2],
    "close behind": lambda x: x[x["range"] < x["lead_speed"]],
    "denser and faster": lambda x: x[x["lead_speed"] > 22] * [1.2, 0.6, 0.8],
}


@pytest.mark.parametrize("rows", SIZES)
@pytest.mark.parametrize("part", PARTS)
def test_parts_of_the_recorded_cut_ins_are_not_stopped(part, rows):
    chosen = PARTS[part](known_cut_ins()["Safety Pilot"][NAMES])
    assert STOP not in [found(chosen.sample(rows, random_state=seed)).verdict for seed in range(3)]


def test_the_known_records_themselves_are_fine():
    for table in known_cut_ins().values():
        assert found(table[NAMES][table["lead_speed"] > 0]).verdict == FINE


def changed(name, change):
    return lambda rows: rows.assign(**{name: change(rows)})


# Each fault with the remedy that the advice must name.
SPOILED = {
    "range in feet": (changed("range", lambda x: x["range"] * FEET), "columns.range.unit to ft"),
    "metres taken for feet": (changed("range", lambda x: x["range"] / FEET), "columns.range.unit to m"),
    "host speed": (
        changed("lead_speed", lambda x: x["lead_speed"] + x["closing_speed"]),
        "data.table.columns.host_speed",
    ),
    "closing speed / 3.6": (
        changed("closing_speed", lambda x: x["closing_speed"] / 3.6),
        "columns.closing.unit to m/s",
    ),
    "closing speed in km/h": (
        changed("closing_speed", lambda x: x["closing_speed"] * 3.6),
        "columns.closing.unit to km/h",
    ),
    "1/TTC": (
        changed("closing_speed", lambda x: x["closing_speed"] / x["range"]),
        "columns.closing.quantity to ttc, and its unit to 1/s",
    ),
    "TTC": (
        changed("closing_speed", lambda x: x["range"] / x["closing_speed"]),
        "columns.closing.quantity to ttc, and its unit to s",
    ),
    "lead speed in mph": (
        changed("lead_speed", lambda x: x["lead_speed"] / 0.44704),
        "columns.lead_speed.unit to mph",
    ),
    "speeds / 3.6": (
        lambda x: x / [3.6, 1, 3.6],
        "columns.lead_speed.unit to m/s and set data.table.columns.closing.unit to m/s",
    ),
    "feet and ft/s": (
        lambda x: x * FEET,
        "range.unit to ft and set data.table.columns.lead_speed.unit to ft/s",
    ),
    "exchanged": (lambda x: x[["range", "lead_speed", "closing_speed"]].set_axis(NAMES, axis=1), "exchange"),
}


@pytest.mark.parametrize("rows", [300, 2_000])
@pytest.mark.parametrize("fault", SPOILED)
def test_a_fault_in_known_traffic_is_a_stop_with_its_remedy(fault, rows):
    spoil, remedy = SPOILED[fault]
    report = found(spoil(recorded(rows)))
    few = fault == "host speed" and rows < 1_000  # it changes little, which few rows show less clearly
    assert report.verdict == (WARNING if few else STOP)
    assert remedy in report.advice
    assert "the hardest 1 % of the records need a deceleration of" in report.seen


NOTICED = [  # the faults that are named among the explanations; a jam is too unlike the known traffic
    *((kind, "range in feet", "range in ft") for kind in TRAFFIC[:3]),
    *((kind, "1/TTC", "1/TTC in place of closing_speed") for kind in TRAFFIC[:-1]),
]


@pytest.mark.parametrize(("kind", "fault", "named"), NOTICED)
def test_a_fault_in_other_traffic_is_noticed(kind, fault, named):
    report = found(SPOILED[fault][0](drawn(kind, 2_000)))
    assert report.verdict != FINE
    assert named in report.seen


IN_UNITS = [{}, {"closing": "km/h"}, {"lead_speed": "mph"}, {"lead_speed": "mph", "closing": "mph"}]


@pytest.mark.parametrize("units", [*IN_UNITS, {"lead_speed": "ft/s", "range": "ft", "closing": "ft/s"}])
@pytest.mark.parametrize("gap", [11.0, 15.0, 19.0])
@pytest.mark.parametrize("closing", [1.0, 2.0, 3.0, 4.5])
def test_a_unit_is_no_advice_where_other_traffic_or_units_explain_as_much(gap, closing, units):
    """Dense traffic in any unit: no table shows which it is, unless it is like known traffic."""
    generator, n = np.random.default_rng(3), 2_000
    around = gap * np.exp(0.4 * generator.standard_normal(n))
    table = pd.DataFrame(
        dict(zip(NAMES, (generator.normal(22, 3, n), around, generator.exponential(closing, n)), strict=True))
    )
    table = table[(table["lead_speed"] > 1) & (table["closing_speed"] ** 2 < 6 * table["range"])]
    report = found(
        table / [(SPEED | LENGTH)[units.get(name, "m")] for name in ("lead_speed", "range", "closing")]
    )
    assert dict(re.findall(r"(\w+)\.unit to (\S+)", report.advice)) in ({}, units)
    assert report.verdict != STOP or units
    assert ("Change nothing unless" in report.advice) == ("do not distinguish" in report.seen)


@pytest.mark.parametrize("speed", [1e-320, 1e-300])
def test_tiny_speeds_are_compared_without_a_warning(speed):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert found(recorded(300).assign(closing_speed=speed)).number > SIMILAR


def test_far_ranges_in_feet_are_not_to_be_hidden():
    rows = recorded()
    feet = rows.assign(range=np.where(rows["range"] > 70, 140, rows["range"]) * FEET)
    assert "data.table.columns.range.unit to ft" in found(feet, "far_ranges").advice
    assert "filters" not in found(feet, "far_ranges").advice
    codes = rows.assign(range=np.where(np.arange(len(rows)) % 50, rows["range"], 999.0))
    assert "Only if it is right" in found(codes, "far_ranges").advice


def test_values_with_two_decimals_are_not_taken_for_multiples_of_half_a_foot(monkeypatch):
    """Every 381st value in metres is such a multiple, and no value is a multiple plus a tenth of the step."""
    tables = [drawn("rapid motorway", 12_000, seed).round(2) for seed in range(3)]
    assert [found(rows, "round_numbers").verdict for rows in tables] == [FINE] * 3
    in_kmh = tables[0].assign(lead_speed=lambda x: (3.6 * x["lead_speed"]).round(1) / 3.6)
    assert found(in_kmh, "round_numbers").verdict == FINE
    half_feet = tables[0].assign(range=lambda x: (2 * FEET * x["range"]).round() / 2 / FEET)
    assert found(half_feet, "round_numbers").verdict == STOP
    monkeypatch.setattr(shapes, "_grid", lambda *_: 0.0)  # as if they had all decimals
    assert found(tables[0], "round_numbers").verdict == WARNING


def test_round_numbers_name_the_unit_of_the_column():
    rows = recorded().assign(range=lambda x: (2 * x["range"]).round() / 2)
    feet = found(rows.assign(range=rows["range"] * FEET), "round_numbers")
    assert "m in a column of ft" in feet.seen
    assert "the column range is probably in ft" in feet.seen
    measured = rows.assign(range=(2 * rows["range"] * FEET).round() / 2 / FEET)  # steps of half a foot
    assert "was measured in ft and then converted" in found(measured, "round_numbers").seen


def test_a_negative_lead_speed_rules_out_the_host_speed():
    """A fault whose correction is impossible in many rows explains nothing."""
    rows = recorded().assign(lead_speed=lambda x: np.minimum(x["lead_speed"], 0.9 * x["closing_speed"]))
    assert not any("host speed" in fault.text for _, fault in Comparison.of(records_of(rows)).without)


def test_too_few_closing_rows_are_not_compared():
    rows = recorded().assign(closing_speed=-1.0)
    assert found(rows).seen.startswith("not checked")
    assert found(rows).verdict == FINE


def test_records_in_other_units_are_compared_without_speeds_and_lengths():
    known = pd.DataFrame(np.random.default_rng(3).lognormal(size=(500, 2)), columns=["mass", "force"])
    units, limits = {"mass": "kg", "force": "N"}, dict.fromkeys(known, (0.0, 1e3))

    def verdict(rows):
        rows = rows.set_axis(range(1, len(rows) + 1))
        return CHECKS["known_records"](Records(units, limits, rows, rows, rows.index[:0], known=known))

    assert verdict(known.iloc[::2]).verdict == FINE
    exchanged = known.assign(force=known["force"] * 9).set_axis(["force", "mass"], axis=1)[["mass", "force"]]
    assert verdict(exchanged).verdict == WARNING
