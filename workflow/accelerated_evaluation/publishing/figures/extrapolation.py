"""Figure 37, beyond the paper: where predicted crashes lie, compared with the records."""

import math

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.colors import LogNorm
from matplotlib.patheffects import withStroke

from accelerated_evaluation.answer.ways.extrapolation import CAPPED, FAR, NEAR, RECORDED
from accelerated_evaluation.base.percent import in_percent
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, Drawn, Look
from accelerated_evaluation.publishing.published import figure
from accelerated_evaluation.scenarios.protocol import Scenario

# Colour and marker of each part of the predicted crashes, which differ in grey as well.
PARTS = {RECORDED: ("#08306b", "s"), NEAR: ("#4292c6", "o"), FAR: ("#b2182b", "^")}
# What the parts mean if they are divided by the closing speed, and if by the distance from the records.
BY_SPEED = {
    RECORDED: "as fast as\nsimilar records",
    NEAR: "faster than records\nat a similar range",
    FAR: "of the crashes are faster than any record",
}
BY_DISTANCE = {
    RECORDED: "of the crashes as near to a record as most records",
    NEAR: "farther away than most records are",
    FAR: "farther away than any record is",
}
SMALL = 6.5  # [pt], size of the letters in the figure
DRAWN_CRASHES = 1000  # largest number of crashes that is drawn
SHOWN = 0.99  # share of the drawn crashes that lie within the limits of the axis
CELLS = (50, 100)  # smallest and largest number of cells along each axis in which the records are counted
LIGHTEST = 0.05  # number of records that would be white, so that a cell with one record can be seen


@figure
def fig37_extrapolation(
    extrapolation: pd.DataFrame, crash_places: pd.DataFrame, encounters: pd.DataFrame, scenario: Scenario
) -> Drawn:
    """Draw the number of records in cells of the last two variables, and crashes drawn from the answer.

    If small values of the first of them are important (``divided_by``), its axis is linear up to the smallest
    limit and nearly logarithmic beyond. Variables whose sign does not matter have absolute values.

    The figure, with the share of each part of the predicted crashes next to it; and its data: a row for
    each crash with its ``part``, and one for the middle of each cell with its number of ``records``.
    """
    across, up = scenario.variables[-2:]
    names = list(scenario.names)
    recorded, crashes = (
        pd.DataFrame(scenario.as_in_law(table[names].to_numpy(float)), columns=names)
        for table in (encounters, crash_places.head(DRAWN_CRASHES))
    )
    crashes["part"] = crash_places["part"].head(DRAWN_CRASHES).to_numpy()
    small = (
        scenario.divided_by[1][0] if scenario.divided_by and scenario.divided_by[0] == across.name else None
    )
    # The cells have equal widths on the axes.
    scaled = np.arcsinh(recorded[across.name] / small) if small else recorded[across.name]
    largest = recorded[up.name].max()
    spans = [[0, scaled.max()], [0, largest]]
    number = int(np.clip(math.sqrt(len(recorded)), *CELLS))
    counts, *edges = np.histogram2d(scaled, recorded[up.name], number, spans)
    if small:
        edges[0] = small * np.sinh(edges[0])
    middles, found = [(each[1:] + each[:-1]) / 2 for each in edges], np.nonzero(counts)
    cells = pd.DataFrame({across.name: middles[0][found[0]], up.name: middles[1][found[1]]})
    cells["records"] = counts[found].astype(int)
    shares, by_speed = extrapolation.set_index("part"), CAPPED in set(extrapolation["part"])
    # A few crashes far above the others would flatten everything else.
    top = 1.05 * max([largest, *crashes[up.name].quantile([SHOWN]).dropna()])
    drawn, axes = plt.subplots(figsize=(COLUMN_WIDTH, 2.9))
    if small:
        axes.set_xscale("asinh", linear_width=small)
    end, most = max([recorded[across.name].max(), *crashes[across.name]]), int(cells["records"].max())
    look: Look = {"cmap": "Greys", "norm": LogNorm(LIGHTEST, most), "rasterized": True}
    axes.pcolormesh(*edges, np.ma.masked_equal(counts.T, 0), **look)
    notes = [f"grey: records, 1 (light) to {most:,} (black) in a cell" if most > 1 else "grey: records"]
    for part, meaning in (BY_SPEED if by_speed else BY_DISTANCE).items() if len(shares) else ():
        (color, marker), rows = PARTS[part], crashes[crashes["part"] == part]
        x, y = rows[across.name], rows[up.name].clip(upper=top)
        look = {"markersize": 2.5, "markerfacecolor": "none", "markeredgewidth": 0.5, "clip_on": False}
        label = f"{in_percent(shares.loc[part, 'share'])} {meaning}"
        axes.plot(x, y, marker, color=color, label=label, **look)
        # A label stands next to its crashes: far ones above, near ones below the fastest record.
        places = {
            RECORDED: (max([0.1 * end, *x + 0.03 * end]), 0.4 * largest, "left", "center"),
            NEAR: (0.99 * end, 0.97 * largest, "right", "top"),
            FAR: (0.02 * end, 0.97 * top, "left", "top"),
        }
        if by_speed:
            left, level, ha, va = places[part]
            text = axes.text(left, level, label, ha=ha, va=va, fontsize=SMALL, color=color)
            text.set_path_effects([withStroke(linewidth=2, foreground="white")])
    if by_speed:
        axes.axhline(largest, color="black", linewidth=0.6, linestyle=":")
        axes.text(0.02 * end, 1.01 * largest, "fastest record", va="bottom", fontsize=SMALL)
    if higher := int((crashes[up.name] > top).sum()):
        highest = f"{crashes[up.name].max():.0f} {up.unit}"
        notes.append(f"at the upper edge: {higher} of {len(crashes):,} crashes, up to {highest}")
        notes += ["(the laws have no largest speed; the car has one)"] if by_speed else []
    axes.set_title("\n".join(notes), loc="left", fontsize=SMALL, fontweight="normal")
    axes.set(xlim=(0, end), ylim=(0, top), ylabel=up.label, xlabel=across.label)
    if small:
        decades = 10.0 ** np.arange(math.ceil(math.log10(small / 2)), math.floor(math.log10(end)) + 1)
        axes.set_xticks([0, *decades], [f"{tick:g}" for tick in (0, *decades)])
        between = np.outer(decades, np.arange(2, 10)).ravel()
        axes.set_xticks(between[between < end], minor=True)
    if len(shares) and not by_speed:
        drawn.legend(loc="outside upper left", fontsize=SMALL)
    return drawn, pd.concat([crashes, cells], ignore_index=True)
