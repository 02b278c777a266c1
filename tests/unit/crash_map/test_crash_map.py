"""The crash map against toy cars whose crash sets are known."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from accelerated_evaluation import CUT_IN, InputError, Map, Problem, evaluate, map_crashes
from accelerated_evaluation.crash_map import mapping
from accelerated_evaluation.crash_map.intervals import HALVINGS
from accelerated_evaluation.crash_map.maps import read_crash_map, write_crash_map
from accelerated_evaluation.vehicles import AccAeb, Outcomes
from accelerated_evaluation.vehicles.protocol import CRASH
from builders import coarse_grid
from wall_car import GRID as FINER
from wall_car import RANGE_LAWS, TTC_LAWS, WallCar, law_of

GRID = coarse_grid(speeds=(5, 15, 4), closing=(25, 120), refinement=3)


HOLE = (12.3, 12.5)  # [m/s], of closing speed


def mapped(car, events=(), grid=GRID, seed=1):
    return map_crashes(car, grid, events, np.random.default_rng(seed))


def test_cells_cover_the_grid_once():
    parts = np.random.default_rng(1).integers(1, 5, size=(GRID.lead_speed_cells, GRID.range_cells))
    cells = GRID.cells(parts)
    area = np.diff(cells.lead_speed)[:, 0] * -np.diff(cells.root)[:, 0]
    assert len(area) == np.sum(parts**2)
    assert np.all(area > 0)
    assert area.sum() == pytest.approx(GRID.lead_speed_max - GRID.lead_speed_min, rel=1e-12)
    ends = cells.lead_speed.min(), cells.lead_speed.max(), cells.root.min(), cells.root.max()
    assert ends == (5, 15, 0, 1)
    # Neighbours share their edges to the bit, so that no lead speed is counted twice or not at all.
    for edges in (cells.lead_speed, cells.root):
        distinct = np.unique(edges)
        assert np.diff(distinct).min() > 1e-6


def test_lines_lie_in_their_cells():
    cells = GRID.cells(np.full((GRID.lead_speed_cells, GRID.range_cells), 2))
    lead_speed, inverse_range = cells.draw_lines(np.random.default_rng(1))
    pairs = lead_speed.reshape(-1, 2), inverse_range.reshape(-1, 2)
    for values, edges in zip(pairs, (cells.lead_speed, cells.inverse_range), strict=True):
        assert np.all((values >= edges[:, :1] * (1 - 1e-12)) & (values <= edges[:, 1:] * (1 + 1e-12)))


def test_intervals_end_where_the_car_says():
    car = WallCar(hole=HOLE)
    crash = mapped(car).intervals(CRASH)
    lines = np.unique(crash.line).size
    assert lines == mapped(car).lead_speed.size
    resolution = 25 / 30 * 2**-HALVINGS * 2  # widest step of the coarse scan, halved
    first, second = crash.end < np.inf, np.isinf(crash.end)
    assert np.count_nonzero(first) == np.count_nonzero(second) == lines
    np.testing.assert_allclose(crash.start[first], 12, atol=resolution)
    np.testing.assert_allclose(crash.end[first], 12.3, atol=resolution)
    np.testing.assert_allclose(crash.start[second], 12.5, atol=resolution)


@pytest.mark.parametrize("points", [120, 5, 2])
def test_a_car_without_holes_is_told_from_one_with(points):
    """Few points are those of a coarse grid at a quarter of its resolution."""
    crash = mapped(WallCar(hole=(99, 99)), grid=replace(GRID, closing_speed_points=points)).intervals(CRASH)
    assert np.unique(crash.line).size == crash.line.size
    assert np.all(np.isinf(crash.end))
    np.testing.assert_allclose(crash.start, 12, atol=25 * 2**-HALVINGS)


def test_island_below_no_crash_is_found_where_the_car_comes_nearest():
    # A crash only in a window narrower than the steps of the coarse scan.
    car = WallCar(first=12.0, hole=(12.15, np.inf))
    crash = mapped(car).intervals(CRASH)
    share = crash.line.size / mapped(car).lead_speed.size
    assert share > 0.99
    np.testing.assert_allclose(crash.end - crash.start, 0.15, atol=5e-3)


def test_levels_of_impact_speed_range_and_ttc():
    events = [
        CUT_IN.event("impact_speed", 15.0),
        CUT_IN.event("min_range", 0.5),
        CUT_IN.event("min_ttc", 2.0),
    ]
    crash_map = mapped(WallCar(hole=(99, 99)), events)
    impact = crash_map.intervals(events[0])
    np.testing.assert_allclose(impact.start, 15, atol=2e-3)
    near = crash_map.intervals(events[1])
    far_lines = crash_map.inverse_range[near.line] < 1 / 0.5
    np.testing.assert_allclose(near.start[far_lines], 11.5, atol=2e-3)
    assert np.all(near.start[~far_lines] == 0)
    short = crash_map.intervals(events[2])
    expected = 0.5 / crash_map.inverse_range[short.line]
    np.testing.assert_allclose(short.start, expected, atol=2e-3)


def test_no_crash_gives_an_empty_map():
    crash_map = mapped(WallCar(first=99, hole=HOLE))
    assert crash_map.intervals(CRASH).line.size == 0
    assert crash_map.smallest_inverse_ttc() == np.inf
    assert crash_map.lead_speed.size == 2 * GRID.lead_speed_cells * GRID.range_cells


def test_event_that_was_not_mapped_is_refused():
    with pytest.raises(InputError, match="min_ttc"):
        mapped(WallCar(hole=HOLE)).intervals(CUT_IN.event("min_ttc", 1.0))


def test_file_is_read_back_equal_and_written_to_the_same_bytes(tmp_path):
    events = [CUT_IN.event("impact_speed", 15.0)]
    for name in ("one.npz", "two.npz"):
        write_crash_map(tmp_path / name, mapped(WallCar(hole=HOLE), events))
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    written, read = mapped(WallCar(hole=HOLE), events), read_crash_map(tmp_path / "one.npz")
    assert read.grid == written.grid
    assert list(read.events) == list(written.events)
    np.testing.assert_array_equal(read.cells.root, written.cells.root)
    for event, intervals in written.events.items():
        for name, values in vars(intervals).items():
            np.testing.assert_array_equal(getattr(read.events[event], name), values)


def test_map_of_the_car_agrees_with_the_car():
    grid = replace(GRID, closing_speed_max=23.49, lead_speed_cells=10)
    car = AccAeb()
    crash_map = mapped(car, grid=grid)
    crash = crash_map.intervals(CRASH)
    generator = np.random.default_rng(2)
    line = generator.integers(crash_map.lead_speed.size, size=200_000)
    closing_speed = generator.uniform(0, 23.49, size=line.size)
    outcomes = car.simulate(crash_map.lead_speed[line], 1 / crash_map.inverse_range[line], closing_speed)
    inside = np.zeros(line.size, dtype=bool)
    first = np.searchsorted(crash.line, line)
    for place in range(int(np.bincount(crash.line).max())):
        index = np.minimum(first + place, crash.line.size - 1)
        same = crash.line[index] == line
        inside |= same & (closing_speed >= crash.start[index]) & (closing_speed < crash.end[index])
    assert 0.1 < outcomes.crash.mean() < 0.9
    # What is left is holes and islands that fell between the points.
    assert np.mean(inside != outcomes.crash) < 2e-3


def test_without_aeb_more_crashes_and_earlier():
    with_aeb, without = (
        mapped(car, grid=replace(GRID, closing_speed_max=23.49)) for car in (AccAeb(), AccAeb(aeb=False))
    )
    assert without.smallest_inverse_ttc() < with_aeb.smallest_inverse_ttc()
    assert (
        np.unique(without.intervals(CRASH).line).size / without.lead_speed.size
        > np.unique(with_aeb.intervals(CRASH).line).size / with_aeb.lead_speed.size * 0.99
    )


def test_damaged_files_are_one_message(tmp_path):
    """Bytes that are changed anywhere give a map or one message; changed compressed data raise zlib.error."""
    path = tmp_path / "map.npz"
    write_crash_map(path, mapped(WallCar(hole=HOLE), []))
    sound, generator = path.read_bytes(), np.random.default_rng(1)
    refused = 0
    for _ in range(200):
        damaged = bytearray(sound)
        start = int(generator.integers(len(sound)))
        damaged[start : start + 20] = generator.bytes(len(damaged[start : start + 20]))
        path.write_bytes(damaged)
        with suppress(InputError):
            read_crash_map(path)
            continue
        refused += 1
    assert refused > 150
    path.write_bytes(sound[: len(sound) // 2])
    with pytest.raises(InputError, match="a crash map"):
        read_crash_map(path)


class NeverCloser:
    """Keeps the range at which it was cut in on."""

    def simulate(self, lead_speed, range_, closing_speed):
        return Outcomes(np.zeros(range_.shape, bool), range_, range_ / closing_speed, 0 * range_)


@pytest.mark.parametrize("divided", [True, False])
def test_short_ranges_are_resolved_where_nothing_crashes(divided, monkeypatch):
    if not divided:  # as where cells are divided for crashes alone
        monkeypatch.setattr(mapping, "_parts", lambda coarse, _: np.ones((8, 40), int))
    car, near, errors = NeverCloser(), CUT_IN.event("min_range", 2), []
    law = law_of(RANGE_LAWS["pareto"], TTC_LAWS["exponential"])
    records = np.column_stack([np.linspace(5, 14.9, 99), np.full(99, 30), np.ones(99)])
    exact = np.exp(RANGE_LAWS["pareto"].logsf(1 / 2))
    for seed in range(8):
        way = Map(map_crashes(car, FINER, [near], seed), records)
        answer = evaluate(Problem(CUT_IN, car, near), law, way, generator=seed)
        errors.append(answer.posterior.probability / exact - 1)
    assert (np.std(errors) < 0.02) == divided
