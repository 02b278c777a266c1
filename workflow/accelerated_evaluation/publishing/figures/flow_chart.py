"""Flow charts: boxes, questions and the arrows between them, in inches."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Polygon, Rectangle

FONT_SIZE = 6.5
LINE = {"color": "black", "linewidth": 0.7}


@dataclass(frozen=True)
class Box:
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

    def corners(self, boxes: Mapping[str, Box]) -> list[tuple[float, float]]:
        """Return the points [in] of the arrow from start to end, at which it changes its direction."""
        first, last = boxes[self.start].side(self.sides[0]), boxes[self.end].side(self.sides[1])
        if self.lane is not None:
            return [first, (self.lane, first[1]), (self.lane, last[1]), last]
        corner = (last[0], first[1])
        return [first, last] if corner in (first, last) else [first, corner, last]


def draw_flow_chart(axes: Axes, boxes: Mapping[str, Box], arrows: Iterable[Arrow]) -> None:
    """Draw boxes and arrows on axes whose unit is an inch.

    Parameters
    ----------
    axes
        The axes.
    boxes
        The boxes, by name.
    arrows
        Arrows between boxes, which are given by their names.
    """
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
    place = {
        "bottom": {"xytext": (3, -2), "ha": "left", "va": "top"},
        "left": {"xytext": (-2, 1), "ha": "right", "va": "bottom"},
        "right": {"xytext": (2, 1), "ha": "left", "va": "bottom"},
    }[arrow.sides[0]]
    axes.annotate(arrow.answer, start, textcoords="offset points", fontsize=FONT_SIZE, **place)


def flow_table(boxes: Mapping[str, Box], arrows: Iterable[Arrow]) -> pd.DataFrame:
    """Return a table with a row for each box and arrow of a flow chart.

    The columns are kind (box or arrow), name, text, x_in, y_in, width_in, height_in, question, start and end.

    Parameters
    ----------
    boxes
        The boxes, by name.
    arrows
        The arrows between them.
    """
    rows = [{"kind": "box", "name": name, **asdict(box)} for name, box in boxes.items()]
    rows += [
        {"kind": "arrow", "text": arrow.answer, "start": arrow.start, "end": arrow.end} for arrow in arrows
    ]
    inches = {name: f"{name}_in" for name in ("x", "y", "width", "height")}
    return pd.DataFrame(rows).rename(columns=inches)
