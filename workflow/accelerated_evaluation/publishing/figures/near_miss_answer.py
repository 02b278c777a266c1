"""Figure 38, beyond the paper: the margins of the records to a crash, and the second answer from them."""

import matplotlib.pyplot as plt
import pandas as pd

from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, Drawn, Look
from accelerated_evaluation.publishing.published import figure

FIT = "#b2182b"


@figure
def fig38_margins(margins: pd.DataFrame) -> Drawn:
    """Draw the share of records with at least a given margin, and the distribution fitted to the largest.

    A crash has a margin of 1 or more, so the curve at 1 is the crash probability. The data are the table
    ``margins``.
    """
    records, fit = (margins[margins["kind"] == kind] for kind in ("record", "fit"))
    drawn, axes = plt.subplots(figsize=(1.4 * COLUMN_WIDTH, 2.8))
    axes.semilogy(
        records["margin"],
        records["share"],
        "o",
        color="black",
        markersize=2.5,
        markerfacecolor="none",
        markeredgewidth=0.5,
        label="records",
    )
    if len(fit):
        axes.semilogy(fit["margin"], fit["share"], color=FIT, label="fitted tail, median")
        band: Look = {"color": FIT, "alpha": 0.2, "linewidth": 0, "label": "80 % interval"}
        axes.fill_between(fit["margin"], fit["low80"], fit["high80"], **band)
    axes.axvline(1.0, color="black", linewidth=0.6, linestyle=":", label="crash")
    axes.set(xlabel="margin q", ylabel="share of records with at least q")
    axes.legend()
    return drawn, margins
