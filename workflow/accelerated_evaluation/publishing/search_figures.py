"""The Cross-Entropy search: figures 3 and 8 to 11 of the paper."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from accelerated_evaluation.publishing.style import PIECES

PIECE_STYLES = tuple(
    {"color": color, "linestyle": line, "marker": marker}
    for color, line, marker in zip(PIECES, ("-", "--", ":"), ("o", "s", "^"), strict=True)
)
OTHER_SEEDS = {"alpha": 0.3, "linewidth": 0.6, "marker": None, "label": None}
CURVES = 5  # densities in figure 11
FLOW_HEIGHT = 5.6  # [in]


@dataclass(frozen=True)
class Box:
    """A step of a flow chart, or a question: its text, middle, width and height [in]."""

    name: str
    text: str
    x: float
    y: float
    width: float
    height: float
    question: bool = False

    def side(self, side: str) -> tuple[float, float]:
        """Return the middle of its left, right, top or bottom side."""
        right = {"left": -1, "right": 1}.get(side, 0)
        up = {"bottom": -1, "top": 1}.get(side, 0)
        return self.x + right * self.width / 2, self.y + up * self.height / 2


@dataclass(frozen=True)
class Arrow:
    """An arrow from a side of a box to a side of another; along a vertical lane at x [in] if one is given."""

    start: str
    end: str
    sides: tuple[str, str] = ("bottom", "top")
    answer: str = ""
    lane: float | None = None

    def corners(self, boxes: Mapping[str, Box]) -> list[tuple[float, float]]:
        """Return the points that it joins."""
        first, last = boxes[self.start].side(self.sides[0]), boxes[self.end].side(self.sides[1])
        if self.lane is not None:
            return [first, (self.lane, first[1]), (self.lane, last[1]), last]
        return [first, last] if first[0] == last[0] or first[1] == last[1] else [first, (last[0], first[1]), last]


FLOW_ARROWS = (
    Arrow("start", "draw"),
    Arrow("draw", "rarer"),
    Arrow("rarer", "event", answer="yes"),
    Arrow("rarer", "more", ("right", "top"), "no"),
    Arrow("more", "event", ("left", "right")),
    Arrow("event", "update"),
    Arrow("update", "full"),
    Arrow("full", "shift", ("right", "left"), "yes"),
    Arrow("full", "crash", answer="no"),
    Arrow("shift", "draw", ("right", "right"), lane=3.45),
    Arrow("crash", "draw", ("left", "left"), "no", lane=0.05),
    Arrow("crash", "end", answer="yes"),
)


def flow_boxes(settings: Mapping[str, Any]) -> list[Box]:
    """Describe the steps of `sampling.cross_entropy.search` with the numbers of section ``cross_entropy``."""
    few, last = settings["minimum_events"], settings["crash_iterations"]
    texts = {
        "start": "f* = f, every weight at least {minimum_weight:g}\n(single: exponentials with the means of f)",
        "draw": "draw N = {sample_size:,} cut-ins from f*, simulate;\nscore t: the smaller of least TTC and\n"
        "least R / ({range_per_ttc:g} m/s), 0 in a crash",
        "rarer": "is the {event_quantile:.0%} quantile of t\nbelow the last threshold?",
    }
    x, wide = 1.32, 2.4
    return [
        Box("start", texts["start"].format(**settings), x, 5.36, wide, 0.38),
        Box("draw", texts["draw"].format(**settings), x, 4.75, wide, 0.52),
        Box("rarer", texts["rarer"].format(**settings), x, 4.0, wide, 0.62, True),
        Box("more", f"more batches\nof N till {few}\ncrashes; {few}th\nsmallest t", 2.97, 3.3, 0.84, 0.62),
        Box("event", "threshold: that t, or the last if less;\nevent: $t_{TTC}$ or $t_R$ hit", x, 3.3, 2.1, 0.4),
    ]
