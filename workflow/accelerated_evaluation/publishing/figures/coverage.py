"""Beyond the paper: coverage of the intervals (figure 18)."""

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, PercentFormatter

from accelerated_evaluation.methods.coverage import LEVELS
from accelerated_evaluation.methods.intervals import binomial_interval
from accelerated_evaluation.publishing.figures.dot_chart import (
    FRAME,
    ROW,
    TRUTH,
    draw_intervals,
    name_groups,
    spaced,
)
from accelerated_evaluation.publishing.figures.method_styles import style_of
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, note_source, paper_style
from accelerated_evaluation.publishing.published import figure

STOPPINGS = {
    "fixed": {"label": "fixed size, normal", "marker": "o", "fillstyle": "none"},
    "fixed_gamma": {"label": "fixed size, gamma", "marker": "o", "fillstyle": "full"},
    "sequential": {"label": "sequential, normal", "marker": "^", "fillstyle": "none"},
    "sequential_gamma": {"label": "sequential, gamma", "marker": "^", "fillstyle": "full"},
}


@figure
def fig18_coverage(coverage: pd.DataFrame, source: str) -> tuple[Figure, pd.DataFrame]:
    """Draw how often the intervals contain the true probability, by method and stopping rule.

    Parameters
    ----------
    coverage
        ``coverage.csv`` of a study.
    source
        Description of the data.

    Returns
    -------
    figure, data
        The figure has a panel for each level of the intervals, with exact binomial 95 % intervals of the
        coverage. The columns of the data are method, stopping, replicates, level, coverage, ci_low and
        ci_high.
    """
    data = _coverage_rows(coverage)
    y = spaced(coverage["method"], 1.0)
    with paper_style():
        drawn, panels = plt.subplots(
            1, len(LEVELS), figsize=(COLUMN_WIDTH, FRAME + ROW * y.max()), sharey=True
        )
        for axes, (level, rows) in zip(panels, data.groupby("level", sort=False), strict=True):
            shown = rows.rename(columns={"coverage": "probability"})
            for at, (_, row) in zip(y, shown.iterrows(), strict=True):
                look = STOPPINGS[row["stopping"]] | style_of(row["method"], "color")
                draw_intervals(axes, row.to_frame().T, [at], **look)
            axes.axvline(level / 100, linestyle=":", **TRUTH)
            axes.set(xlabel=f"coverage of {level} %", xlim=(None, 1))
            axes.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 4, 5, 10]))
            axes.xaxis.set_major_formatter(PercentFormatter(1, decimals=0))
        name_groups(panels[0], y, coverage["method"])
        panels[0].invert_yaxis()
        signs = [plt.Line2D([], [], color="black", linestyle="none", **look) for look in STOPPINGS.values()]
        drawn.legend(handles=signs, loc="outside upper center", ncols=2)
        note_source(drawn, source)
    return drawn, data


def _coverage_rows(coverage: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each row of the table and level, with the binomial 95 % interval of the coverage."""
    data = pd.concat(
        [
            coverage[["method", "stopping", "replicates"]].assign(
                level=level, coverage=coverage[f"coverage{level}"]
            )
            for level in LEVELS
        ],
        ignore_index=True,
    )
    covered = (data["coverage"] * data["replicates"]).round().astype(int)
    bounds = [binomial_interval(k, n, 0.05) for k, n in zip(covered, data["replicates"], strict=True)]
    return data.assign(ci_low=[bound.low for bound in bounds], ci_high=[bound.high for bound in bounds])
