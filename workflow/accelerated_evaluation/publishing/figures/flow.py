"""Flow chart of the Cross-Entropy search: figure 3 of the paper."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Polygon, Rectangle

from accelerated_evaluation.methods.cross_entropy.method import CONSTANTS
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, Drawn, Look, note_source
from accelerated_evaluation.publishing.published import figure

FONT_SIZE = 6.5
LINE: Look = {"color": "black", "linewidth": 0.7}
FLOW_HEIGHT = 5.6  # [in]
MAIN, WIDE = 1.36, 2.3  # middle and width of the main column of the flow chart [in]


@dataclass(frozen=True)
class FlowBox:
    """A box of a flow chart.

    Attributes
    ----------
    text
        Text inside the box.
    x, y
        Middle of the box [in].
    width, height
        Its size [in].
    question
        Whether the box is a question, drawn as a rhombus, or a step, drawn as a rectangle.
    """

    text: str
    x: float
    y: float
    width: float
    height: float
    question: bool = False

    def side(self, side: str) -> tuple[float, float]:
        """Return the middle [in] of a side: ``"left"``, ``"right"``, ``"top"`` or ``"bottom"``."""
        right = {"left": -1, "right": 1}.get(side, 0)
        up = {"bottom": -1, "top": 1}.get(side, 0)
        return self.x + right * self.width / 2, self.y + up * self.height / 2


@dataclass(frozen=True)
class Arrow:
    """An arrow between two boxes.

    Attributes
    ----------
    start, end
        Names of the boxes.
    sides
        Side at which it leaves the first box, and side at which it enters the second.
    answer
        Answer to a question, which is written at its start.
    lane
        Coordinate x [in] of a vertical line along which the arrow goes; None for the direct way.
    """

    start: str
    end: str
    sides: tuple[str, str] = ("bottom", "top")
    answer: str = ""
    lane: float | None = None

    def corners(self, boxes: Mapping[str, FlowBox]) -> list[tuple[float, float]]:
        """Return the points [in] of the arrow from start to end, at which it changes its direction."""
        first, last = boxes[self.start].side(self.sides[0]), boxes[self.end].side(self.sides[1])
        if self.lane is not None:
            return [first, (self.lane, first[1]), (self.lane, last[1]), last]
        corner = (last[0], first[1])
        return [first, last] if corner in (first, last) else [first, corner, last]


def draw_flow_chart(axes: Axes, boxes: Mapping[str, FlowBox], arrows: Iterable[Arrow]) -> None:
    """Draw boxes and arrows on axes whose unit is an inch."""
    axes.axis("off")
    for box in boxes.values():
        sides = [box.side(name) for name in ("left", "top", "right", "bottom")]
        corner = box.x - box.width / 2, box.y - box.height / 2
        shape = Polygon(sides) if box.question else Rectangle(corner, box.width, box.height)
        shape.set(facecolor="#e8e8e8" if box.question else "white", edgecolor="black", linewidth=0.7)
        axes.add_patch(shape)
        axes.text(box.x, box.y, box.text, ha="center", va="center", fontsize=FONT_SIZE)
    for arrow in arrows:
        corners = arrow.corners(boxes)
        axes.plot(*zip(*corners[:-1], strict=True), **LINE)
        head = {"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, "mutation_scale": 6, **LINE}
        axes.annotate("", corners[-1], corners[-2], arrowprops=head)
        _write_answer(axes, arrow, corners[0])


def _write_answer(axes: Axes, arrow: Arrow, start: tuple[float, float]) -> None:
    """Write the answer that an arrow represents next to its start."""
    place: Look = {
        "bottom": {"xytext": (3, -2), "ha": "left", "va": "top"},
        "left": {"xytext": (-2, 1), "ha": "right", "va": "bottom"},
        "right": {"xytext": (2, 1), "ha": "left", "va": "bottom"},
    }[arrow.sides[0]]
    axes.annotate(arrow.answer, start, textcoords="offset points", fontsize=FONT_SIZE, **place)


def flow_table(boxes: Mapping[str, FlowBox], arrows: Iterable[Arrow]) -> pd.DataFrame:
    """Return a table with a row for each box and arrow of a flow chart.

    The columns are kind (box or arrow), name, text, x_in, y_in, width_in, height_in, question, start and end.
    """
    rows = [{"kind": "box", "name": name, **asdict(box)} for name, box in boxes.items()]
    rows += [
        {"kind": "arrow", "text": arrow.answer, "start": arrow.start, "end": arrow.end} for arrow in arrows
    ]
    inches = {name: f"{name}_in" for name in ("x", "y", "width", "height")}
    return pd.DataFrame(rows).rename(columns=inches)


FLOW_BOXES = {
    "start": FlowBox(
        "$f^*$ starts as f, no weight below {minimum_weight:g}\n(single: exponentials with the means of $f$)",
        *(MAIN, 5.35, WIDE, 0.36),
    ),
    "draw": FlowBox(
        "draw N = {sample_size:,} cut-ins from $f^*$, simulate\nthem; score $t$: the least of TTC and of\n"
        "$R$ / ({range_per_ttc:g} m/s); 0 if it is a crash",
        *(MAIN, 4.74, WIDE, 0.5),
    ),
    "rarer": FlowBox(
        "is the {event_quantile:g} quantile of $t$\nbelow the last $t_{{TTC}}$?",
        *(MAIN, 4.02, WIDE, 0.62),
        question=True,
    ),
    "more": FlowBox(
        "draw on, to {minimum_events}\ncrashes or {maximum_batches} N;\nheuristic: if < {minimum_events}\n"
        "reach the last\n$t_{{TTC}}$, move knots;\ntake the {minimum_events}th\nsmallest $t$",
        *(2.97, 3.31, 0.86, 0.92),
    ),
    "event": FlowBox(
        "$t_{{TTC}}$ falls to it, and $t_R$ in step;\nevent: $TTC$ hits $t_{{TTC}}$ or $R$ hits $t_R$;\n"
        "draw on if a large piece has < {minimum_piece_events}",
        *(MAIN, 3.31, 2.05, 0.5),
    ),
    "update": FlowBox(
        "weight events by $f / f^*$; update weights,\n"
        "$\\theta$ of pieces with {minimum_piece_events} events (single: rates)",
        *(MAIN, 2.71, WIDE, 0.4),
    ),
    "full": FlowBox(
        "shifted: is the tail at full\nweight, with room below\nall events?",
        *(MAIN, 1.94, WIDE, 0.74),
        question=True,
    ),
    "shift": FlowBox("move the\nknots up", 3.06, 1.94, 0.62, 0.46),
    "crash": FlowBox(
        "was the crash itself the\nevent {crash_iterations} times in a row?",
        *(MAIN, 1.08, WIDE, 0.62),
        question=True,
    ),
    "end": FlowBox("$f^*$", MAIN, 0.45, 0.5, 0.24),
}
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
    Arrow("shift", "draw", ("right", "right"), lane=3.46),
    Arrow("crash", "draw", ("left", "left"), "no", lane=0.04),
    Arrow("crash", "end", answer="yes"),
)


def flow_boxes(settings: Mapping[str, Any]) -> dict[str, FlowBox]:
    """Return the boxes of the flow chart of `methods.cross_entropy.search`, with the settings in its text."""
    every = {**CONSTANTS, **settings}
    return {name: replace(box, text=box.text.format(**every)) for name, box in FLOW_BOXES.items()}


@figure
def fig03_cross_entropy_flow(settings: Mapping[str, Any]) -> Drawn:
    """Draw the flow chart of the Cross-Entropy search (paper, figure 3).

    Return the flow chart and its boxes and arrows as from `flow_table`.
    """
    boxes = flow_boxes(settings)
    drawn, axes = plt.subplots(figsize=(COLUMN_WIDTH, FLOW_HEIGHT))
    axes.set(xlim=(0, COLUMN_WIDTH), ylim=(0.3, FLOW_HEIGHT))
    draw_flow_chart(axes, boxes, FLOW_ARROWS)
    note_source(drawn, "none; the settings of this study")
    return drawn, flow_table(boxes, FLOW_ARROWS)
