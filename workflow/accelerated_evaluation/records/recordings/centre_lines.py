"""Centre lines of lanes in a map, which are joined from pieces, and the lane in which a vehicle is."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    pass
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import product
from typing import Self

import numpy as np
from scipy.spatial import cKDTree

from accelerated_evaluation.base.arrays import Array

End = tuple[int, int]  # number of a piece, and 0 for its first or -1 for its last point
MEETING = 1.0  # [m], largest distance of the ends of two pieces that meet
SPACING = 0.5  # [m] between the points of a centre line to which vehicles are compared
REACH = 5.0  # [m] from a vehicle to the points that are considered; lanes are less than 8 m wide
FARTHEST = 1.25  # largest distance of a vehicle from the centre line of its lane, in half-widths of the lane
ALIGNED = np.cos(np.pi / 4)  # smallest |cosine| of the angle between a vehicle and its lane
USUAL_HALF_WIDTH = 1.75  # [m], of a lane whose width is unknown


@dataclass(frozen=True)
class Piece:
    """A piece of a lane in a map."""

    number: int
    line: Array  # points of the centre line [m], (n, 2); empty if it is unknown
    # Pieces that continue it at the first point, as the piece itself says.
    before: frozenset[int] = frozenset()
    after: frozenset[int] = frozenset()  # pieces that continue it at the last point
    # Half of the width of the lane at the points [m], (n,); empty if unknown.
    half_width: Array = field(default_factory=lambda: np.zeros(0))


def joined_lanes(pieces: Iterable[Piece]) -> dict[int, int]:
    """Return a mapping from the number of each piece to the smallest number of the pieces of its lane.

    Two ends continue each other if both pieces say so, or if one says so and the ends meet. Two pieces belong
    to one lane if each end has no other continuation. If a lane splits or lanes merge, a new lane begins,
    because it is undefined which of the lanes continues.
    """
    known = {piece.number: piece for piece in pieces}
    links: dict[End, set[End]] = defaultdict(set)
    for one, other in _continuations(known):
        links[one].add(other)
        links[other].add(one)
    joined: dict[int, int] = {}
    for first in sorted(known):
        if first not in joined:
            joined |= dict.fromkeys(_reached(first, links), first)
    return joined


def _continuations(known: Mapping[int, Piece]) -> Iterator[tuple[End, End]]:
    """Yield the pairs of ends that continue each other."""
    for one, piece in known.items():
        for side, others in ((0, piece.before), (-1, piece.after)):
            for other in (known[each] for each in others if each in known):
                mutual = [end for end, back in ((0, other.before), (-1, other.after)) if one in back]
                yield from (((one, side), (other.number, end)) for end in mutual)
                if not mutual and len(piece.line) and len(other.line):
                    away = np.hypot(*(other.line[[0, -1]] - piece.line[side]).T)
                    if away.min() <= MEETING:
                        yield (one, side), (other.number, -int(away.argmin()))


def _reached(number: int, links: Mapping[End, set[End]]) -> set[int]:
    """Return the pieces that belong to the same lane as the piece ``number``, including this piece."""
    found, waiting = {number}, [number]
    while waiting:
        for end in product([waiting.pop()], (0, -1)):
            others = links.get(end, ())
            for other in others:
                if len(others) == len(links[other]) == 1 and other[0] not in found:
                    found.add(other[0])
                    waiting.append(other[0])
    return found


class CentreLines:
    """Centre lines of pieces of lanes, from which the lanes of vehicles are found."""

    def __init__(self, pieces: Sequence[Piece]) -> None:
        parts = [_resampled(piece) for piece in pieces]
        self._points, self._directions, self._half_widths = map(np.concatenate, zip(*parts, strict=True))
        self._numbers = [piece.number for piece in pieces]
        self._pieces = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
        self._tree = cKDTree(self._points)

    @classmethod
    def of(cls, pieces: Iterable[Piece]) -> Self | None:
        """Return the centre lines of pieces of lanes, None if no piece has one."""
        drawn = [piece for piece in pieces if _distances(piece.line)[-1] > 0]
        return cls(drawn) if drawn else None

    def nearest(self, x: Array, y: Array, yaw: Array) -> list[int | None]:
        """Return the piece in which each vehicle is, given positions [m] and yaw [rad]; None for no piece.

        The distance from a centre line is measured in half-widths of its lane, so that it is 1 on the marking
        on both sides. Only pieces that are aligned with the vehicle are considered, because lanes cross.
        """
        places, headings = np.column_stack([x, y]), np.column_stack([np.cos(yaw), np.sin(yaw)])
        found: list[int | None] = [None] * len(places)
        (known,) = np.nonzero(np.isfinite(places).all(axis=1) & np.isfinite(yaw))
        for i, near in zip(known, self._tree.query_ball_point(places[known], REACH), strict=True):
            offsets, directions = places[i] - self._points[near], self._directions[near]
            across = np.abs(offsets[:, 0] * directions[:, 1] - offsets[:, 1] * directions[:, 0])
            distance = across / self._half_widths[near]
            within = np.abs((offsets * directions).sum(axis=1)) <= MEETING
            distance[~within | (np.abs(directions @ headings[i]) < ALIGNED)] = np.inf
            if distance.min(initial=np.inf) <= FARTHEST:
                found[i] = self._numbers[self._pieces[near][distance.argmin()]]
        return found


def _resampled(piece: Piece) -> tuple[Array, Array, Array]:
    """Return points [m] and directions, shape (n, 2), and half-widths [m], shape (n,), every `SPACING`."""
    at = _distances(piece.line)
    wanted = np.linspace(0.0, at[-1], 2 + int(at[-1] / SPACING))
    points = np.column_stack([np.interp(wanted, at, values) for values in piece.line.T])
    directions = np.gradient(points, axis=0)
    directions /= np.hypot(*directions.T)[:, None]
    half_width = piece.half_width if piece.half_width.size else np.full(at.size, USUAL_HALF_WIDTH)
    return points, directions, np.maximum(np.interp(wanted, at, half_width), np.finfo(float).tiny)


def _distances(line: Array) -> Array:
    """Return the distance of each point of a line from its first one along the line [m], shape (n,)."""
    return np.append(0.0, np.hypot(*np.diff(line, axis=0).T).cumsum()) if len(line) else np.zeros(1)
