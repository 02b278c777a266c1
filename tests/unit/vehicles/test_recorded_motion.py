"""Lead motion drawn from recorded courses: distributions that are known, and courses that cannot be used."""

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws.motion import MOTIONS, STATES, STEP, draw_lead_speeds
from accelerated_evaluation.laws.motion.recorded import AWAY, NAMES, Recorded, _balanced, recorded_courses
from accelerated_evaluation.vehicles.lead_motion import lead_speeds_of
from scipy.optimize import minimize

TIMES = STEP * np.arange(STATES)
SIZE, NOISE = 4000, 0.5


def braking(encounters):
    """Return the mean deceleration [m/s^2] of the cut-ins below: harder where the range is short."""
    return 2.0 - 0.5 * np.log(encounters[1])


def recorded(size=SIZE, seed=1):
    """Return cut-ins whose lead vehicles brake with a normal deceleration."""
    generator = np.random.default_rng(seed)
    encounters = generator.uniform((20, 5, -5), (30, 70, 10), (size, 3)).T
    deceleration = generator.normal(braking(encounters), NOISE)
    return encounters, encounters[0][:, None] - deceleration[:, None] * TIMES


def decelerations(motion, encounter, size=20_000):
    """Draw the decelerations after a given encounter."""
    encounters = np.repeat(np.array(encounter, dtype=float)[:, None], size, axis=1)
    speeds = draw_lead_speeds(motion, encounters, np.random.default_rng(2))
    return (encounter[0] - speeds[:, 50]) / TIMES[50]


@pytest.mark.parametrize("range_", [10, 20, 60])
def test_the_distribution_depends_on_the_range_as_in_the_records(range_):
    motion, encounter = Recorded(*recorded()), np.array([25, range_, 2.0])
    found = decelerations(motion, encounter)
    error = NOISE / np.sqrt(motion.neighbours / 2)  # the tricube weights count about half of the neighbours
    assert found.mean() == pytest.approx(braking(encounter), abs=4 * error)
    assert found.std() == pytest.approx(NOISE, abs=4 * error)


def test_a_law_that_ignores_the_range_would_fail():
    encounters, courses = recorded()
    ignoring = Recorded(np.roll(encounters, 7, axis=1), courses)
    assert abs(decelerations(ignoring, [25, 10, 2]).mean() - braking([25, 10, 2])) > 0.3


def test_the_input_orders_the_courses_from_the_hardest_braking():
    motion = Recorded(*recorded())
    encounters = np.repeat([[25.0], [20.0], [2.0]], 101, axis=1)
    ends = motion.lead_speeds(encounters, np.linspace(0, 1, 101)[:, None])[:, -1]
    assert (np.diff(ends) >= 0).all()
    assert ends[-1] - ends[0] > 2 * NOISE * 8


def test_repeated_encounters_move_as_each_of_them_alone():
    motion, generator = Recorded(*recorded()), np.random.default_rng(3)
    distinct = generator.uniform((20, 5, -5), (30, 70, 10), (5, 3)).T
    encounters, inputs = distinct[:, [0, 0, 3, 1, 1, 1, 4, 0, 2]], generator.random((9, 1))
    alone = [motion.lead_speeds(encounters[:, [k]], inputs[[k]])[0] for k in range(9)]
    np.testing.assert_allclose(motion.lead_speeds(encounters, inputs), alone, rtol=1e-12)
    assert not np.allclose(alone[0], alone[1])  # equal encounters with other inputs


def test_speeds_begin_with_the_lead_speed_and_are_not_negative():
    motion = Recorded(*recorded())
    encounters = np.random.default_rng(3).uniform((0, 1, -10), (40, 150, 20), (2000, 3)).T
    speeds = draw_lead_speeds(motion, encounters, np.random.default_rng(4))
    np.testing.assert_array_equal(speeds[:, 0], encounters[0])
    assert speeds.min() == 0


def test_equal_cut_ins_have_equal_probabilities():
    encounters = np.repeat([[20.0], [20.0], [0.0]], 12, axis=1)
    motion = Recorded(encounters, 20.0 + np.arange(12)[:, None] * TIMES)
    found, count = motion.neighbours + 1, 6000
    levels = (np.arange(count)[:, None] + 0.5) / count
    ends = motion.lead_speeds(np.repeat(encounters[:, :1], count, axis=1), levels)[:, -1]
    assert np.unique(ends, return_counts=True)[1].tolist() == [count // found] * found


def table(courses, seconds):
    """Return a table of cut-ins with courses."""
    columns = pd.DataFrame(np.atleast_2d(courses), columns=[f"speed_{second}" for second in seconds])
    return columns.assign(lead_speed=20.0, range=30.0, closing_speed=1.0)


def test_courses_are_interpolated_and_a_car_that_left_drives_away():
    courses = recorded_courses(table([[22, 30], [22, np.nan]], ["2.0", "10"]))
    np.testing.assert_allclose(courses[0], 20 + TIMES, atol=1e-9)
    np.testing.assert_allclose(courses[1, :21], 20 + TIMES[:21], atol=1e-9)
    assert (courses[1, 21:] == AWAY).all()


def test_courses_in_a_file_are_a_law(tmp_path):
    encounters, courses = recorded(50)
    rows = table(courses[:, 1:], [f"{time:.1f}" for time in TIMES[1:]])
    rows[list(NAMES)] = encounters.T
    rows.to_parquet(tmp_path / "courses.parquet")
    motion = MOTIONS["recorded"].read(tmp_path / "courses.parquet")
    np.testing.assert_allclose(motion.courses, courses, atol=1e-9)
    drawn = lead_speeds_of(str(tmp_path / "courses.parquet"), np.array([25, 20, 1]), np.random.default_rng(5))
    assert np.abs(courses - courses[:, :1] - (drawn - 25)).max(axis=1).min() < 1e-9


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (table([22], ["2.0"]), r"columns speed_\.\.\.: seen speeds up to 2 s"),
        (table([[22], [-1]], ["8"]), "cut-in 1, column speed_8: seen -1"),
        (table([22, np.inf], ["4", "8"]), "column speed_8: seen inf"),
        (table([np.nan, 22], ["4", "8"]), "column speed_8: seen 22; .* no speed after an empty cell"),
        (table([22], ["8"]).assign(lead_speed=np.nan), "column lead_speed: seen nan"),
        (table([[22]] * 3, ["8"]), "seen 3 cut-ins, 1 of them different; expected at least 10"),
        (table([22], ["8"]).assign(range=0.0), "column range: seen 0; expected .* a finite range above 0 m"),
        (table([22], ["8"]).assign(range=-3.0), "column range: seen -3"),
        (table([22], ["8"]).assign(range=np.nan), "column range: seen nan"),
        (table([22], ["8"]).assign(closing_speed=np.nan), "column closing_speed: seen nan"),
        (table([22], ["8"]).assign(closing_speed="slow"), "column closing_speed: seen 'slow'; .* a number"),
        (table([22], ["8"]).assign(speed_8="fast"), "column speed_8: seen 'fast'; expected a number"),
        (
            table([72], ["0.1"]).assign(speed_8=72),
            "lead_speed and speed_0.1: seen 20 and 72 m/s, 0.1 s apart",
        ),
    ],
)
def test_courses_that_cannot_be_used(rows, message):
    with pytest.raises(InputError, match=message):
        Recorded.of(rows)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        Recorded.read(tmp_path / "courses.parquet")


def test_near_the_edge_of_the_records_neighbours_on_one_side_do_not_bias_the_law():
    """The neighbours of the shortest range have longer ranges, after which the lead vehicle brakes less."""
    encounters, _ = recorded(500)
    edge = np.array([25.0, encounters[1].min(), 2.0])
    expected = braking(edge)
    motion = Recorded(encounters, encounters[0][:, None] - braking(encounters)[:, None] * TIMES)
    balanced = decelerations(motion, edge).mean()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("accelerated_evaluation.laws.motion.recorded._balanced", lambda weights, _: weights)
        one_sided = decelerations(motion, edge).mean()
    assert one_sided < expected - 0.1
    assert abs(balanced - expected) < 0.7 * abs(one_sided - expected)


def test_balanced_weights_are_those_of_the_smallest_relative_entropy():
    """They differ from the given weights by an exponential factor, and minimize a convex function."""
    generator = np.random.default_rng(6)
    offsets = generator.uniform(-0.2, 0.8, (5, 40, 3))
    given = generator.uniform(0, 1, (5, 40))
    shares = _balanced(given, offsets)
    np.testing.assert_allclose(shares.sum(axis=1), 1)
    for weights, found, places in zip(given, shares, offsets, strict=True):
        ridge = (weights**2).sum() / weights.sum() ** 2

        def dual(tilt, weights=weights, places=places, ridge=ridge):
            return np.log(weights @ np.exp(places @ tilt)) + ridge * tilt @ tilt / 2

        tilt = minimize(dual, np.zeros(3), tol=1e-10).x
        expected = weights * np.exp(places @ tilt)
        np.testing.assert_allclose(found, expected / expected.sum(), rtol=1e-3)
        assert np.linalg.norm(found @ places) < 0.5 * np.linalg.norm(weights @ places / weights.sum())


def test_far_from_all_records_the_law_is_that_of_the_nearest_ones():
    motion = Recorded(*recorded())
    found = draw_lead_speeds(motion, np.array([[300.0], [1e-3], [200.0]]), np.random.default_rng(7))
    assert np.isfinite(found).all()
