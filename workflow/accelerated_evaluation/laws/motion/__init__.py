"""Laws of lead motion: probability distributions of the speed of the lead vehicle after the lane change."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import ClassVar, Protocol

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.registry import Registry

STEP = 0.1  # [s], time between two lead speeds
STATES = 81  # number of lead speeds of an encounter: 8 s, for which the car under test is simulated
LONGEST = (STATES - 1) * STEP  # [s]
COURSE_COLUMN = re.compile(r"speed_(\d+\.?\d*)")  # name of a column of lead speeds, with the time [s]
SIMILAR_COLUMN = re.compile(r"(speed|lead.?speed.?[\d.-]).*", re.IGNORECASE)  # a name that may be misspelt
# Columns of a table with the lead speeds after the crossing [m/s]: speed_0.1, speed_0.2, ..., speed_8.0.
SPEED_COLUMNS = tuple(f"speed_{STEP * state:.1f}" for state in range(1, STATES))
RAREST = 1e-4  # smallest distance of an input from 0 or 1 that `draw_wide_inputs` samples preferentially
LARGEST_WEIGHT = 2.0  # largest importance weight of a draw of `draw_wide_inputs`


def course_columns(names: Iterable[str], where: str) -> list[str]:
    """Return ``lead_speed`` and the columns ``speed_0.1``, ... of a table, in the order of their times [s].

    The list is empty if no name begins with ``speed``. InputError is raised if such a name has no time, if
    two names have the same time, or if the times do not cover 8 s in intervals of at most 8 s.
    """
    similar = [name for name in map(str, names) if SIMILAR_COLUMN.fullmatch(name)]
    wrong = [name for name in similar if not COURSE_COLUMN.fullmatch(name)]
    if wrong:
        raise _course_error(
            where, repr(wrong[0]), "columns of lead speeds named speed_0.1, speed_0.2, ... [s]"
        )
    times = sorted((float(COURSE_COLUMN.fullmatch(name)[1]), name) for name in similar)
    if not times:
        return []
    for (earlier, first), (later, second) in pairwise([(0.0, "lead_speed"), *times]):
        if later == earlier:
            raise _course_error(where, f"{first} and {second}", "one column for each time")
        if later - earlier > LONGEST:
            seen = f"no column between {earlier:g} and {later:g} s"
            raise _course_error(where, seen, f"times in seconds, at most {LONGEST:g} s apart")
    if times[-1][0] < LONGEST - STEP / 2:
        seen, expected = f"speeds up to {times[-1][0]:g} s", f"columns such as speed_0.2, up to {LONGEST:g} s"
        raise _course_error(where, seen, expected)
    return ["lead_speed", *(name for _, name in times)]


def _course_error(where: str, seen: str, expected: str) -> InputError:
    """Return the error for columns of lead speeds that cannot be used."""
    change = "Correct the columns of lead speeds over time, and rename other columns that begin with speed."
    return InputError(f"{where}, columns speed_...", seen=seen, expected=expected, change=change)


class LeadMotion(Protocol):
    """A law of lead motion: lead speeds over time as a function of a few uniform random inputs on [0, 1]."""

    inputs: int  # number of inputs

    def lead_speeds(self, encounters: Array, inputs: Array) -> Array:
        """Return the lead speeds [m/s] at 0, 0.1, ..., 8 s for n encounters, shape (n, 81).

        The encounters are lead speed [m/s], range [m] and closing speed [m/s] at the lane change, shape (3,
        n), and the inputs have the shape (n, inputs). The speeds are not negative, and the first one is that
        of the encounter.
        """


MOTIONS: Registry[type[LeadMotion]] = Registry(
    "lead motion", __package__, [str(Path(__file__).parent)], contract=[LeadMotion]
)


def draw_lead_speeds(motion: LeadMotion, encounters: Array, generator: np.random.Generator) -> Array:
    """Draw the lead speeds [m/s] at 0, 0.1, ..., 8 s for encounters of shape (3, n), in shape (n, 81)."""
    return motion.lead_speeds(encounters, generator.random((encounters.shape[1], motion.inputs)))


def draw_wide_inputs(motion: LeadMotion, size: int, generator: np.random.Generator) -> tuple[Array, Array]:
    """Draw inputs of a law of lead motion such that extreme inputs are more frequent than under the law.

    Half of the draws are from the law. In the other half, one input is chosen at random, and the logarithm of
    its distance from 0 or from 1 is uniform. The function returns the inputs, shape (size, inputs), and their
    importance weights (density of the law over density of the draws), which are at most `LARGEST_WEIGHT`.
    """
    inputs = generator.random((size, motion.inputs))
    if not motion.inputs:
        return inputs, np.ones(size)
    distance = 0.5 * (2 * RAREST) ** generator.random(size)  # log-uniform from RAREST to 0.5
    extreme = np.where(generator.random(size) < 0.5, distance, 1 - distance)
    chosen = np.arange(motion.inputs) == generator.integers(motion.inputs, size=size)[:, None]
    is_wide = generator.random(size) < 0.5
    inputs = np.where(chosen & is_wide[:, None], extreme[:, None], inputs)
    return inputs, 1 / wide_density(inputs)


def wide_density(inputs: Array) -> Array:
    """Return the density of the inputs of `draw_wide_inputs`, (n, inputs), over that of the law, (n,)."""
    if not inputs.shape[1]:
        return np.ones(len(inputs))
    nearest = np.minimum(inputs, 1 - inputs)
    density = np.where(nearest >= RAREST, 0.5 / np.maximum(nearest, RAREST) / -np.log(2 * RAREST), 0.0)
    return 0.5 + 0.5 * density.mean(axis=1)


@MOTIONS.add("constant")
@dataclass(frozen=True)
class ConstantSpeed:
    """Law of lead motion without random inputs: the lead vehicle keeps its speed."""

    inputs: ClassVar[int] = 0

    def lead_speeds(self, encounters: Array, inputs: Array) -> Array:
        """Return the lead speeds [m/s] at 0, 0.1, ..., 8 s, which are constant, shape (n, 81).

        The first row of ``encounters``, shape (3, n), contains the lead speeds. ``inputs`` is not used.
        """
        return np.repeat(encounters[0][:, None], STATES, axis=1)
