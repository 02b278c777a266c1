"""What happens: ways to crash, nearest records, their figures; random closing speeds for narrow stripes."""

import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import CUT_IN, LawStudy, Map, Problem, evaluate, map_crashes
from accelerated_evaluation.answer.candidates.smooth_family import SmoothFamily
from accelerated_evaluation.answer.consequences.preventable import CLOSING_SPEEDS, FORESEEN, preventable
from accelerated_evaluation.answer.ways import by_map
from accelerated_evaluation.answer.ways.by_map import thinned_lines
from accelerated_evaluation.answer.ways.comparison import is_resolved
from accelerated_evaluation.answer.ways.likeliest_crashes import (
    PLACE,
    WAYS,
    cut_in_scores,
    nearest_records,
    traces_of,
    ways_to_crash,
)
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.sampled import sample_crashes
from accelerated_evaluation.laws.paper.models import recorded_lead_speeds
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.draws import SmoothDraws
from accelerated_evaluation.laws.smooth.family import Fitter, Member, members_at
from accelerated_evaluation.laws.smooth.mean import MeanLaw
from accelerated_evaluation.publishing.figures.likeliest_crashes import CRASHES, fig28_ways_to_crash
from accelerated_evaluation.publishing.figures.moving import LANE, SCALE, fig36_cut_in
from accelerated_evaluation.publishing.figures.preventable import fig30_preventable
from accelerated_evaluation.publishing.figures.style import save_figure
from accelerated_evaluation.publishing.tables.display import NAMES
from accelerated_evaluation.records.segments import complete
from accelerated_evaluation.vehicles import AccAeb, Outcomes
from builders import coarse_grid
from rate_car import RATE, RateCar, exponential_records

SIZE, MEAN = 6000, 2.0
GRID = coarse_grid()
SLOWEST, WIDTH, SHARE = 2.0, 0.013, 0.25


def outcomes(crash, range_, closing_speed):
    near = np.where(closing_speed > 0, range_ / np.maximum(closing_speed, 1e-9), np.inf)
    return Outcomes(crash, np.where(crash, 0.0, range_), near, np.where(crash, closing_speed, 0.0))


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
    return exponential_records(SIZE, MEAN)


def encounters_of(records):
    return complete(pd.DataFrame(records.x, columns=PLACE))


@pytest.fixture(scope="module")
def smooth(records):
    fitter, table = Fitter(records, members_at((0.9,))), encounters_of(records).assign(segment="all")
    members = len(fitter.members)
    return SmoothFamily(fitter, fitter.fit(), np.zeros((members, SIZE)), np.zeros((members, 0)), table)


@pytest.fixture(scope="module")
def law(records, smooth):
    table = pd.DataFrame({"lead_speed": records.lead_speed, "segment": "all"})
    speeds = recorded_lead_speeds(table, ["all"])
    family = smooth.family
    alone = SmoothDraws.of_laws(family.ranges, [family.law(Member())])
    return MeanLaw("made up", {"all": SIZE}, alone, speeds)


def lines_of(crash_map, records):
    return CrashLines.of(crash_map, records.lead_speed)


def probability(lines, law):
    return lines.masses(law).sum()


def test_random_closing_speeds_find_stripes_that_a_scan_does_not(records, law):
    """A quarter of the probability of the whole; the scan is wrong by far more than the tolerance."""
    generator = np.random.default_rng(3)
    whole = lines_of(map_crashes(FastCar(), GRID, [], generator), records)
    truth = SHARE * probability(whole, law)
    scanned = map_crashes(StripedCar(), GRID, [], generator)
    found = lines_of(sample_crashes(StripedCar(), scanned, generator), records)
    assert probability(found, law) == pytest.approx(truth, rel=0.06)
    assert probability(lines_of(scanned, records), law) != pytest.approx(truth, rel=0.18)


def test_random_closing_speeds_agree_with_a_scan_that_is_right(records, law):
    generator = np.random.default_rng(4)
    scanned = map_crashes(RateCar(), GRID, [], generator)
    sampled = sample_crashes(RateCar(), scanned, generator)
    one, two = (probability(lines_of(part, records), law) for part in (scanned, sampled))
    assert two == pytest.approx(one, rel=0.05)


def test_a_contradicted_map_is_resolved_and_the_others_stay(records, smooth):
    """The vehicle with stripes gets a number, and it agrees with the replayed records then."""
    generator = np.random.default_rng(5)
    study = LawStudy(smooth, np.full((20, len(smooth.names)), 1 / len(smooth.names)))
    draws = study.draws(np.random.default_rng(6))
    found = {}
    for name, vehicle in {"rate": RateCar(), "striped": StripedCar()}.items():
        crash_map = map_crashes(vehicle, GRID, [], generator)
        problem = Problem(CUT_IN, vehicle, law=draws)
        found[name] = evaluate(problem, draws, Map(crash_map, records), generator=np.random.default_rng(7))
        scanned = lines_of(crash_map, records).masses(draws).sum(axis=1).mean()
        assert found[name].replayed.supports(scanned) == (name == "rate")
    assert {name: own.notes["scan"] for name, own in found.items()} == {
        "rate": "refined",
        "striped": "random",
    }
    assert all(is_resolved(own) for own in found.values())


@pytest.fixture(scope="module")
def shown(records, law):
    crash_map = map_crashes(RateCar(), GRID, [], np.random.default_rng(8))
    lines = lines_of(crash_map, records)
    ways = ways_to_crash(lines, law, RateCar(), np.random.default_rng(9))
    return ways, probability(lines, law)


def test_ways_to_crash_share_the_whole_probability_and_are_not_copies(shown, law):
    ways, probability = shown
    assert len(ways) == WAYS
    assert ways["crash"].all()
    assert ways["probability"].sum() == pytest.approx(probability)
    assert ways["probability"].is_monotonic_decreasing
    z = cut_in_scores(law, *(ways[name].to_numpy() for name in PLACE))
    distance = np.linalg.norm(z[:, None] - z, axis=2)[~np.eye(WAYS, dtype=bool)]
    assert distance.min() > 0.2


def test_normal_scores_of_drawn_cut_ins_are_standard_normal(law):
    z = cut_in_scores(law, *law.draw(4000, np.random.default_rng(10)).T)
    np.testing.assert_allclose(z.mean(axis=0), 0, atol=4 / 4000**0.5)
    np.testing.assert_allclose(np.cov(z.T), np.eye(3), atol=6 / 4000**0.5)


def test_a_vehicle_that_never_crashes_has_no_ways(records, law):
    class Safe(RateCar):
        def simulate(self, lead_speed, range_, closing_speed):
            return outcomes(closing_speed > np.inf, range_, closing_speed)

    lines = lines_of(map_crashes(Safe(), GRID, [], np.random.default_rng(1)), records)
    assert ways_to_crash(lines, law, Safe(), np.random.default_rng(1)).empty


def test_crashes_of_probability_zero_to_rounding_are_none(records, smooth, law, monkeypatch):
    lines = lines_of(map_crashes(RateCar(), GRID, [], np.random.default_rng(1)), records)
    beyond = replace(lines, start=np.full(lines.start.size, 1e6), end=np.full(lines.start.size, np.inf))
    assert ways_to_crash(lines, law, RateCar(), np.random.default_rng(1)).size
    assert ways_to_crash(beyond, law, RateCar(), np.random.default_rng(1)).empty
    monkeypatch.setattr(by_map, "LINES", 20)
    draws = smooth.draws(np.zeros(2, int), np.random.default_rng(1))
    assert thinned_lines(lines, RateCar(), draws, np.random.default_rng(1)).weight.size < lines.weight.size
    assert thinned_lines(beyond, RateCar(), draws, np.random.default_rng(1)) is beyond


def test_a_threshold_whose_laws_have_no_weight_is_told_with_equal_weights(smooth):
    weights = np.zeros((20, len(smooth.names)))
    weights[:, 0] = 1
    level = [member.name for member in smooth.members if member.level == 0.9]
    at_level = LawStudy(smooth, weights).only(level).weights
    has_level = np.isin(smooth.names, level)
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
    given = law.typical.given(Places.of(foreseen["lead_speed"].to_numpy(), foreseen["range"].to_numpy()))
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
    ends = data.groupby("number")["range_m"].min()
    assert len(ends) == min(CRASHES, WAYS)
    expected = table.groupby("number")["min_range"].first().loc[ends.index]
    np.testing.assert_allclose(ends, expected, atol=1e-12)


def test_figures_say_what_they_cannot_show():
    none = pd.DataFrame(columns=["kind", "number", "time_s", "range_m"])
    drawn, data = fig28_ways_to_crash(happened(("record",)), none, "made up")
    assert [text.get_text() for text in drawn.axes[0].texts] == ["no crash"]
    assert data.empty
    drawn, data = fig28_ways_to_crash(happened(("crash",)), none, "made up")
    assert "not known" in drawn.axes[0].texts[0].get_text()
    assert traces_of(happened(("record",)), RateCar()).empty


def test_the_moving_picture_ends_with_the_crash_of_the_trace(tmp_path):
    table = happened(("crash",)).assign(probability=lambda rows: 1e-7 * rows["number"])
    traces = traces_of(table, AccAeb())
    drawn, scene = fig36_cut_in(table, traces, "made up")
    likeliest = traces[traces["number"] == table["number"].max()]  # that of the largest probability
    assert scene.loc[scene["time_s"] == 0, "range_m"].item() == likeliest["range_m"].iloc[0]
    assert scene["range_m"].iloc[[0, -1]].tolist() == [pytest.approx(scene["range_m"].max()), 0]
    before = scene[scene["time_s"] <= 0]
    assert np.ptp(before["host_speed_m_per_s"]) == 0
    assert scene["lead_lateral_m"].iloc[0] == pytest.approx(LANE)
    for folder in ("one", "two"):
        save_figure(drawn, scene, tmp_path / folder, "fig36_cut_in")
    one, two = ((tmp_path / folder / "fig36_cut_in.svg").read_text() for folder in ("one", "two"))
    assert one == two
    assert len(one) < 300_000
    frames = dict(re.findall(r"@keyframes (\w+) \{(.*)\}", one))
    crossing = f"translate({SCALE * likeliest['range_m'].iloc[0]:.1f}px,{-SCALE * LANE / 2:.1f}px)"
    assert f"transform:{crossing}" in one
    assert crossing in frames["lead"]
    assert frames["lead"].endswith(
        "100% {transform: " + re.findall(r"transform: (.*?)\}", frames["lead"])[-2] + "}"
    )
    assert re.search(r"translate\(0\.0px", frames["lead"].split("%")[-1])
    ElementTree.fromstring(one)


def test_the_moving_picture_says_what_it_cannot_show(tmp_path):
    for kind, words in (("record", "no crash"), ("crash", "not known")):
        none = pd.DataFrame(columns=["kind", "number", "time_s", "range_m"])
        drawn, _ = fig36_cut_in(happened((kind,)), none, "made up")
        assert words in drawn.axes[0].texts[0].get_text()


def test_the_figure_of_what_can_be_prevented(law, records):
    table = preventable({"under test": RateCar(), "striped": StripedCar()}, law, records.lead_speed)
    encounters = encounters_of(records)
    drawn, data = fig30_preventable(table, encounters, "made up")
    assert data is table
    labels = [text.get_text() for text in drawn.legends[0].get_texts()]
    assert "never crashes" not in "".join(text.get_text() for text in drawn.axes[0].texts)
    assert labels == ["car under test", "striped", *(f"1 in {1 / level:,.0f} cut-ins" for level in FORESEEN)]


def test_the_figure_says_where_a_line_ends_and_who_never_crashes():
    ranges = np.arange(1.0, 6.0)
    ends = pd.DataFrame({"name": "cc_human", "range": ranges, "always": [2.0, 3.0, 4.0, np.nan, np.nan]})
    table = pd.concat([ends, ends.assign(name="rss", always=np.nan)]).assign(lead_speed=8.0, kind="vehicle")
    encounters = pd.DataFrame({"lead_speed": [8.0], "range": [4.0], "closing_speed": [1.0]})
    drawn, _ = fig30_preventable(table.assign(first=table["always"]), encounters, "made up")
    assert [text.get_text() for text in drawn.axes[0].texts] == [f"never crashes:\n{NAMES['rss']}"]
    assert "no crash at larger ranges" in [text.get_text() for text in drawn.legends[0].get_texts()]
    marks = [line.get_xydata().tolist() for line in drawn.axes[0].get_lines() if line.get_marker() == "|"]
    assert marks == [[[3.0, 4.0]], []]
