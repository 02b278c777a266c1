"""Figure 34, beyond the paper: crashes if the lead vehicle changes its speed."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from accelerated_evaluation.publishing.figures.dot_chart import (
    FRAME,
    ROW,
    finish,
    in_ratios,
    name_rows,
    spaced,
    write_beside,
)
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, PIECES, Drawn, Look, note_source
from accelerated_evaluation.publishing.published import figure
from accelerated_evaluation.publishing.tables.display import vehicles_in_words

GROUPS = {"closing": "cut-ins whose gap closes", "opening": "cut-ins whose gap opens"}
NORMAL_90 = 1.645  # half-width of the 90 % interval of the standard normal distribution


@figure
def fig34_lead_motion(lead_motion: pd.DataFrame, source: str) -> Drawn:
    """Draw the crash probabilities with a lead vehicle that keeps its speed, and with one that changes it.

    Return the figure and the rows of ``lead_motion`` in its order.
    """
    rows = pd.concat([lead_motion[lead_motion["gap"] == gap] for gap in GROUPS], ignore_index=True)
    rows = rows.assign(group=rows["gap"].map(GROUPS))
    y = spaced(rows["group"], 1.6)
    drawn, axes = plt.subplots(figsize=(2 * COLUMN_WIDTH, FRAME + ROW * (len(rows) + 6)))
    look: Look = {"linestyle": "none", "markersize": 3.5}
    still = rows["constant"].where(rows["constant"] > 0)
    axes.plot(still, y, marker="s", color="black", label="lead vehicle keeps its speed", **look)
    crashed = (rows["moving"] > 0).to_numpy()
    moving, reach = rows["moving"][crashed], NORMAL_90 * rows["standard_error"][crashed]
    bars = [np.minimum(reach, 0.9 * moving), reach]
    label = "lead vehicle changes its speed, 90 % interval"
    axes.errorbar(
        moving, y[crashed], xerr=bars, marker="o", color=PIECES[0], elinewidth=0.8, label=label, **look
    )
    limit = rows["high95"][~crashed]
    if len(limit):
        axes.plot(limit, y[~crashed], marker="<", color=PIECES[0], label="not known: 95 % limit", **look)
    axes.set(xscale="log", xlabel="crash probability of a cut-in")
    name_rows(axes, y, rows["group"], vehicles_in_words(rows["vehicle"]))
    has_factor = rows["factor"].notna().to_numpy()
    write_beside(axes, y[has_factor], in_ratios(rows["factor"][has_factor]), "× constant")
    finish(drawn, axes)
    note_source(drawn, f"{source}; lead motion with the statistics of NGSIM")
    return drawn, rows.drop(columns="group")
