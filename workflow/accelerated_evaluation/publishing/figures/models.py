"""The fitted models compared with the data: figures 4 to 7 of the paper."""

from collections.abc import Mapping

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.distributions import Described, Empirical, unit_to_power
from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.publishing.figures.curves import (
    INVERSE_RANGE,
    INVERSE_TTC,
    RECORDS,
    RECORDS_COLOR,
    Curve,
    PlottedVariable,
    density_table,
    draw_curve,
    draw_histogram,
    histogram,
    set_log_ticks,
)
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, PIECES, Drawn, style_of
from accelerated_evaluation.publishing.published import figure

BODY_SHARE = 0.99  # share of the events that the panel of the body shows
BINS = 60
POINTS = 400


@figure
def fig04_inverse_range_fit(
    encounters: pd.DataFrame, two_pieces: IndependentLaw, three_pieces: IndependentLaw
) -> Drawn:
    """Draw piecewise fits of R^-1 with two and with three pieces, for all segments (paper, figure 4).

    The first panel shows densities of the body (the part below the tail), the second survival functions, with
    marks at the knots. The data contain everything that is drawn, with columns panel, curve,
    inverse_range_per_m, bin_width_per_m, count, density_m, is_knot and survival.
    """
    laws = two_pieces.inverse_range, three_pieces.inverse_range
    styles = (
        {"color": PIECES[1], "linestyle": "--", "marker": "s"},
        {"color": PIECES[0], "linestyle": "-", "marker": "o"},
    )
    curves = {
        f"{len(law.components)} pieces": Curve(law, style) for law, style in zip(laws, styles, strict=True)
    }
    return _fit_figure(encounters["inverse_range"].to_numpy(), curves, INVERSE_RANGE)


@figure
def fig05_inverse_ttc_fit(encounters: pd.DataFrame, piecewise: IndependentLaw, segment: str) -> Drawn:
    """Draw the piecewise fit of TTC^-1 in one segment, with the components of its body (paper, figure 5).

    The first panel shows densities of the body (the part below the tail), the second survival functions, with
    marks at the knots. The columns of the data are panel, curve, inverse_ttc_per_s, bin_width_per_s, count,
    density_s, is_knot and survival.
    """
    law = piecewise.inverse_ttc[segment]
    curves = {f"piecewise ({len(law.components)} pieces)": Curve(law, style_of("piecewise"))}
    body = [(weight, leaf) for weight, leaf in law.leaves() if leaf.upper < np.inf]
    for number, (weight, leaf) in enumerate(body):
        style = {"color": "#444444", "linewidth": 0.9, "linestyle": ("--", ":", "-.")[number % 3]}
        curves[_described(leaf, INVERSE_TTC)] = Curve(leaf, style, weight, whole=False)
    return _fit_figure(_inverse_ttc(encounters, segment), curves, INVERSE_TTC, segment)


@figure
def fig06_inverse_range_comparison(
    encounters: pd.DataFrame, piecewise: IndependentLaw, single: IndependentLaw
) -> Drawn:
    """Draw the piecewise and the single parametric fit of R^-1, for all segments (paper, figure 6).

    The records are shown as a histogram.

    The first panel shows densities of the body, the second survival functions. The columns of the data are
    panel, curve, inverse_range_per_m, bin_width_per_m, count, density_m, is_knot and survival.
    """
    curves = _compared(piecewise.inverse_range, single.inverse_range)
    return _fit_figure(encounters["inverse_range"].to_numpy(), curves, INVERSE_RANGE)


@figure
def fig07_inverse_ttc_comparison(
    encounters: pd.DataFrame, piecewise: IndependentLaw, single: IndependentLaw, segment: str
) -> Drawn:
    """Draw the piecewise and the single parametric fit of TTC^-1 in one segment (paper, figure 7).

    The records are shown as a histogram.

    The first panel shows densities of the body, the second survival functions. The columns of the data are
    panel, curve, inverse_ttc_per_s, bin_width_per_s, count, density_s, is_knot and survival.
    """
    curves = _compared(piecewise.inverse_ttc[segment], single.inverse_ttc[segment])
    return _fit_figure(_inverse_ttc(encounters, segment), curves, INVERSE_TTC, segment)


def _inverse_ttc(encounters: pd.DataFrame, segment: str) -> Array:
    return encounters.loc[encounters["segment"] == segment, "inverse_ttc"].to_numpy()


def _described(leaf: Described, variable: PlottedVariable) -> str:
    """Name a component by its kind and its parameters, such as ``normal, sigma = 0.089 1/s``."""
    parameters = [
        f"${parameter.symbol}$ = {getattr(leaf, name):.3f} {unit_to_power(variable.unit, parameter.power)}"
        for name, parameter in leaf.parameters.items()
    ]
    return ", ".join([leaf.kind.removeprefix("bounded "), *parameters])


def _compared(piecewise: Described, single: Described) -> dict[str, Curve]:
    kind = single.kind.removeprefix("bounded ")
    return {
        f"single ({kind})": Curve(single, style_of("single")),
        f"piecewise ({len(piecewise.components)} pieces)": Curve(piecewise, style_of("piecewise")),
    }


def _fit_table(x: Array, curves: Mapping[str, Curve], variable: PlottedVariable) -> pd.DataFrame:
    """Return the data of both panels: densities of the body, and survival functions over the whole range."""
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


def _survival_table(name: str, curve: Curve, points: Array, variable: PlottedVariable) -> pd.DataFrame:
    x = curve.grid(points)
    survival = curve.law.sf(x)
    table = {variable.column: x, "survival": survival, "is_knot": np.isin(x, curve.knots)}
    return pd.DataFrame({"curve": name, **table})[survival > 0]


def _fit_figure(x: Array, curves: Mapping[str, Curve], variable: PlottedVariable, segment: str = "") -> Drawn:
    """Draw the panels of body and tail; return the figure and the table of everything that is drawn."""
    table = _fit_table(x, curves, variable)
    rows = dict(list(table.groupby(["panel", "curve"])))
    given = f", $v_L$ {segment.replace('-', '–')} m/s" if segment else ""
    drawn, (body, tail) = plt.subplots(2, 1, figsize=(COLUMN_WIDTH, 4.7))
    draw_histogram(body, rows["body", RECORDS], variable, f"{RECORDS}, n = {x.size:,}")
    survival = variable.column, "survival"
    tail.plot(*(rows["tail", RECORDS][name] for name in survival), color=RECORDS_COLOR, linewidth=3.5)
    for name, curve in curves.items():
        draw_curve(body, rows["body", name], (variable.column, variable.density), name, curve)
        if curve.whole:
            draw_curve(tail, rows["tail", name], survival, name, curve)
    body.set_title("(a) body; markers: knots", loc="left")
    body.set_ylabel(f"density [{variable.density_unit}]")
    tail.set_title("(b) tail", loc="left")
    tail.set(ylabel="exceedance probability", yscale="log", ylim=(0.3 / x.size, 1.5))
    if variable.log_scale:
        set_log_ticks(tail)
    for axis in (body, tail):
        axis.set_xlabel(f"${variable.symbol}$ [{variable.unit}]{given}")
    drawn.legend(*body.get_legend_handles_labels(), loc="outside upper left", ncols=1 + (len(curves) > 2))
    return drawn, table
