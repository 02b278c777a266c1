"""Distributions and records for figures: histograms, densities with marked knots, and their tables."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.distributions import Distribution

RECORDS = "empirical"
RECORDS_COLOR = "#c0c0c0"


@dataclass(frozen=True)
class PlottedVariable:
    """Name and units of a variable in figures and in their data.

    Attributes
    ----------
    name
        Name in the names of columns.
    symbol
        Symbol as a formula of LaTeX.
    unit, unit_name
        Unit in labels, and in the names of columns.
    density_unit
        Unit of its density, the inverse of ``unit``.
    log_scale
        Whether its axis is logarithmic in the panel of the tail.
    """

    name: str
    symbol: str
    unit: str
    unit_name: str
    density_unit: str
    log_scale: bool

    @property
    def column(self) -> str:
        """Name of the column of its values."""
        return f"{self.name}_{self.unit_name}"

    @property
    def width(self) -> str:
        """Name of the column of bin widths."""
        return f"bin_width_{self.unit_name}"

    @property
    def density(self) -> str:
        """Name of the column of densities."""
        return f"density_{self.density_unit}"


INVERSE_RANGE = PlottedVariable("inverse_range", "R^{-1}", "1/m", "per_m", "m", log_scale=True)
INVERSE_TTC = PlottedVariable("inverse_ttc", "TTC^{-1}", "1/s", "per_s", "s", log_scale=False)


@dataclass(frozen=True)
class Curve:
    """A distribution, and how it is drawn.

    Attributes
    ----------
    law
        The distribution.
    style
        Arguments of `Axes.plot`.
    weight
        Factor of the density; smaller than 1 for a component of a mixture.
    whole
        Whether the survival function is drawn too; false for a component of a mixture.
    """

    law: Distribution
    style: Mapping[str, Any] = field(default_factory=dict)
    weight: float = 1.0
    whole: bool = True

    @property
    def knots(self) -> Array:
        """The truncation points between the k pieces of the distribution, shape (k - 1,)."""
        return np.asarray(getattr(self.law, "knots", ()))

    def grid(self, points: Array) -> Array:
        """Return the points at which the curve is evaluated.

        The points and two more for each knot between them, at the knot and just below it, so that jumps of
        the density are drawn; shape (n + 2 knots,), or less if a point occurs twice.
        """
        knots = self.knots[(self.knots > points[0]) & (self.knots < points[-1])]
        return np.unique(np.concatenate([points, knots, np.nextafter(knots, -np.inf)]))


def histogram(x: Array, edges: Array, variable: PlottedVariable) -> pd.DataFrame:
    """Return a table of the numbers of records in bins, with a row for each bin.

    The columns are the name `RECORDS`, the middle and width of the bin, the count, and the density, which is
    count / (n width). The n records ``x``, shape (n,), also include those outside of the bins.
    """
    count, width = np.histogram(x, edges)[0], np.diff(edges)
    columns = (variable.column, variable.width, "count", variable.density)
    values = (edges[:-1] + width / 2, width, count, count / (x.size * width))
    return pd.DataFrame({"curve": RECORDS, **dict(zip(columns, values, strict=True))})


def density_table(name: str, curve: Curve, points: Array, variable: PlottedVariable) -> pd.DataFrame:
    """Tabulate the density of a curve where it is positive.

    The columns are curve, value of the variable, density times weight, and is_knot.
    """
    x = curve.grid(points)
    density = curve.weight * np.exp(curve.law.logpdf(x))
    inside = density > 0
    table = {variable.column: x, variable.density: density, "is_knot": np.isin(x, curve.knots)}
    return pd.DataFrame({"curve": name, **{column: values[inside] for column, values in table.items()}})


def draw_histogram(axis: Axes, rows: pd.DataFrame, variable: PlottedVariable, label: str) -> None:
    """Draw a table from `histogram` on a logarithmic axis, from a third of the smallest positive density."""
    middle, half = rows[variable.column].to_numpy(), rows[variable.width].to_numpy() / 2
    edges = np.append(middle - half, middle[-1] + half[-1])
    density = rows[variable.density].to_numpy()
    floor = density[density > 0].min() / 3
    axis.stairs(density, edges, baseline=floor, fill=True, color=RECORDS_COLOR, label=label)
    axis.set(yscale="log", ylim=(floor, 2 * density.max()))


def set_log_ticks(axis: Axes) -> None:
    """Scale x logarithmically, with ticks at 1, 2 and 5 times powers of ten, written as plain numbers."""
    axis.set_xscale("log")
    axis.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.xaxis.set_minor_formatter(NullFormatter())


def draw_curve(axis: Axes, rows: pd.DataFrame, columns: tuple[str, str], label: str, curve: Curve) -> None:
    """Draw a curve with markers at its knots."""
    knots = np.flatnonzero(rows["is_knot"].to_numpy(dtype=bool)).tolist()
    style = dict(curve.style) if knots else {**curve.style, "marker": None}
    axis.plot(*(rows[column] for column in columns), label=label, markevery=knots or None, **style)
