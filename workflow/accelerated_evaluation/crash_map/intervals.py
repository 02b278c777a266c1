"""Intervals of one variable in which events happen, found along lines by simulations and bisection."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.scenarios.events import Event

HALVINGS = 10  # number of bisections of a step of the scan
ENCOUNTERS_AT_ONCE = 500_000  # number of encounters that are simulated at once, which need about 100 MB
# Largest number of changes of an event on a line whose ends are refined. In many narrow stripes, bisection
# moves the ends so that what prevails seems to prevail even more; halfway between points is right on average.
CLEAN = 4


@dataclass(frozen=True)
class Intervals:
    """The intervals of the variable in which an event happens, ordered by line and within lines."""

    line: NDArray[np.int32]  # index of the line of each interval, (n,)
    start: Array  # in the unit of the variable, (n,)
    end: Array  # excluded, (n,); infinite if the event is assumed to happen at all larger values


def in_batches(
    lines: int, points: int, find: Callable[[NDArray], dict[Event, Intervals]], progress: str | None = None
) -> dict[Event, Intervals]:
    """Return the intervals of each event on all lines, which a function finds for the indices of a few.

    ``points`` is the number of simulations on each line, which limits the lines of a batch.
    """
    size = max(1, ENCOUNTERS_AT_ONCE // points)
    firsts = tqdm(
        range(0, lines, size), desc=progress, unit=" batches", leave=False, disable=progress is None
    )
    parts = [find(np.arange(first, min(first + size, lines))) for first in firsts]
    return {
        event: Intervals(
            np.concatenate([part[event].line for part in parts]).astype(np.int32),
            *(np.concatenate([getattr(part[event], end) for part in parts]) for end in ("start", "end")),
        )
        for event in parts[0]
    }


def intervals_on(
    lines: NDArray[np.intp],
    values: Array,
    outcomes: Any,  # noqa: ANN401
    events: Sequence[Event],
    ends: tuple[float, float],
    simulate: Callable[[NDArray[np.intp], Array], Any],
) -> dict[Event, Intervals]:
    """Return the intervals of events on some lines, from outcomes at rising values, shape (lines, points).

    An interval with the first or the last value reaches to the corresponding one of the ``ends``. All events
    are refined at once, by simulations at values on the lines with given indices.
    """
    happened = np.array([event.happens(outcomes).reshape(values.shape) for event in events])
    happened = np.pad(happened, [(0, 0), (0, 0), (1, 1)])
    event, row, column = np.nonzero(happened[..., 1:] != happened[..., :-1])  # begins and ends alternate
    border = np.where(column == 0, *ends)
    inside = np.flatnonzero((column > 0) & (column < values.shape[1]))
    place = (event * len(lines) + row)[inside]
    clean = np.bincount(place, minlength=1)[place] <= CLEAN
    refined = inside[clean]
    left, right = (values[row, np.clip(column - 1 + side, 0, values.shape[1] - 1)] for side in (0, 1))
    for _ in range(HALVINGS if refined.size else 0):
        middle = (left[refined] + right[refined]) / 2
        outcomes = simulate(lines[row[refined]], middle)
        flags = np.array([each.happens(outcomes) for each in events])
        before = flags[event[refined], np.arange(refined.size)] == (refined % 2 == 1)
        left[refined[before]], right[refined[~before]] = middle[before], middle[~before]
    border[inside] = ((left + right) / 2)[inside]
    return {
        each: Intervals(lines[row[own][::2]], border[own][::2], border[own][1::2])
        for each, own in ((each, event == k) for k, each in enumerate(events))
    }
