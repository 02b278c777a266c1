"""The Cross-Entropy search: figures 3 and 8 to 11 of the paper."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle
from matplotlib.ticker import MaxNLocator

from accelerated_evaluation.distributions import PiecewiseMixture
from accelerated_evaluation.distributions.lane_change_model import LaneChangeModel
from accelerated_evaluation.publishing.style import COLUMN_WIDTH, PIECES, note_source, paper_style

PIECE_STYLES = tuple(
    {"color": color, "linestyle": line, "marker": marker}
    for color, line, marker in zip(PIECES, ("-", "--", ":"), ("o", "s", "^"), strict=True)
)
CURVES = 5  # densities in figure 11
DENSITY_FLOOR = 1e-4  # [s], the lower end of figure 11
FLOW_HEIGHT = 5.7  # [in]


@dataclass(frozen=True)
class Box:
    """A step of a flow chart, or a question: its text, middle, width and height [in]."""

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
    """An arrow between sides of two boxes, along a vertical lane at x [in] if one is given."""

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
        return [first, (last[0], first[1]), last]


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


def flow_boxes(settings: Mapping[str, Any]) -> dict[str, Box]:
    """Describe the steps of `sampling.cross_entropy.search` with the settings that it runs with."""
    s = dict(settings)
    x, full, narrow, right = 1.35, 2.3, 1.9, 2.94
    return {
        "start": Box(f"start: f, no weight below {s['minimum_weight']:g}\n(single: f's means)", x, 5.47, full, 0.36),
        "draw": Box(
            f"draw N = {s['sample_size']:,} from f*, simulate, score t:\n"
            f"least TTC, or least R / ({s['range_per_ttc']:g} m/s)\nif that is less; 0 in a crash",
            *(x, 4.83, full, 0.5),
        ),
        "rarer": Box(
            f"is the {s['event_quantile']:.0%} quantile of t\nbelow the last threshold?", x, 4.1, full, 0.62, True
        ),
        "more": Box(
            f"draw more (to {s['maximum_batches']} N)\nuntil {s['minimum_events']} crashes;\n"
            f"take {s['minimum_events']}th least t",
            *(right, 3.4, 0.98, 0.5),
        ),
        "event": Box("lower $t_{TTC}$ to that t, $t_R$ with it;\nevent: TTC or R hits its own", x, 3.4, narrow, 0.36),
        "update": Box(
            "weigh events by f / f*; update weights, and\n$\\theta$ of each piece with "
            f"{s['minimum_piece_events']} events (single: rates)",
            *(x, 2.83, full, 0.36),
        ),
        "full": Box("heuristic: tail full, and still\nbelow all events if shifted?", x, 2.13, full, 0.62, True),
        "shift": Box("shift the\ntruncation\npoints up", right, 2.13, 0.66, 0.5),
        "crash": Box(f"was the crash the event\n{s['crash_iterations']} times in a row?", x, 1.2, full, 0.62, True),
        "end": Box("f*", x, 0.5, 0.5, 0.26),
    }


def fig03_cross_entropy_flow(settings: Mapping[str, Any], source: str) -> tuple[Figure, pd.DataFrame]:
    """Draw how our search iterates (paper, figure 3).

    Parameters
    ----------
    settings
        Section ``cross_entropy`` of the configuration.
    source
        Description of the data that the settings are for.

    Returns
    -------
    figure, data
        The flow chart; its boxes and arrows: kind, name, text, start, end, x_in, y_in, width_in, height_in.
    """
    boxes = flow_boxes(settings)
    with paper_style():
        figure, axes = plt.subplots(figsize=(COLUMN_WIDTH, FLOW_HEIGHT))
        axes.set(xlim=(0, COLUMN_WIDTH), ylim=(0.3, FLOW_HEIGHT))
        axes.axis("off")
        for box in boxes.values():
            sides = [box.side(name) for name in ("left", "top", "right", "bottom")]
            corner = box.x - box.width / 2, box.y - box.height / 2
            shape = Polygon(sides) if box.question else Rectangle(corner, box.width, box.height)
            shape.set(facecolor="#e8e8e8" if box.question else "white", edgecolor="black", linewidth=0.7)
            axes.add_patch(shape)
            axes.text(box.x, box.y, box.text, ha="center", va="center", fontsize=6)
        for arrow in FLOW_ARROWS:
            _draw_arrow(axes, arrow, arrow.corners(boxes))
        note_source(figure, f"none; settings of the study of {source}")
    rows = [{"kind": "box", "name": name, **asdict(box)} for name, box in boxes.items()]
    rows += [
        {"kind": "arrow", "text": arrow.answer, "start": arrow.start, "end": arrow.end} for arrow in FLOW_ARROWS
    ]
    inches = {name: f"{name}_in" for name in ("x", "y", "width", "height")}
    return figure, pd.DataFrame(rows).rename(columns=inches)


def _draw_arrow(axes: Axes, arrow: Arrow, corners: list[tuple[float, float]]) -> None:
    style = {"color": "black", "linewidth": 0.7}
    axes.plot(*zip(*corners[:-1], strict=True), **style)
    head = {"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, "mutation_scale": 6, **style}
    axes.annotate("", corners[-1], corners[-2], arrowprops=head)
    (x, y), (next_x, next_y) = corners[0], corners[1]
    if next_y != y:
        axes.text(x + 0.04, y - 0.02, arrow.answer, fontsize=6, va="top")
    else:
        axes.text(x + np.copysign(0.03, next_x - x), y + 0.03, arrow.answer, fontsize=6, ha="left" if next_x > x else "right")
