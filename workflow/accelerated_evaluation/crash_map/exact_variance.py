"""The exact coefficient of variation of importance sampling under an f*, and all tables of exact values."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.exact import ALL, capped_intervals, exact_table, weighted_lines
from accelerated_evaluation.crash_map.maps import LINES_PER_CELL, Cells, CrashMap
from accelerated_evaluation.crash_map.severity import impact_speed_table, severity_table
from accelerated_evaluation.laws import Factors, StratifiedLaw, Stratum
from accelerated_evaluation.laws.distributions import Distribution
from accelerated_evaluation.vehicles.protocol import CRASH

_NODES, _NODE_WEIGHTS = np.polynomial.legendre.leggauss(8)
POINTS = 4000  # number of points of the grid on which the tail of f^2 / f* is integrated
DECADES = 60  # the survival function of f decreases by this number of powers of ten along the grid
IGNORED_SHARE = 1e-3  # of the crash probability, in cells that f* hardly reaches


def exact_variation(
    crash_map: CrashMap,
    law: StratifiedLaw,
    proposals: Mapping[str, Factors],
    *,
    ignored_shares: Sequence[float] = (0.0,),
) -> dict[str, tuple[float, ...]]:
    """Return the coefficient of variation of a weight I f / f* in each stratum, and over all strata.

    I is 1 if the cut-in ends in a crash and 0 otherwise. The coefficients are computed by integration over
    the crash map, without simulations. With N simulations, the relative standard error of the estimated crash
    probability is this coefficient divided by sqrt(N). It is infinite if f* decreases so fast that the
    weights have no variance. There is one coefficient for each of ``ignored_shares`` of the crash
    probability. The cells with the largest mean weights are left out, as long as they together contain at
    most this share. A positive share gives the variation that is observed in practice, because a realistic
    number of simulations contains no draws from cells that f* hardly reaches.
    """
    moments = {
        name: cell_moments(crash_map, stratum, proposals[name], law.closing_speed_max)
        for name, stratum in law.strata.items()
    }
    moments[ALL] = np.hstack([share * moments[name] for name, share in law.shares.items()])
    return {
        name: tuple(_variation(*cells, share) for share in ignored_shares) for name, cells in moments.items()
    }


def _variation(first: Array, second: Array, ignored_share: float) -> float:
    """Return the coefficient of variation from the moments of cells; NaN if the probability underflows."""
    probability = first.sum()
    if probability**2 == 0:
        return math.nan
    with np.errstate(invalid="ignore", divide="ignore"):
        order = np.argsort(np.nan_to_num(-second / first))
    kept = order[np.cumsum(first[order]) >= ignored_share * probability]
    return math.sqrt(max(float(second[kept].sum() / probability**2) - 1, 0.0))


def cell_moments(crash_map: CrashMap, stratum: Stratum, proposal: Factors, closing_speed_max: float) -> Array:
    """Return the first and second moment of the weights I f / f* under f*, for each cell, shape (2, cells).

    ``closing_speed_max`` is the cap of the law [m/s].
    """
    f, cells = stratum.factors, crash_map.cells
    line, *ends = capped_intervals(crash_map, CRASH, closing_speed_max)
    place = crash_map.lead_speed[line], crash_map.inverse_range[line]
    start, end = (stratum.second(*place, speed) for speed in ends)
    squares = _squared_mass(f.second, proposal.second, start, end)
    squares *= crash_map.weights[line]
    lines = np.bincount(line, squares, crash_map.lead_speed.size).reshape(-1, LINES_PER_CELL)
    by_range = _squared_cell_mass(stratum, proposal.first, cells)
    speeds = stratum.lead_speed_share(cells.lead_speed)
    with np.errstate(invalid="ignore"):
        second = np.where(lines.any(axis=1) & (speeds > 0), speeds * by_range * lines.mean(axis=1), 0.0)
    # If one factor is infinite and another one underflows to 0, their product is NaN. It is replaced by 0: if
    # the variance is infinite, it is also infinite in another cell, in which no factor underflows.
    second = np.nan_to_num(second, nan=0.0, posinf=np.inf)
    return np.stack([weighted_lines(crash_map, stratum, closing_speed_max).mean(axis=1), second])


def _log_square(f: Distribution, proposal: Distribution, x: Array) -> Array:
    """Return log(f^2 / f*) at points x; -inf where f is 0."""
    log_f = f.logpdf(x)
    with np.errstate(invalid="ignore"):
        return np.where(np.isneginf(log_f), -np.inf, 2 * log_f - proposal.logpdf(x))


def _squared_cell_mass(stratum: Stratum, proposal: Distribution, cells: Cells) -> Array:
    """Return the integral of f^2 / f* of the first coordinate over the ranges of a cell, shape (cells,)."""
    middle, half = cells.root.mean(axis=1, keepdims=True), np.abs(np.diff(cells.root)) / 2
    nodes = middle + half * _NODES
    inverse_range = 1 / (cells.range_max * nodes**2)
    speeds = cells.lead_speed.mean(axis=1, keepdims=True)
    coordinate = stratum.first(speeds, inverse_range)
    log_slope = stratum.log_first_slope(speeds, inverse_range) + np.log(2 * inverse_range / nodes)
    with np.errstate(over="ignore"):
        density = np.exp(_log_square(stratum.factors.first, proposal, coordinate) + log_slope)
        return (density @ _NODE_WEIGHTS) * half[:, 0]


def _squared_mass(f: Distribution, proposal: Distribution, start: Array, end: Array) -> Array:
    """Return the integral of f^2 / f* of the second coordinate from ``start`` to ``end``, shape (n,).

    The integral is infinite if f^2 / f* does not decrease in the tail.
    """
    low = max(float(start.min(initial=np.inf)), f.lower)
    far = float(f.isf(max(float(f.sf(low)) * 10.0**-DECADES, np.finfo(float).tiny)))
    if not low < far:
        return np.zeros(start.shape)
    knots = [edge for law in (f, proposal) for edge in _edges(law) if low < edge < far]
    grid = np.union1d(np.linspace(low, far, POINTS), knots)
    half = np.diff(grid)[:, None] / 2
    log_pieces = _log_square(f, proposal, grid[:-1, None] + half * (1 + _NODES))
    if log_pieces[-1, -1] > log_pieces[0].max() - 1:
        return np.full(start.shape, np.inf)
    with np.errstate(over="ignore"):
        tail = np.cumsum(((np.exp(log_pieces) @ _NODE_WEIGHTS) * half[:, 0])[::-1])[::-1]
    # The tail is nearly exponential between the points of the grid, so its logarithm is interpolated.
    log_tail = np.log(np.maximum(tail, np.finfo(float).tiny))
    above = [np.exp(np.interp(x, grid[:-1], log_tail)) * (x < far) for x in (np.maximum(start, low), end)]
    with np.errstate(invalid="ignore"):
        return np.where(np.isinf(above[0]), np.inf, np.maximum(above[0] - above[1], 0))


def _edges(law: Distribution) -> set[float]:
    """Return the finite bounds of a distribution and its components, at which densities may jump."""
    return {edge for _, leaf in law.leaves() for edge in (leaf.lower, leaf.upper) if math.isfinite(edge)}


def variation_table(
    crash_map: CrashMap,
    law: StratifiedLaw,
    proposals: Mapping[tuple[str, int], Mapping[str, Factors]],
) -> pd.DataFrame:
    """Tabulate the exact coefficient of variation for the f* of each method and seed.

    In ``variation_trimmed`` the share `IGNORED_SHARE` of the crash probability is ignored, as in
    `exact_variation`; ``decay`` is the larger value of `tail_decay` in both coordinates and over all strata.
    """
    rows = []
    for (method, seed), factors in proposals.items():
        found = exact_variation(crash_map, law, factors, ignored_shares=(0.0, IGNORED_SHARE))
        decays = {
            name: max(
                tail_decay(stratum.factors.first, factors[name].first),
                tail_decay(stratum.factors.second, factors[name].second),
            )
            for name, stratum in law.strata.items()
        }
        decays[ALL] = max(decays.values())
        rows += [(method, seed, segment, *values, decays[segment]) for segment, values in found.items()]
    columns = ["method", "seed", "segment", "variation", "variation_trimmed", "decay"]
    return pd.DataFrame(rows, columns=columns)


def tail_decay(f: Distribution, proposal: Distribution) -> float:
    """Return how much faster than f its f* falls in the far tail: the ratio of the slopes of log densities.

    For exponential tails it is the ratio of the rates. Above 2, the integral of f^2 / f* is infinite.
    """
    ends = np.array([f.isf(1e-100), f.isf(1e-200)])
    return float(np.diff(proposal.logpdf(ends))[0] / np.diff(f.logpdf(ends))[0])


def exact_tables(
    crash_maps: Mapping[str, CrashMap],
    laws: Mapping[str, StratifiedLaw],
    variant: str,
    proposals: Mapping[tuple[str, int], Mapping[str, Factors]],
    encounters: int,
    distance: float | None,
) -> dict[str, pd.DataFrame]:
    """Return all tables of exact values, computed from the crash maps, by resolution, and the laws.

    The map ``full`` contains all events. ``exact`` has the crash probabilities under the law ``variant``,
    which is simulated, and ``convergence`` those under all laws and for all resolutions (`exact_table`); see
    `severity_table`, `impact_speed_table` and `variation_table` for the others. The distance is in km, or
    None if it is unknown.
    """
    full, studied = crash_maps["full"], laws[variant]
    convergence = exact_table(crash_maps, laws)
    chosen = (convergence["model"] == variant) & (convergence["resolution"] == "full")
    severity = severity_table(full, studied, encounters, distance=distance)
    return {
        "exact": convergence.loc[chosen, ["segment", "probability", "standard_error"]],
        "convergence": convergence,
        "severity": severity,
        "impact_speed": impact_speed_table(severity),
        "variation": variation_table(full, studied, proposals),
    }
