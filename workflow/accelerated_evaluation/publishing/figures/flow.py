"""Flow chart of the Cross-Entropy search: figure 3 of the paper."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from accelerated_evaluation.publishing.figures.flow_chart import Arrow, Box, draw_flow_chart, flow_table
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, note_source, paper_style
from accelerated_evaluation.publishing.published import figure

FLOW_HEIGHT = 5.6  # [in]
MAIN, WIDE = 1.36, 2.3  # middle and width of the main column of the flow chart [in]
FLOW_BOXES = {
    "start": Box(
        "$f^*$ starts as f, no weight below {minimum_weight:g}\n(single: exponentials with the means of $f$)",
        *(MAIN, 5.35, WIDE, 0.36),
    ),
    "draw": Box(
        "draw N = {sample_size:,} cut-ins from $f^*$, simulate\nthem; score $t$: the least of TTC and of\n"
        "$R$ / ({range_per_ttc:g} m/s); 0 if it is a crash",
        *(MAIN, 4.74, WIDE, 0.5),
    ),
    "rarer": Box(
        "is the {event_quantile:g} quantile of $t$\nbelow the last $t_{{TTC}}$?",
        *(MAIN, 4.02, WIDE, 0.62),
        question=True,
    ),
    "more": Box(
        "draw on, to {minimum_events}\ncrashes or {maximum_batches} N;\nheuristic: if < {minimum_events}\n"
        "reach the last\n$t_{{TTC}}$, move knots;\ntake the {minimum_events}th\nsmallest $t$",
        *(2.97, 3.31, 0.86, 0.92),
    ),
    "event": Box(
        "$t_{{TTC}}$ falls to it, and $t_R$ in step;\nevent: $TTC$ hits $t_{{TTC}}$ or $R$ hits $t_R$;\n"
        "draw on if a large piece has < {minimum_piece_events}",
        *(MAIN, 3.31, 2.05, 0.5),
    ),
    "update": Box(
        "weight events by $f / f^*$; update weights,\n"
        "$\\theta$ of pieces with {minimum_piece_events} events (single: rates)",
        *(MAIN, 2.71, WIDE, 0.4),
    ),
    "full": Box(
        "shifted: is the tail at full\nweight, with room below\nall events?",
        *(MAIN, 1.94, WIDE, 0.74),
        question=True,
    ),
    "shift": Box("move the\nknots up", 3.06, 1.94, 0.62, 0.46),
    "crash": Box(
        "was the crash itself the\nevent {crash_iterations} times in a row?",
        *(MAIN, 1.08, WIDE, 0.62),
        question=True,
    ),
    "end": Box("$f^*$", MAIN, 0.45, 0.5, 0.24),
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


def flow_boxes(settings: Mapping[str, Any]) -> dict[str, Box]:
    """Return the boxes of the flow chart of `methods.cross_entropy.search`, with the settings in its text."""
    return {name: replace(box, text=box.text.format(**settings)) for name, box in FLOW_BOXES.items()}


@figure
def fig03_cross_entropy_flow(settings: Mapping[str, Any]) -> tuple[Figure, pd.DataFrame]:
    """Draw the flow chart of the Cross-Entropy search (paper, figure 3).

    Parameters
    ----------
    settings
        Section ``cross_entropy`` of the configuration.

    Returns
    -------
    figure, data
        The flow chart, and its boxes and arrows as from `flow_chart.flow_table`.
    """
    boxes = flow_boxes(settings)
    with paper_style():
        drawn, axes = plt.subplots(figsize=(COLUMN_WIDTH, FLOW_HEIGHT))
        axes.set(xlim=(0, COLUMN_WIDTH), ylim=(0.3, FLOW_HEIGHT))
        draw_flow_chart(axes, boxes, FLOW_ARROWS)
        note_source(drawn, "none; the settings of this study")
    return drawn, flow_table(boxes, FLOW_ARROWS)
