"""The fitted models beside the data: figures 4 to 7 of the paper."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from accelerated_evaluation.distributions import Described, Distribution, Empirical, unit_to_power
from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.laws.lane_change_model import LaneChangeModel
from accelerated_evaluation.publishing.model_tables import leaves
from accelerated_evaluation.publishing.style import COLUMN_WIDTH, METHODS, PIECES, note_source, paper_style

RECORDS = "empirical"
RECORDS_COLOR = "#c0c0c0"
BODY_SHARE = 0.99  # of the events, where the panel of the body ends
BINS = 60
POINTS = 400


@dataclass(frozen=True)
class Variable:
    """How figures and their data name a variable and its units."""

    name: str
    symbol: str
    unit: str
    unit_name: str
    density_unit: str
    log_scale: bool

    @property
    def column(self) -> str:
        """Its column."""
        return f"{self.name}_{self.unit_name}"

    @property
    def width(self) -> str:
        """Column of the widths of bins."""
        return f"bin_width_{self.unit_name}"

    @property
    def density(self) -> str:
        """Column of densities."""
        return f"density_{self.density_unit}"


INVERSE_RANGE = Variable("inverse_range", "R^{-1}", "1/m", "per_m", "m", log_scale=True)
INVERSE_TTC = Variable("inverse_ttc", "TTC^{-1}", "1/s", "per_s", "s", log_scale=False)


@dataclass(frozen=True)
class Curve:
    """A law to draw and how; ``weight`` times its density, and its survival function if it is ``whole``."""

    law: Distribution
    style: Mapping[str, Any] = field(default_factory=dict)
    weight: float = 1.0
    whole: bool = True

    @property
    def knots(self) -> Array:
        """Its truncation points, shape (k - 1,); none for a single law."""
        return np.asarray(getattr(self.law, "knots", ()))

    def grid(self, points: Array) -> Array:
        """Return the rising ``points`` with both sides of every knot that they enclose."""
        knots = self.knots[(self.knots > points[0]) & (self.knots < points[-1])]
        return np.unique(np.concatenate([points, knots, np.nextafter(knots, -np.inf)]))


def histogram(x: Array, edges: Array, variable: Variable) -> pd.DataFrame:
    """Count events in bins.

    Parameters
    ----------
    x
        Events, shape (n,); the density refers to all of them, those outside the bins included.
    edges
        Rising edges of the bins, in the unit of x.

    Returns
    -------
    pandas.DataFrame
        A row a bin: curve, middle, width, count and density, count / (n width).
    """
    count, width = np.histogram(x, edges)[0], np.diff(edges)
    columns = (variable.column, variable.width, "count", variable.density)
    values = (edges[:-1] + width / 2, width, count, count / (x.size * width))
    return pd.DataFrame({"curve": RECORDS, **dict(zip(columns, values, strict=True))})


def density_table(name: str, curve: Curve, points: Array, variable: Variable) -> pd.DataFrame:
    """Tabulate a curve's density at points, shape (n,), and its knots: curve, x, density, is_knot."""
    x = curve.grid(points)
    density = curve.weight * np.exp(curve.law.logpdf(x))
    inside = density > 0
    table = {variable.column: x, variable.density: density, "is_knot": np.isin(x, curve.knots)}
    return pd.DataFrame({"curve": name, **{column: values[inside] for column, values in table.items()}})


def draw_histogram(axis: Axes, rows: pd.DataFrame, variable: Variable, label: str) -> None:
    """Fill a histogram down to a third of its lowest density on a logarithmic axis, which it limits."""
    middle, half = rows[variable.column].to_numpy(), rows[variable.width].to_numpy() / 2
    edges = np.append(middle - half, middle[-1] + half[-1])
    density = rows[variable.density].to_numpy()
    floor = density[density > 0].min() / 3
    axis.stairs(density, edges, baseline=floor, fill=True, color=RECORDS_COLOR, label=label)
    axis.set(yscale="log", ylim=(floor, 2 * density.max()))


def set_log_ticks(axis: Axes) -> None:
    """Scale x logarithmically, with ticks at 1, 2 and 5 written as plain numbers."""
    axis.set_xscale("log")
    axis.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.xaxis.set_minor_formatter(NullFormatter())


def draw_curve(axis: Axes, rows: pd.DataFrame, columns: tuple[str, str], label: str, curve: Curve) -> None:
    """Draw two columns of a curve's rows against each other, its knots as markers."""
    knots = np.flatnonzero(rows["is_knot"].to_numpy(dtype=bool)).tolist()
    style = dict(curve.style) if knots else {**curve.style, "marker": None}
    axis.plot(*(rows[column] for column in columns), label=label, markevery=knots or None, **style)


def fig04_inverse_range_fit(
    encounters: pd.DataFrame, models: Mapping[str, LaneChangeModel], source: str
) -> tuple[Figure, pd.DataFrame]:
    """Piecewise fits of R^-1, pooled over the segments, by number of pieces (paper, figure 4).

    Parameters
    ----------
    encounters
        Encounter table.
    models
        Piecewise models by name; they are told apart by the pieces of their R^-1.
    source
        What the encounters are, to be printed.

    Returns
    -------
    figure, data
        The body as densities, the tail as survival functions, knots marked; and all that is drawn:
        panel, curve, inverse_range_per_m, bin_width_per_m, count, density_m, is_knot, survival.
    """
    laws = [model.inverse_range for model in models.values()]
    styles = (
        {"color": PIECES[1], "linestyle": "--", "marker": "s"},
        {"color": PIECES[0], "linestyle": "-", "marker": "o"},
    )
    curves = {
        f"{len(law.components)} pieces": Curve(law, style) for law, style in zip(laws, styles, strict=True)
    }
    return _fit_figure(encounters["inverse_range"].to_numpy(), curves, INVERSE_RANGE, source)


def fig05_inverse_ttc_fit(
    encounters: pd.DataFrame, model: LaneChangeModel, segment: str, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Piecewise fit of TTC^-1 in one segment, with the components of its body (paper, figure 5).

    Parameters
    ----------
    encounters
        Encounter table.
    model
        A piecewise model.
    segment
        Segment of v_L; the paper shows the second one.
    source
        What the encounters are, to be printed.

    Returns
    -------
    figure, data
        As of `fig04_inverse_range_fit`, in inverse_ttc_per_s, bin_width_per_s and density_s.
    """
    law = model.inverse_ttc[segment]
    curves = {f"piecewise ({len(law.components)} pieces)": Curve(law, METHODS["piecewise"])}
    body = [(weight, leaf) for weight, leaf in leaves(law) if leaf.upper < np.inf]
    for number, (weight, leaf) in enumerate(body):
        style = {"color": "#444444", "linewidth": 0.9, "linestyle": ("--", ":", "-.")[number % 3]}
        curves[_described(leaf, INVERSE_TTC)] = Curve(leaf, style, weight, whole=False)
    return _fit_figure(_inverse_ttc(encounters, segment), curves, INVERSE_TTC, source, segment)


def fig06_inverse_range_comparison(
    encounters: pd.DataFrame, piecewise: LaneChangeModel, single: LaneChangeModel, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Piecewise against single parametric fit of R^-1, pooled over the segments (paper, figure 6).

    Parameters and what is returned are as of `fig04_inverse_range_fit`.
    """
    curves = _compared(piecewise.inverse_range, single.inverse_range)
    return _fit_figure(encounters["inverse_range"].to_numpy(), curves, INVERSE_RANGE, source)


def fig07_inverse_ttc_comparison(
    encounters: pd.DataFrame, piecewise: LaneChangeModel, single: LaneChangeModel, segment: str, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Piecewise against single parametric fit of TTC^-1 in one segment (paper, figure 7).

    Parameters and what is returned are as of `fig05_inverse_ttc_fit`.
    """
    curves = _compared(piecewise.inverse_ttc[segment], single.inverse_ttc[segment])
    return _fit_figure(_inverse_ttc(encounters, segment), curves, INVERSE_TTC, source, segment)


def _inverse_ttc(encounters: pd.DataFrame, segment: str) -> Array:
    return encounters.loc[encounters["segment"] == segment, "inverse_ttc"].to_numpy()


def _described(leaf: Described, variable: Variable) -> str:
    """Name a component by its kind and its parameters, such as ``normal, sigma = 0.089 1/s``."""
    parameters = [
        f"${parameter.symbol}$ = {getattr(leaf, name):.3f} {unit_to_power(variable.unit, parameter.power)}"
        for name, parameter in leaf.parameters.items()
    ]
    return ", ".join([leaf.kind.removeprefix("bounded "), *parameters])


def _compared(piecewise: Described, single: Described) -> dict[str, Curve]:
    kind = single.kind.removeprefix("bounded ")
    return {
        f"single ({kind})": Curve(single, METHODS["single"]),
        f"piecewise ({len(piecewise.components)} pieces)": Curve(piecewise, METHODS["piecewise"]),
    }


def _fit_table(x: Array, curves: Mapping[str, Curve], variable: Variable) -> pd.DataFrame:
    """Tabulate both panels: the body as densities, the tail, to beyond the last event, as survival."""
    start = min(curve.law.lower for curve in curves.values())
    body = np.linspace(start, np.quantile(x, BODY_SHARE), BINS + 1)
    end = 1.05 * x.max()
    tail = np.geomspace(start, end, POINTS) if variable.log_scale else np.linspace(start, end, POINTS)
    points = np.linspace(body[0], body[-1], POINTS)
    densities = [density_table(name, curve, points, variable) for name, curve in curves.items()]
    survivals = [_survival_table(RECORDS, Curve(Empirical(x)), tail, variable)]
    survivals += [
        _survival_table(name, curve, tail, variable) for name, curve in curves.items() if curve.whole
    ]
    panels = {"body": [histogram(x, body, variable), *densities], "tail": survivals}
    table = pd.concat([part.assign(panel=panel) for panel, parts in panels.items() for part in parts])
    table = table.astype({"count": "Int64", "is_knot": "boolean"})
    return table[["panel", *table.columns.drop("panel")]].reset_index(drop=True)


def _survival_table(name: str, curve: Curve, points: Array, variable: Variable) -> pd.DataFrame:
    x = curve.grid(points)
    survival = curve.law.sf(x)
    table = {variable.column: x, "survival": survival, "is_knot": np.isin(x, curve.knots)}
    return pd.DataFrame({"curve": name, **table})[survival > 0]


def _fit_figure(
    x: Array, curves: Mapping[str, Curve], variable: Variable, source: str, segment: str = ""
) -> tuple[Figure, pd.DataFrame]:
    """Draw the panels of body and tail from their table."""
    table = _fit_table(x, curves, variable)
    rows = dict(list(table.groupby(["panel", "curve"])))
    given = f", $v_L$ {segment.replace('-', '–')} m/s" if segment else ""
    with paper_style():
        figure, (body, tail) = plt.subplots(2, 1, figsize=(COLUMN_WIDTH, 4.3))
        draw_histogram(body, rows["body", RECORDS], variable, f"{RECORDS}, n = {x.size:,}")
        survival = variable.column, "survival"
        tail.plot(*(rows["tail", RECORDS][name] for name in survival), color=RECORDS_COLOR, linewidth=3.5)
        for name, curve in curves.items():
            draw_curve(body, rows["body", name], (variable.column, variable.density), name, curve)
            if curve.whole:
                draw_curve(tail, rows["tail", name], survival, name, curve)
        body.set_title("(a) body, knots marked", loc="left")
        body.set_ylabel(f"density [{variable.density_unit}]")
        tail.set_title("(b) tail", loc="left")
        tail.set(ylabel="exceedance probability", yscale="log", ylim=(0.3 / x.size, 1.5))
        if variable.log_scale:
            set_log_ticks(tail)
        for axis in (body, tail):
            axis.set_xlabel(f"${variable.symbol}$ [{variable.unit}]{given}")
        figure.legend(*body.get_legend_handles_labels(), loc="outside upper left", ncols=2)
        note_source(figure, source)
    return figure, table
