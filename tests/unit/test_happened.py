"""What happens: ways to crash, nearest records, their figures; random closing speeds for narrow stripes."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.answer.likeliest_crashes import (
    PLACE,
    WAYS,
    nearest_records,
    normal_scores,
    traces_of,
    ways_to_crash,
)
from accelerated_evaluation.answer.preventable import CLOSING_SPEEDS, FORESEEN, preventable
from accelerated_evaluation.answer.study import LawStudy
from accelerated_evaluation.answer.weighted_family import WeightedLaws
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.mapping import map_crashes
from accelerated_evaluation.crash_map.maps import Grid
from accelerated_evaluation.crash_map.sampled import sample_crashes
from accelerated_evaluation.laws.paper.independent import recorded_lead_speeds
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.dependent import DependentLaw
from accelerated_evaluation.laws.smooth.family import DistinctRecords, Fitter, Member, members_at
from accelerated_evaluation.laws.smooth.support import SUPPORT
from accelerated_evaluation.publishing.figures.likeliest_crashes import (
    CRASHES,
    RECORDS,
    fig28_ways_to_crash,
    fig29_nearest_records,
)
from accelerated_evaluation.publishing.figures.preventable import fig30_preventable
from accelerated_evaluation.records.encounter_table import complete
from accelerated_evaluation.vehicles import AccAeb, Outcomes

SIZE, MEAN, RATE = 6000, 2.0, 0.3
GRID = Grid(5, 35, 75, 6, 20, 2, 45.0, 120)
SLOWEST, WIDTH, SHARE = 2.0, 0.013, 0.25


def outcomes(crash, range_, closing_speed):
    near = np.where(closing_speed > 0, range_ / np.maximum(closing_speed, 1e-9), np.inf)
    return Outcomes(crash, np.where(crash, 0.0, range_), near, np.where(crash, closing_speed, 0.0))


class RateCar:
    """Crashes where the closing speed exceeds a share of the range a second, whatever the lead speed."""

    def simulate(self, lead_speed, range_, closing_speed):
        return outcomes(closing_speed > RATE * range_, range_, closing_speed)


class FastCar:
    """Crashes at all closing speeds above one."""

    def simulate(self, lead_speed, range_, closing_speed):
        return outcomes(closing_speed > SLOWEST, range_, closing_speed)


class StripedCar:
    """Crashes in a quarter of what `FastCar` crashes in, in stripes far narrower than the steps of a scan."""

    def simulate(self, lead_speed, range_, closing_speed):
        crash = (closing_speed > SLOWEST) & (closing_speed % WIDTH < SHARE * WIDTH)
        return outcomes(crash, range_, closing_speed)


@pytest.fixture(scope="module")
def records():
    generator = np.random.default_rng(1)
    lead_speed = generator.uniform(5, 34.9, SIZE)
    range_ = SUPPORT.range_max * generator.uniform(0, 1, SIZE) ** 0.5
    return DistinctRecords(lead_speed, range_, MEAN * generator.standard_exponential(SIZE))


@pytest.fixture(scope="module")
def weighted(records):
    fitter = Fitter(records, members_at((0.9,)))
    members = len(fitter.members)
    weights = np.full((20, members), 1 / members)
    return WeightedLaws(fitter, fitter.fit(), np.zeros((SIZE, members)), np.zeros((members, 0)), weights)


@pytest.fixture(scope="module")
def law(records, weighted):
    table = pd.DataFrame({"lead_speed": records.lead_speed, "segment": "all"})
    speeds = recorded_lead_speeds(table, ["all"])
    family = weighted.family
    return DependentLaw("made up", {"all": SIZE}, family.ranges, family.law(Member()), speeds)


def lines_of(crash_map, records):
    return CrashLines.of(crash_map, records.lead_speed)


def test_random_closing_speeds_find_stripes_that_a_scan_does_not(records, law):
    """A quarter of the probability of the whole; the scan is wrong by far more than the tolerance."""
    generator = np.random.default_rng(3)
    whole = lines_of(map_crashes(FastCar(), GRID, [], generator), records)
    truth = SHARE * whole.probability(law.ranges, law.speeds)
    scanned = map_crashes(StripedCar(), GRID, [], generator)
    found = lines_of(sample_crashes(StripedCar(), scanned, generator), records)
    assert found.probability(law.ranges, law.speeds) == pytest.approx(truth, rel=0.06)
    assert lines_of(scanned, records).probability(law.ranges, law.speeds) != pytest.approx(truth, rel=0.18)


def test_random_closing_speeds_agree_with_a_scan_that_is_right(records, law):
    generator = np.random.default_rng(4)
    scanned = map_crashes(RateCar(), GRID, [], generator)
    sampled = sample_crashes(RateCar(), scanned, generator)
    one, two = (lines_of(part, records).probability(law.ranges, law.speeds) for part in (scanned, sampled))
    assert two == pytest.approx(one, rel=0.05)


def test_a_contradicted_map_is_resolved_and_the_others_stay(records, weighted):
    """The vehicle with stripes gets a number, and it agrees with the replayed records then."""
    generator = np.random.default_rng(5)
    vehicles = {"under_test": RateCar(), "striped": StripedCar()}
    maps = {name: map_crashes(vehicle, GRID, [], generator) for name, vehicle in vehicles.items()}
    names = {"under_test": "crash", "striped": "crash of striped"}
    lines = {names[name]: lines_of(crash_map, records) for name, crash_map in maps.items()}
    thinned = {name: weighted.thinned(part, generator) for name, part in lines.items()}
    study = LawStudy(pd.DataFrame(), vehicles, weighted, dict(lines), thinned, {})
    before = weighted.draw(study.thinned, np.random.default_rng(6))
    assert study.compared({"under test": before["crash"], "striped": before["crash of striped"]})[
        "resolved"
    ].tolist() == [True, False]
    study.resolve(maps, np.random.default_rng(7))
    assert study.sampled == {"crash of striped"}
    assert study.lines["crash"] is lines["crash"]
    after = weighted.draw(study.thinned, np.random.default_rng(6))
    assert np.array_equal(after["crash"].probabilities, before["crash"].probabilities)
    table = study.compared({"under test": after["crash"], "striped": after["crash of striped"]})
    assert table["resolved"].tolist() == [True, True]
    assert table["scan"].tolist() == ["refined", "random"]


@pytest.fixture(scope="module")
def shown(records, law):
    crash_map = map_crashes(RateCar(), GRID, [], np.random.default_rng(8))
    lines = lines_of(crash_map, records)
    ways = ways_to_crash(lines, law, RateCar(), np.random.default_rng(9))
    return ways, lines.probability(law.ranges, law.speeds)


def test_ways_to_crash_share_the_whole_probability_and_are_not_copies(shown, law):
    ways, probability = shown
    assert len(ways) == WAYS
    assert ways["crash"].all()
    assert ways["probability"].sum() == pytest.approx(probability)
    assert ways["probability"].is_monotonic_decreasing
    z = normal_scores(law, *(ways[name].to_numpy() for name in PLACE))
    distance = np.linalg.norm(z[:, None] - z, axis=2)[~np.eye(WAYS, dtype=bool)]
    assert distance.min() > 0.2


def test_normal_scores_of_drawn_cut_ins_are_standard_normal(law):
    z = normal_scores(law, *law.draw(4000, np.random.default_rng(10)).T)
    np.testing.assert_allclose(z.mean(axis=0), 0, atol=4 / 4000**0.5)
    np.testing.assert_allclose(np.cov(z.T), np.eye(3), atol=6 / 4000**0.5)


def test_a_vehicle_that_never_crashes_has_no_ways(records, law):
    class Safe(RateCar):
        def simulate(self, lead_speed, range_, closing_speed):
            return outcomes(closing_speed > np.inf, range_, closing_speed)

    lines = lines_of(map_crashes(Safe(), GRID, [], np.random.default_rng(1)), records)
    assert ways_to_crash(lines, law, Safe(), np.random.default_rng(1)).empty


def test_crashes_of_probability_zero_to_rounding_are_none(records, weighted, law):
    lines = lines_of(map_crashes(RateCar(), GRID, [], np.random.default_rng(1)), records)
    beyond = replace(lines, start=np.full(lines.start.size, 1e6), end=np.full(lines.start.size, np.inf))
    assert ways_to_crash(lines, law, RateCar(), np.random.default_rng(1)).size
    assert ways_to_crash(beyond, law, RateCar(), np.random.default_rng(1)).empty
    assert weighted.thinned(lines, np.random.default_rng(1), size=20).share.size < lines.share.size
    assert weighted.thinned(beyond, np.random.default_rng(1), size=20) is beyond


def test_a_threshold_whose_laws_have_no_weight_is_told_with_equal_weights(weighted):
    weights = np.zeros_like(weighted.weights)
    weights[:, 0] = 1
    at_level = replace(weighted, weights=weights).weights_at(0.9)
    has_level = np.array([member.level == 0.9 for member in weighted.members])
    assert not has_level[0]
    np.testing.assert_allclose(at_level, np.tile(has_level / has_level.sum(), (len(weights), 1)))


def test_the_nearest_records_are_crashes_and_then_the_smallest_times(records):
    some = records.only(np.arange(1000))
    near = nearest_records(some, AccAeb())
    result = AccAeb().simulate(some.lead_speed, some.range_, some.closing_speed)
    assert near["crash"].sum() == min(result.crash.sum(), WAYS)
    calm = np.sort(result.min_ttc[~result.crash])[: WAYS - near["crash"].sum()]
    assert near.loc[~near["crash"], "min_ttc"].tolist() == calm.tolist()


def test_lines_of_what_can_be_prevented(law, records):
    table = preventable({"rate": RateCar(), "striped": StripedCar()}, law, records.lead_speed)
    rate = table[table["name"] == "rate"]
    step = np.diff(CLOSING_SPEEDS)[0]
    assert np.all(rate["first"] == rate["always"])
    assert np.all(np.abs(rate["first"] - RATE * rate["range"] - step / 2) <= step / 2 + 1e-9)
    striped = table[table["name"] == "striped"]
    assert np.all(striped["first"] < SLOWEST + 0.2)
    assert not np.any(striped["always"] < 39)
    foreseen = table[(table["name"] == f"{FORESEEN[0]:g}") & (table["kind"] == "law")]
    given = law.speeds.given(Places.of(foreseen["lead_speed"].to_numpy(), foreseen["range"].to_numpy()))
    np.testing.assert_allclose(
        np.exp(-given.cumulative(foreseen["first"].to_numpy())), FORESEEN[0], rtol=1e-6
    )


def happened(kinds=("crash", "record")):
    """A made-up table of encounters with the study's car, half of them crashes."""
    rows = [(8.0, 30.0 - number, 22.0, kind, number + 1) for kind in kinds for number in range(WAYS)]
    table = pd.DataFrame(rows, columns=[*PLACE, "kind", "number"])
    result = AccAeb().simulate(*(table[name].to_numpy() for name in PLACE))
    return table.assign(probability=1e-7, **vars(result))


def test_figures_of_what_happens():
    table = happened()
    traces = traces_of(table, AccAeb())
    _, data = fig28_ways_to_crash(table, traces, "made up")
    assert data["number"].nunique() == min(CRASHES, WAYS)
    _, data = fig29_nearest_records(table, traces, "made up")
    ends = data.groupby("number")["range_m"].min()
    assert len(ends) == min(RECORDS, WAYS)
    expected = table.groupby("number")["min_range"].first().loc[ends.index]
    np.testing.assert_allclose(ends, expected, atol=1e-12)


def test_figures_say_what_they_cannot_show():
    table, none = happened(("record",)), pd.DataFrame(columns=["kind", "number", "time_s", "range_m"])
    drawn, data = fig28_ways_to_crash(table, none, "made up")
    assert [text.get_text() for text in drawn.axes[0].texts] == ["no crash"]
    assert data.empty
    drawn, data = fig29_nearest_records(table, none, "made up")
    assert "not known" in drawn.axes[0].texts[0].get_text()
    assert traces_of(table, RateCar()).empty


def test_the_figure_of_what_can_be_prevented(law, records):
    table = preventable({"under test": RateCar(), "striped": StripedCar()}, law, records.lead_speed)
    raw = pd.DataFrame(
        dict(zip(PLACE, (records.lead_speed, records.range_, records.closing_speed), strict=True))
    )
    encounters = complete(raw)
    drawn, data = fig30_preventable(table, encounters, "made up")
    assert data is table
    labels = [text.get_text() for text in drawn.legends[0].get_texts()]
    assert labels == ["car under test", "striped", *(f"1 in {1 / level:,.0f} cut-ins" for level in FORESEEN)]
