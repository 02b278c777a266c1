"""The common style of all figures, for a column of an IEEE journal and print in grey; saving of figures.

Any two methods differ in their colour and in a further property.
"""

import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from accelerated_evaluation.base.drawing import own_settings
from accelerated_evaluation.base.files import atomic_path, write_csv
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.publishing.tables.display import reproducible

COLUMN_WIDTH = 3.5  # [in], one column of an IEEE journal
FORMATS = ("png", "pdf", "svg")
DIGEST = 10  # number of hexadecimal digits in an identifier of Matplotlib's SVG files
IDS = re.compile(rf"(?<=[\"#])[A-Za-z][A-Za-z0-9_]*(?<![0-9a-f])[0-9a-f]{{{DIGEST}}}(?=[\")])")

# Dark to light, so that pieces can be distinguished in grey as well.
PIECES = ("#08306b", "#4292c6", "#9ecae1")

Look = dict[str, Any]  # keyword arguments for Matplotlib

_RC: Look = {
    "figure.figsize": (COLUMN_WIDTH, 2.4),
    "figure.dpi": 150,
    "figure.constrained_layout.use": True,
    "savefig.dpi": 300,
    "font.family": "serif",
    "font.serif": ["DejaVu Serif"],
    "mathtext.fontset": "dejavuserif",
    "font.size": 8,
    "axes.labelsize": 8,
    "axes.titlesize": 8,
    "legend.fontsize": 7,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.linewidth": 0.3,
    "grid.color": "#d0d0d0",
    "lines.linewidth": 1.2,
    "lines.markersize": 4,
    "legend.frameon": False,
    # With a fixed salt, the same figure always gives the same file.
    "svg.hashsalt": "accelerated-evaluation",
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
}
Drawn = tuple[Figure, pd.DataFrame]  # a figure, and the table of its data


@contextmanager
def paper_style() -> Iterator[None]:
    """Draw figures in the common style of this project within a ``with`` block."""
    with own_settings(_RC):
        yield


def note_source(figure: Figure, source: str) -> None:
    """Write a note on the data in small print below a figure; the layout reserves space for it.

    ``source``: description of the data, such as "Safety Pilot Model Deployment (real events)". The note
    replaces the figure's common label of x, so label the axes individually.
    """
    # Without the backslash, Matplotlib would take a dollar sign for the start of a formula.
    figure.supxlabel(f"Data: {source}".replace("$", r"\$"), x=0.99, ha="right", fontsize=6, color="#555555")


def say_no_crash(axes: Axes) -> None:
    """Write "no crash" into the middle of axes in which there is nothing to draw."""
    _say(axes, "no crash")


def say_unknown(axes: Axes) -> None:
    """Write into the middle of axes that a vehicle reports no states over time."""
    _say(axes, "the states of this vehicle are not known, only the outcomes")


def _say(axes: Axes, text: str) -> None:
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color="#555555")


def save_figure(
    figure: Figure,
    data: pd.DataFrame,
    folder: str | os.PathLike,
    name: str,
    metadata: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
) -> Figure:
    """Save a figure as PDF, SVG and PNG, and its data as CSV in the same folder; return it for display.

    ``data``: tidy table of everything that is drawn, units in the column names.
    """
    undated = {"png": {}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}
    for extension in FORMATS:
        with paper_style(), atomic_path(Path(folder) / f"{name}.{extension}") as temporary:
            figure.savefig(
                temporary, format=extension, metadata={**undated[extension], **metadata.get(extension, {})}
            )
            if extension == "svg":
                _number_ids(temporary)
        # The layout engine computes the positions of all parts of a figure, which takes longer than drawing
        # it. They are the same in all formats, so the engine is removed after the first format. With the
        # engine "none" instead of None, Matplotlib would draw each figure twice.
        with mpl.rc_context({"figure.constrained_layout.use": False}):
            figure.set_layout_engine(None)
    write_csv(Path(folder) / f"{name}.csv", reproducible(data))
    plt.close(figure)
    return figure


def _number_ids(path: Path) -> None:
    """Replace the identifiers of an SVG file that Matplotlib computes from coordinates by numbers.

    These are digests of coordinates with all digits, of which the last ones depend on the processor. The
    coordinates in the file are rounded.
    """
    text = path.read_text(encoding="utf-8")
    numbered = {name: f"{name[:-DIGEST]}-{k}" for k, name in enumerate(dict.fromkeys(IDS.findall(text)))}
    path.write_text(IDS.sub(lambda found: numbered[found[0]], text), encoding="utf-8")


def style_of(method: str, *parts: str) -> Look:
    """Return the Matplotlib style of a method: the given properties, such as ``"color"``, or all of them."""
    style = METHODS[method].style
    return {part: style[part] for part in parts or style}
