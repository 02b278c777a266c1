"""Join the pieces of lanes in ASAM OSI traces.

In OSI, a lane ends where a new section of the road begins, and continues under another number.
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # an optional extra
    from betterosi import Lane


def joined_lanes(lanes: Iterable["Lane"]) -> dict[int, int]:
    """Return a mapping from the number of each piece to the number of its lane.

    Two pieces belong to one lane if each is the only continuation of the other. The number of a lane is the
    smallest number of its pieces. If a lane splits or lanes merge, a new lane begins, because it is undefined
    which of the lanes continues.

    Parameters
    ----------
    lanes
        Pieces of lanes of a trace, each with its number and the numbers of the pieces that continue it.
    """
    ends: dict[int, tuple[set[int], set[int]]] = defaultdict(lambda: (set(), set()))
    for lane in lanes:
        for pairing in lane.classification.lane_pairing if lane.classification else ():
            for side, other in enumerate((pairing.antecessor_lane_id, pairing.successor_lane_id)):
                if other is not None:
                    ends[lane.id.value][side].add(other.value)
    joined: dict[int, int] = {}
    for lane in sorted(ends):
        if lane not in joined:
            joined |= dict.fromkeys(_reached(lane, ends), lane)
    return joined


def _reached(lane: int, ends: Mapping[int, tuple[set[int], set[int]]]) -> set[int]:
    """Return the pieces that belong to the same lane as the piece ``lane``, including this piece."""
    found, waiting = {lane}, [lane]
    while waiting:
        here = waiting.pop()
        for end in ends.get(here, ()):
            if len(end) == 1:
                (other,) = end
                if other not in found and {here} in ends.get(other, ()):
                    found.add(other)
                    waiting.append(other)
    return found
