"""Lead motion resampled from the recorded courses of similar cut-ins."""

import math
import os
from dataclasses import dataclass, field
from typing import ClassVar, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.tables import read_parquet, require_file
from accelerated_evaluation.laws.motion import COURSE_COLUMN, MOTIONS, STATES, STEP

NAMES = ("lead_speed", "range", "closing_speed")
FEWEST = 10  # courses from which others are drawn
BELOW_ONE = 1 - 1e-12
AWAY = 100.0  # [m/s], speed of a car that has left the lane, which nobody can hit


@MOTIONS.add("recorded")
@dataclass(frozen=True)
class Recorded:
    """Courses of recorded cut-ins that were similar when the other car crossed the lane marking.

    Two cut-ins are similar if their lead speeds, logarithms of the range and closing speeds are, each divided
    by its standard deviation. Of n recorded cut-ins the nearest n^(4/7) are used. With this order the error
    of a nearest-neighbour mean of three variables is smallest (Mack 1981, SIAM Journal on Algebraic and
    Discrete Methods 2, 311-323). Their tricube weights decrease to zero with the distance. The only input
    orders them by their mean change of speed, from the hardest braking at 0 to the strongest acceleration at
    1. The change of speed over time is that of the selected course, and speeds end at 0.

    Attributes
    ----------
    encounters
        Lead speed [m/s], range [m] and closing speed [m/s] of the recorded cut-ins, shape (3, n).
    courses
        Their lead speeds over time [m/s], shape (n, STATES); `AWAY` from the moment when a car has left the
        lane.
    """

    inputs: ClassVar[int] = 1

    encounters: Array = field(repr=False)
    courses: Array = field(repr=False)
    _scale: Array = field(init=False, repr=False)
    _tree: cKDTree = field(init=False, repr=False)
    _rank: NDArray[np.int_] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if (count := self.encounters.shape[1]) < FEWEST:
            raise InputError(
                "recorded courses",
                seen=f"{count} cut-ins",
                expected=f"at least {FEWEST}",
                change="Add cut-ins with courses, or use the lead motion ngsim.",
            )
        features = _features(self.encounters)
        scale = features.std(axis=0)
        scale[scale == 0] = 1.0
        change = (self.courses - self.courses[:, :1]).mean(axis=1)
        object.__setattr__(self, "_scale", scale)
        object.__setattr__(self, "_tree", cKDTree(features / scale))
        object.__setattr__(self, "_rank", np.argsort(np.argsort(change, kind="stable")))

    @classmethod
    def of(cls, table: pd.DataFrame, where: str = "recorded courses") -> Self:
        """Return the law of a table of cut-ins with courses; see `recorded_courses` for its columns."""
        return cls(table[list(NAMES)].to_numpy(dtype=float).T, recorded_courses(table, where))

    @classmethod
    def read(cls, path: str | os.PathLike) -> Self:
        """Return the law of the cut-ins in a Parquet file; see `recorded_courses` for its columns."""
        require_file(path, "Name a Parquet file of cut-ins with courses.")
        return cls.of(read_parquet(path, {name: name for name in NAMES}), str(path))

    @property
    def neighbours(self) -> int:
        """Number of recorded cut-ins of which one is drawn."""
        return math.ceil(len(self.courses) ** (4 / 7))

    def lead_speeds(self, encounters: Array, inputs: Array) -> Array:
        """Return lead speeds over time; see `LeadMotion`."""
        # The weight of the last one is zero, so that the law is continuous in the encounter.
        distance, near = self._tree.query(_features(encounters) / self._scale, self.neighbours + 1)
        share = distance / np.maximum(distance[:, -1:], np.finfo(float).tiny)
        order = np.argsort(self._rank[near], axis=1)
        weights = np.take_along_axis((1 - share**3) ** 3, order, axis=1)
        ends = weights.cumsum(axis=1)
        chosen = (np.minimum(inputs, BELOW_ONE)[:, :1] * ends[:, -1:] >= ends).sum(axis=1)
        place = np.take_along_axis(order, chosen[:, None], axis=1)
        course = self.courses[np.take_along_axis(near, place, axis=1)[:, 0]]
        return np.maximum(encounters[0][:, None] + (course - course[:, :1]), 0.0)


def recorded_courses(table: pd.DataFrame, where: str = "recorded courses") -> Array:
    """Return the recorded lead speeds of cut-ins every 0.1 s [m/s], shape (n, STATES).

    Parameters
    ----------
    table
        ``lead_speed`` [m/s], and columns such as ``speed_0.2``: the speed of the other car [m/s] so many
        seconds after the crossing, up to 8 s or more. Speeds in between are interpolated. After the moment
        when the car left the lane again the cells are empty; it is then treated as if it drove away.
    where
        Place of the table, for the error.

    Raises
    ------
    InputError
        If the columns do not reach 8 s, a speed is negative or infinite, or a speed follows an empty cell.
    """
    names = [column for column in table.columns if COURSE_COLUMN.fullmatch(str(column))]
    names = ["lead_speed", *sorted(names, key=_seconds)]
    times, states = np.array([_seconds(name) for name in names]), np.arange(STATES) * STEP
    if times[-1] < states[-1] - STEP / 2:
        raise InputError(
            f"{where}, columns speed_...",
            seen=f"speeds up to {times[-1]:g} s",
            expected=f"columns such as speed_0.2, up to {states[-1]:g} s",
            change="Add the speeds of the other cars after the lane crossing.",
        )
    courses = table[names].to_numpy(dtype=float)
    _require_courses(courses, names, where)
    last = np.isfinite(courses).sum(axis=1) - 1
    rows = np.arange(len(courses))[:, None]
    courses = courses[rows, np.minimum(np.arange(times.size), last[:, None])]
    low = np.minimum(np.searchsorted(times, states + STEP / 1000, side="right") - 1, times.size - 2)
    part = np.clip((states - times[low]) / (times[low + 1] - times[low]), 0.0, 1.0)
    speeds = courses[:, low] + (courses[:, low + 1] - courses[:, low]) * part
    speeds[states > times[last][:, None] + STEP / 2] = AWAY
    return speeds


def _require_courses(courses: Array, names: list[str], where: str) -> None:
    """Refuse speeds that are missing at the crossing, negative or infinite, or that follow an empty cell."""
    empty = np.isnan(courses)
    wrong = np.isinf(courses) | (courses < 0)
    wrong[:, 0] |= empty[:, 0]
    wrong[:, 1:] |= empty[:, :-1] & ~empty[:, 1:]
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        raise InputError(
            f"{where}, cut-in {row}, column {names[column]}",
            seen=f"{courses[row, column]:g}",
            expected="a speed of 0 m/s or more, and no speed after an empty cell",
            change="Correct the course of this cut-in, or leave it out.",
        )


def _seconds(name: str) -> float:
    """Return the time of a column [s]; that of the lead speed is 0."""
    return 0.0 if name == "lead_speed" else float(COURSE_COLUMN.fullmatch(name)[1])


def _features(encounters: Array) -> Array:
    """Return lead speed, logarithm of the range and closing speed, shape (n, 3)."""
    lead_speed, range_, closing_speed = encounters
    return np.column_stack([lead_speed, np.log(range_), closing_speed])
