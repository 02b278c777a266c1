"""The tables of European cut-ins: courses with known values, limits by hand, and the shipped files."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import read_records
from accelerated_evaluation.laws.motion.recorded import Recorded
from accelerated_evaluation.laws.smooth.support import Support
from accelerated_evaluation.study.configuration import load, resolved

pytestmark = pytest.mark.studies
ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "benchmarks" / "europe"))

import compare  # noqa: E402
import derive  # noqa: E402

KNOTS = [0.0] * 4 + [0.2, 0.4, 0.6, 0.8] + [1.0] * 4


def content(scenarios):
    """Return a file of scenarios: activities of (name, start [s], end [s], first and last values).

    The quantities are linear in time, because the coefficients are linear in the Greville points.
    """
    points = np.array([sum(KNOTS[i + 1 : i + 4]) / 3 for i in range(8)])
    made = {"activity": {}, "event": {}, "scenario": {}, "actor": {"1": {"properties": {}}}}
    made["actor"]["2"] = {"properties": {"filename": "data\\a_1.hdf5"}}

    def event(time):
        made["event"][str(len(made["event"]))] = {"conditions": {"time": time}}
        return {"uid": len(made["event"]) - 1}

    for number, activities in enumerate(scenarios):
        acts = []
        for name, start, end, *values in activities:
            series = [[*(first + (last - first) * points), 0, 0, 0, 0] for first, last in values]
            parameters = {"knots": [KNOTS] * len(series), "coefficients": series, "degree": [3] * len(series)}
            if len(series) == 1:
                parameters = {key: value[0] for key, value in parameters.items()}
            key = str(len(made["activity"]))
            made["activity"][key] = {
                "name": name,
                "parameters": parameters,
                "start": event(start),
                "end": event(end),
            }
            acts.append({"activity": key})
        change = next(each for each in activities if each[0].endswith("lane change"))
        made["scenario"][str(number)] = {
            "start": event(change[1]),
            "end": event(change[2]),
            "actors": [{"uid": 1}, {"uid": 2}],
            "acts": acts,
        }
    return made


def scenario(across=(-3.5, 0.0), end=30.0, slope=-4.0):
    """Return a lane change from 10 to 14 s; the lead accelerates until 12 s, and the host brakes."""
    return [
        ("left lane change", 10.0, 14.0, across),
        ("acceleration target", 9.0, 12.0, (24.7, 25.0), (40 - 3 * slope, 40.0)),
        ("cruising target", 12.0, end, (25.0, 25.0), (40.0, 40 + slope * (end - 12))),
        ("lane keeping ego", 0.0, 40.0, (0, 0)),
        ("cruising ego", 5.0, 25.0, (31.0, 27.0)),
    ]


def test_the_tables_contain_the_values_at_the_middle_and_at_the_crossing(tmp_path):
    others = [scenario(across=(2.6, 1.0), end=19.0), scenario(across=(1.7, 0.0))]
    left_out = derive.derive(content([scenario(), *others, scenario(slope=-8)]), tmp_path)
    assert left_out.tolist() == [4]  # the speeds differ by 4.55 m/s, but the range changes by 8 m/s
    table = pd.read_csv(tmp_path / "cut_ins.csv")
    assert table["recording"].tolist() == ["a_1"] * 3
    first, second, third = table.to_dict("records")
    moment = {"lead_speed": 25.0, "range": 40.0, "closing_speed": 4.6}
    assert {name: first[name] for name in moment} == pytest.approx(moment, abs=1e-3)
    # The marking is crossed after 2 s, and a drift of .375 m is reached after .375 / .875 s.
    assert first["seen"] == pytest.approx(2 - 0.375 / 0.875, abs=0.02)
    assert first["lateral_speed"] == pytest.approx(0.875, rel=1e-3)
    assert first["host_change"] == pytest.approx(-0.4, abs=1e-3)
    # The second is first seen on its way, and the third in the lane of the host.
    assert second["lateral_speed"] == pytest.approx(0.4, rel=1e-3)
    assert np.isnan(second["seen"])
    assert np.isnan([third[name] for name in ("seen", "lateral_speed", "host_change")]).all()
    followed = pd.read_parquet(tmp_path / "lead_motion.parquet")
    assert followed["scenario"].tolist() == [1, 3]  # the second is in view for 7 s only
    assert np.allclose(followed["speed_8.0"], 25)


def test_the_shipped_tables_are_records_and_a_law_of_lead_motion():
    table = pd.read_csv(ROOT / "data" / "europe" / "cut_ins.csv")
    assert len(table) == 292
    assert (table["closing_speed"] > 0).sum() == 72
    assert table["recording"].nunique() == 43
    assert not table["scenario"].isin([279]).any()
    records = read_records(resolved(load([ROOT / "config" / "europe.yaml"])))
    assert len(records.table) == 71
    motion = Recorded.read(ROOT / "data" / "europe" / "lead_motion.parquet")
    assert len(motion.courses) == 165
    assert np.median(motion.encounters[0]) == pytest.approx(28.5, abs=0.5)


class Constant:
    """A law of closing speeds with a constant hazard, at all places."""

    def __init__(self, rate):
        self.rate = rate

    def given(self, places):
        return self

    def cumulative(self, closing_speed):
        return self.rate * closing_speed


@pytest.mark.parametrize(("rate", "is_right"), [(0.5, True), (0.7, False), (0.35, False)])
def test_closing_speeds_are_compared_with_their_law(rate, is_right):
    quantiles = -2 * np.log1p(-(np.arange(400) + 0.5) / 400)  # of the law with the rate 0.5
    closing = pd.DataFrame({"lead_speed": 20.0, "range": 30.0, "closing_speed": quantiles})
    rows = list(compare.of_closing_speeds(closing, Constant(rate), Support((5.0, 35.0), 75.0, 24.0)))
    expected = {"cumulative hazard": 1, "share above the median": 0.5, "share above the quantile 0.9": 0.1}
    inside = [
        row["low"] < value < row["high"]
        for row, (name, value) in zip(rows, expected.items(), strict=True)
        if row["what"].startswith(name)
    ]
    assert len(inside) == 3
    assert all(inside) if is_right else not any(inside)
