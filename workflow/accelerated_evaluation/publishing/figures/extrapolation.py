"""Figure 37, beyond the paper: the records, and where the predicted crashes lie."""

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from accelerated_evaluation.answer.extrapolation import FAR, NEAR, RECORDED
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, note_source, paper_style
from accelerated_evaluation.publishing.published import figure

# Each part of the predicted crashes: what it means, and its colour and marker, which differ in grey as well.
PARTS = {
    RECORDED: ("as fast as a record at a similar range", "#08306b", "s"),
    NEAR: ("faster than the records at a similar range", "#4292c6", "o"),
    FAR: ("faster than all records", "#b2182b", "^"),
}
DRAWN_CRASHES = 1000  # largest number of crashes that is drawn
CLOSE = 0.15  # [1/s], least TTC^-1 of the records that are drawn


@figure
def fig37_extrapolation(
    extrapolation: pd.DataFrame, crash_places: pd.DataFrame, encounters: pd.DataFrame, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw the records with a short time to collision, and crashes drawn from the answer.

    Parameters
    ----------
    extrapolation, crash_places
        ``extrapolation.csv`` and ``crash_places.csv`` of a study.
    encounters
        Encounter table, with one row for each recorded cut-in.
    source
        Description of the data.

    Returns
    -------
    figure, data
        The figure, with the share of each part of the predicted crashes in its legend; and these crashes.
    """
    shares, crashes = extrapolation.set_index("part")["share"], crash_places.head(DRAWN_CRASHES)
    near = encounters[encounters["inverse_ttc"] > CLOSE]
    with paper_style():
        drawn, axes = plt.subplots(figsize=(1.4 * COLUMN_WIDTH, 3.2))
        axes.plot(near["range"], near["closing_speed"], ".", color="#777777", markersize=1.5, label="records")
        for part, (meaning, color, marker) in PARTS.items():
            rows = crashes[crashes["part"] == part]
            axes.plot(
                rows["range"],
                rows["closing_speed"],
                marker,
                color=color,
                markersize=2.5,
                markerfacecolor="none",
                markeredgewidth=0.5,
                label=f"crashes, {meaning}: {100 * shares[part]:.0f} %",
            )
        fastest = encounters["closing_speed"].max()
        axes.axhline(fastest, color="black", linewidth=0.6, linestyle=":", label="fastest record")
        ends = round(encounters["range"].max()), max(36, 1.6 * fastest)
        axes.set(xlabel="range [m]", ylabel="closing speed [m/s]", xlim=(0, ends[0]), ylim=(0, ends[1]))
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize=6)
        note_source(drawn, source)
    return drawn, crashes
