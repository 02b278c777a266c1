"""The table of records in the far tail against direct counts, and the records near the crashes."""

from types import SimpleNamespace

import numpy as np
import pytest
from accelerated_evaluation.answer.candidates.far_records import EVERY_LAW, far_records_table
from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.candidates.smooth_family import SmoothFamily
from accelerated_evaluation.answer.ways.choices import near_crashes
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.family import DistinctRecords, FarRecords
from mean_law import MEMBERS, SUPPORT, encounters_  # noqa: F401


@pytest.fixture(scope="module")
def study(encounters):
    smooth = SmoothFamily.of(DistinctRecords.of(encounters, SUPPORT), MEMBERS, 2)
    return LawStudy(smooth, np.array([[0.1, 0.2, 0.3, 0.4], [0.3, 0.4, 0.1, 0.2]]))


def test_records_are_counted_beyond_the_levels_of_each_law(study):
    table = far_records_table(study).set_index(["law", "group"])
    records, family = study.smooth.records, study.smooth.family
    for member in MEMBERS:
        hazard = family.without_far_tail(member).given(records.places).cumulative(records.closing_speed)
        levels = np.log(records.size / np.array([100, 10, 1]))
        whole = table.loc[member.name, "all records"]
        counted = [whole[f"counted_{number}"] for number in (100, 10, 1)]
        assert counted == (hazard > levels[:, None]).sum(axis=1).tolist()
        fast = records.lead_speed > np.quantile(records.lead_speed, 0.75)
        group = [name for name in table.loc[member.name].index if name.startswith("lead")][-1]
        assert table.loc[(member.name, group), "counted_100"] == np.sum(hazard[fast] > levels[0])
        # The counts of a law with its far tail are others: the wrong answer.
        changed = family.law(member).given(records.places).cumulative(records.closing_speed)
        assert not np.allclose(changed, hazard)
    weighted = table["counted_100"].xs("all records", level="group")
    expected = study.mean_weights @ weighted[list(study.names)]
    assert weighted[EVERY_LAW] == pytest.approx(expected)


def test_the_groups_of_each_variable_are_all_records(study):
    table = far_records_table(study).query("law == @EVERY_LAW").drop(columns="law").set_index("group")
    whole = table.loc["all records"]
    assert whole[["expected_100", "expected_10", "expected_1"]].tolist() == pytest.approx([100, 10, 1])
    for variable in ("lead speed", "range"):
        own = table[table.index.str.startswith(variable)]
        assert len(own) == 4
        np.testing.assert_allclose(own.sum(), whole)


def test_records_near_the_crashes_have_their_lead_speeds_and_ranges():
    generator = np.random.default_rng(3)
    speeds, ranges = generator.uniform(5, 35, 500), generator.uniform(5, 75, 500)
    records = FarRecords(Places.of(speeds, ranges), np.ones(500), 10_000, 2.3)
    at = Places.of(np.linspace(5, 15, 101), np.linspace(20, 40, 101))
    lines = SimpleNamespace(places=at, row=np.repeat(np.arange(101), 2))
    masses = np.full(202, 0.5)
    found = near_crashes(records, lines, masses)
    inside = (speeds >= 5.5) & (speeds <= 14.5) & (ranges >= 21) & (ranges <= 39)
    np.testing.assert_array_equal(found.places.lead_speed, speeds[inside])
    np.testing.assert_array_equal(found.levels, records.levels)  # of all records
    masses[lines.row > 10] = 0  # all crashes behind slow leads
    assert near_crashes(records, lines, masses).places.lead_speed.max(initial=0) <= 6
