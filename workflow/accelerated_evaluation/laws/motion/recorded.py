"""Laws of lead motion from recorded speed profiles: resampled, or smooth with the same statistics."""

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.compiling import cached_njit
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.linear_systems import solve
from accelerated_evaluation.base.tables import column_of_numbers, read_parquet, require_file
from accelerated_evaluation.laws.motion import COURSE_COLUMN, LONGEST, MOTIONS, STATES, STEP, course_columns
from accelerated_evaluation.records.ingest import FASTEST

NAMES = ("lead_speed", "range", "closing_speed")
FEWEST = 10  # smallest number of recorded profiles
BELOW_ONE = 1 - 1e-12
FEATURES = 3  # lead speed, logarithm of the range and closing speed
NEWTON_STEPS = 5  # after which the balance has converged, in nearly all places
SMALLEST_STEP = 1e-7  # relative to the farthest neighbour; the next step of Newton would be its square
FASTEST_CHANGE = 10.0  # [m/s^2]: tyres do not transmit more
MEASURED = 5.0  # [m/s], difference of two speeds that errors of measurement may add
AWAY = 100.0  # [m/s], speed that is assigned to a car that has left the lane, so that it cannot be hit


@MOTIONS.add("recorded")
@dataclass(frozen=True)
class Recorded:
    """Speed profiles of recorded cut-ins that are similar to the encounter at the time of the lane change.

    The distance of two cut-ins is Euclidean in lead speed, logarithm of the range and closing speed, each
    divided by its standard deviation. One of the nearest n^(4/7) of n recorded cut-ins is selected; this
    order minimizes the error of a nearest-neighbour mean of three variables (Mack 1981, SIAM Journal on
    Algebraic and Discrete Methods 2, 311-323). The probabilities of the selection are proportional to tricube
    weights, which decrease to zero with the distance and are then balanced (see `_balanced`), so that the
    neighbours of a critical cut-in, most of which are less critical, do not bias the law. The only input
    selects a cut-in in the order of the mean change of speed, from the hardest braking at 0 to the strongest
    acceleration at 1. The change of speed over time is that of the selected cut-in. Negative speeds are
    replaced by 0.
    """

    inputs: ClassVar[int] = 1

    encounters: Array = field(repr=False)  # lead speed [m/s], range [m] and closing speed [m/s], (3, n)
    # Lead speeds over time [m/s], (n, STATES); `AWAY` after the car has left the lane.
    courses: Array = field(repr=False)
    _changes: Array = field(init=False, repr=False)  # of the speeds since the lane change, (n, STATES)
    _scale: Array = field(init=False, repr=False)
    _tree: cKDTree = field(init=False, repr=False)
    _rank: NDArray[np.int_] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        count = len(np.unique(np.vstack([self.encounters, self.courses.T]), axis=1).T)
        if count < FEWEST:
            raise InputError(
                "recorded courses",
                seen=f"{self.encounters.shape[1]} cut-ins, {count} of them different",
                expected=f"at least {FEWEST} different ones",
                change="Add cut-ins with courses, or use the lead motion ngsim.",
            )
        if (self.courses[:, 1] == AWAY).all():
            raise InputError(
                "recorded courses",
                seen="no speed after the crossing in any cut-in",
                expected="the speeds of the other cars until they leave the lane",
                change="Correct the columns of speeds, or use the lead motion ngsim.",
            )
        features = _features(self.encounters)
        # Not where the standard deviation is 0, because that of equal numbers is not always exactly 0.
        scale = np.where(np.ptp(features, axis=0) == 0, 1.0, features.std(axis=0))
        changes = self.courses - self.courses[:, :1]
        object.__setattr__(self, "_changes", changes)
        object.__setattr__(self, "_scale", scale)
        object.__setattr__(self, "_tree", cKDTree(features / scale))
        object.__setattr__(self, "_rank", np.argsort(np.argsort(changes.mean(axis=1), kind="stable")))

    @classmethod
    def of(cls, table: pd.DataFrame, where: str = "recorded courses") -> Self:
        """Return the law of a table with ``lead_speed``, ``range``, ``closing_speed`` and speed profiles.

        InputError is raised if there are fewer than `FEWEST` cut-ins, if a column is
        the same in all of them, or as for `recorded_courses`. The table is called ``where`` in errors.
        """
        encounters = _numbers(table[list(NAMES)], where).T
        low, high = np.array([[0.0, np.finfo(float).tiny, -FASTEST], [FASTEST, np.inf, FASTEST]])[:, :, None]
        possible = np.isfinite(encounters) & (encounters >= low) & (encounters <= high)
        if not possible.all():
            name, row = np.argwhere(~possible)[0]
            raise InputError(
                f"{where}, cut-in {row}, column {NAMES[name]}",
                seen=f"{encounters[name, row]:g}",
                expected="a lead speed of 0 m/s or more, a finite range above 0 m, and speeds up to "
                f"{FASTEST:g} m/s",
                change="Correct this cut-in, or leave it out.",
            )
        motion = cls(encounters, recorded_courses(table, where))
        if (constant := np.ptp(encounters, axis=1) == 0).any():
            k = int(np.argmax(constant))
            raise InputError(
                f"{where}, column {NAMES[k]}",
                seen=f"{encounters[k, 0]:g} in all {encounters.shape[1]} cut-ins",
                expected="different values, because cut-ins with similar values are drawn",
                change="Use the values as they were measured, or use the lead motion ngsim.",
            )
        return motion

    @classmethod
    def read(cls, path: str | os.PathLike) -> Self:
        """Return the law of the cut-ins with speed profiles in a Parquet file; columns are those of `of`."""
        require_file(path, "Name a Parquet file of cut-ins with courses.")
        return cls.of(read_parquet(path, {name: name for name in NAMES}), str(path))

    def resampled(self, generator: np.random.Generator) -> Self:
        """Return the law of as many cut-ins, which are drawn from the recorded ones with replacement."""
        chosen = generator.integers(len(self.courses), size=len(self.courses))
        return type(self)(self.encounters[:, chosen], self.courses[chosen])

    @property
    def neighbours(self) -> int:
        """Number of nearest recorded cut-ins from which one is selected."""
        return math.ceil(len(self.courses) ** (4 / 7))

    def lead_speeds(self, encounters: Array, inputs: Array) -> Array:
        """Return the lead speeds [m/s] of n encounters at 0, 0.1, ..., 8 s, shape (n, 81).

        ``encounters`` contains lead speed [m/s], range [m] and closing speed [m/s] at the lane change, shape
        (3, n), and ``inputs`` contains uniform random numbers on [0, 1], shape (n, 1).
        """
        is_new = np.ones(encounters.shape[1], dtype=bool)
        is_new[1:] = (encounters[:, 1:] != encounters[:, :-1]).any(axis=0)
        near, ends = self._neighbours_of(encounters[:, is_new])
        which = np.cumsum(is_new) - 1  # repeats of the encounter before share its neighbours
        chosen = (np.minimum(inputs, BELOW_ONE)[:, :1] * ends[which, -1:] >= ends[which]).sum(axis=1)
        speeds = self._changes[near[which, chosen]]
        speeds += encounters[0][:, None]
        return np.maximum(speeds, 0.0, out=speeds)

    def _neighbours_of(self, encounters: Array) -> tuple[NDArray[np.intp], Array]:
        """Return the neighbours of encounters by rising change of speed, and their cumulative weights.

        Both have the shape (n, neighbours + 1).
        """
        # The weight of the farthest neighbour is zero, so that the law is continuous in the encounter.
        places = _features(encounters) / self._scale
        distance, near = self._tree.query(places, self.neighbours + 1)
        farthest = np.maximum(distance[:, -1:], np.finfo(float).tiny)
        offsets = (self._tree.data[near] - places[:, None]) / farthest[:, :, None]
        weights = (1 - (distance / farthest) ** 3) ** 3
        weights[~weights.any(axis=1)] = 1.0  # all neighbours are equally far, as repeated cut-ins may be
        order = np.argsort(self._rank[near], axis=1)
        weights = np.take_along_axis(_balanced(weights, offsets), order, axis=1)
        return np.take_along_axis(near, order, axis=1), weights.cumsum(axis=1)


@cached_njit()
def _balanced(weights: Array, offsets: Array) -> Array:
    """Return weights of neighbours whose mean is nearly the place of which they are neighbours.

    Near the edge of the records, most neighbours lie on one side. If they are weighted by distance alone,
    their mean is another place, and the law is biased towards the motion there. The balanced weights differ
    from the given ones by an exponential factor. No weights of mean offset zero are nearer to the given ones
    in relative entropy. Such a law is as little biased at the edge as a local linear regression, but its
    weights are not negative (Hall, Wolff and Yao 1999, Journal of the American Statistical Association 94,
    154-163).

    The mean of m neighbours varies by 1/m of their variance even if they lie on all sides. The balance
    ignores offsets of this size. For this, it has a ridge of 1/m, where m is the effective number of
    neighbours. The weights have the shape (n, k). The offsets, neighbours minus place, are relative to the
    distance of the farthest neighbour, shape (n, k, 3).
    """
    rows, neighbours = weights.shape
    shares, spread, mean = np.empty_like(weights), np.empty((FEATURES, FEATURES)), np.empty(FEATURES)
    for row in range(rows):
        own, place, tilt = shares[row], offsets[row], np.zeros(FEATURES)
        own[:] = weights[row] / weights[row].sum()
        ridge = (own**2).sum()
        for _ in range(NEWTON_STEPS):
            mean[:], spread[:] = 0.0, 0.0
            for near in range(neighbours):
                for one in range(FEATURES):
                    part = own[near] * place[near, one]
                    mean[one] += part
                    for two in range(one + 1):
                        spread[one, two] += part * place[near, two]
            for one in range(FEATURES):
                for two in range(one + 1):
                    spread[one, two] -= mean[one] * mean[two]
                    spread[two, one] = spread[one, two]
                spread[one, one] += ridge
            step = mean + ridge * tilt
            solve(spread, step)
            tilt -= step
            for near in range(neighbours):
                own[near] = 0.0
                for one in range(FEATURES):
                    own[near] += place[near, one] * tilt[one]
            largest, total = own.max(), 0.0
            for near in range(neighbours):
                own[near] = weights[row, near] * math.exp(own[near] - largest)
                total += own[near]
            own /= total
            if np.abs(step).max() < SMALLEST_STEP:
                break
    return shares


def recorded_courses(
    table: pd.DataFrame, where: str = "recorded courses", rows: Sequence[str] | None = None
) -> Array:
    """Return the recorded lead speeds [m/s] of n cut-ins at 0, 0.1, ..., 8 s, shape (n, 81).

    A column such as ``speed_0.2`` contains the speed of the lead vehicle [m/s] 0.2 s after the lane change.
    The columns reach 8 s or more, and speeds in between are interpolated. Cells after the time when the lead
    vehicle left the lane again are empty; the vehicle then gets the speed `AWAY` (100 m/s), so that it cannot
    be hit. InputError is raised if the columns do not cover 8 s (`course_columns`), or if a speed is
    negative, infinite, follows an empty cell, or differs from the one before it by more than a car can change
    its speed. ``where`` and ``rows`` name the table and its rows in errors.
    """
    names = course_columns(table.columns, where)
    if not names:
        raise InputError(
            f"{where}, columns speed_...",
            seen="no such columns",
            expected=f"columns such as speed_0.2, up to {LONGEST:g} s",
            change="Add the speeds of the other cars after the lane crossing.",
        )
    states = np.arange(STATES) * STEP
    times = np.array([0.0, *(float(COURSE_COLUMN.fullmatch(name)[1]) for name in names[1:])])
    courses = _numbers(table[names], where)
    rows = [f"cut-in {row}" for row in range(len(table))] if rows is None else rows
    _require_courses(courses, times, names, where, rows)
    last = np.isfinite(courses).sum(axis=1) - 1
    rows = np.arange(len(courses))[:, None]
    courses = courses[rows, np.minimum(np.arange(times.size), last[:, None])]
    low = np.minimum(np.searchsorted(times, states + STEP / 1000, side="right") - 1, times.size - 2)
    part = np.clip((states - times[low]) / (times[low + 1] - times[low]), 0.0, 1.0)
    speeds = courses[:, low] + (courses[:, low + 1] - courses[:, low]) * part
    speeds[states > times[last][:, None] + STEP / 2] = AWAY
    return speeds


def _numbers(table: pd.DataFrame, where: str) -> Array:
    """Return columns as floats, with nan for empty cells; raise InputError if a cell is not a number."""

    def place(row: int) -> str:
        return f"{where}, cut-in {row}"

    return np.column_stack(
        [column_of_numbers(table[name], place, "Correct this cell.", may_be_empty=True) for name in table]
    )


def _require_courses(courses: Array, times: Array, names: list[str], where: str, rows: Sequence[str]) -> None:
    """Raise InputError if a speed is impossible, missing at 0 s, or follows an empty cell."""
    empty = np.isnan(courses)
    wrong = np.isinf(courses) | (courses < 0)
    wrong[:, 0] |= empty[:, 0]
    wrong[:, 1:] |= empty[:, :-1] & ~empty[:, 1:]
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        raise InputError(
            f"{where}, {rows[row]}, column {names[column]}",
            seen=f"{courses[row, column]:g}",
            expected="a speed of 0 m/s or more, and no speed after an empty cell",
            change="Correct the course of this cut-in, or leave it out.",
        )
    jumps = is_jump(courses, times)
    if jumps.any():
        row, column = np.argwhere(jumps)[0]
        before, after = courses[row, column : column + 2]
        raise InputError(
            f"{where}, {rows[row]}, columns {names[column]} and {names[column + 1]}",
            seen=f"{before:g} and {after:g} m/s, {times[column + 1] - times[column]:.3g} s apart",
            expected=f"a change of at most {FASTEST_CHANGE:g} m/s², and {MEASURED:g} m/s for errors",
            change="Correct the speeds. Are they in km/h, or are the times not in seconds?",
        )


def is_jump(courses: Array, times: Array) -> NDArray[np.bool_]:
    """Return where speeds [m/s], shape (n, k), change faster than a car's until the next of k times [s]."""
    return np.abs(np.diff(courses, axis=1)) > MEASURED + FASTEST_CHANGE * np.diff(times)


def _features(encounters: Array) -> Array:
    """Return lead speed, logarithm of the range and closing speed, shape (n, 3)."""
    lead_speed, range_, closing_speed = encounters
    return np.column_stack([lead_speed, np.log(range_), closing_speed])
