"""The paper's tables I and II beside our numbers, the table of all estimates, a digest of the searches."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.special import ndtri

from accelerated_evaluation.laws.lane_change_model import LaneChangeModel
from accelerated_evaluation.methods.importance_sampling import crude_simulations

PAPER_PROBABILITY = 7.4e-7  # section VI.C
PAPER_SIMULATIONS = {"piecewise": 7840, "single": 12320, "crude": 5.5e7}  # table I
PAPER_RATIOS = {"piecewise": 1, "single": 1.57, "crude": 7e3}  # table I
PAPER_SEARCHES = {"piecewise": 24000, "single": 30000}  # table II
PAPER_PARAMETERS = {"piecewise": 18, "single": 4}  # table II, of fitting and of Cross-Entropy

ESTIMATE_COLUMNS = (
    *("study", "method", "replicate", "probability", "ci_low", "ci_high", "simulations"),
    *("scope", "relative_half_width", "events", "effective_sample_size", "largest_weight_share", "converged"),
)


class Spread(NamedTuple):
    """A number of ours with how far it spreads, and what that spread is."""

    value: float
    low: float
    high: float
    of: str


def spread_over(values: ArrayLike, things: str) -> Spread:
    """Return the mean of some values, and their 10 and 90 % quantiles."""
    values = np.asarray(values, dtype=float)
    low, high = np.quantile(values, (0.1, 0.9))
    return Spread(float(values.mean()), float(low), float(high), f"10-90 % over {values.size} {things}")


def count(number: int) -> Spread:
    """Return a count as a number without spread."""
    return Spread(number, number, number, "none, a count")


def of_method(table: pd.DataFrame, method: str, scope: str = "all") -> pd.DataFrame:
    """Return the rows of one method and scope of the estimates or of their courses."""
    return table[(table["method"] == method) & (table["scope"] == scope)]


def pooled_probability(course: pd.DataFrame, method: str, alpha: float, scope: str = "all") -> Spread:
    """Pool the last rows of all replicates' courses into one estimate.

    The courses go on past convergence, so that, unlike the mean of the estimates at convergence, this one
    owes nothing to a moment of stopping that depends on the estimate itself.

    Returns
    -------
    Spread
        The probability, weighted by simulations, with its 100 (1 - alpha) % normal interval.
    """
    last = of_method(course, method, scope).groupby("replicate").last()
    weight = last["simulations"] / last["simulations"].sum()
    probability = float(weight @ last["probability"])
    half_width = float(-ndtri(alpha / 2)) * math.sqrt(weight**2 @ last["variance"])
    simulations = last["simulations"].sum()
    of = f"{100 * (1 - alpha):g} % interval of {simulations:,} simulations"
    low, high = max(probability - half_width, 0.0), min(probability + half_width, 1.0)
    return Spread(probability, low, high, of)


def sample_size(estimates: pd.DataFrame, method: str) -> Spread:
    """Return the simulations to convergence over all segments.

    A replicate that did not converge counts with all its simulations, too few; the spread says so.
    """
    rows = of_method(estimates, method)
    spread = spread_over(rows["simulations"], "replicates")
    missing = int((~rows["converged"]).sum())
    return spread._replace(of=f"{spread.of}, {missing} not converged") if missing else spread


def crude_sample_size(probability: Spread, alpha: float, beta: float) -> Spread:
    """Return the simulations that crude Monte Carlo would need (section VI.C, N-hat)."""
    value, high, low = (
        crude_simulations(p, alpha, beta) if p > 0 else math.inf
        for p in (probability.value, probability.low, probability.high)
    )
    return Spread(value, low, high, f"from the {probability.of}")


def search_totals(trace: pd.DataFrame) -> pd.Series:
    """Return the simulations of the searches of all segments together, by method and seed."""
    searches = trace.groupby(["method", "segment", "seed"])["simulations_total"].max()
    return searches.groupby(["method", "seed"]).sum()


def searched_parameters(trace: pd.DataFrame, method: str) -> int:
    """Count the parameters that the searches of a method move, over all segments.

    The weights of a variable sum to one, so one of them is not free.
    """
    columns = trace.filter(regex=r"^inverse_(range|ttc)_(rate|weight|theta|from)").columns
    total = 0
    for _, rows in trace[trace["method"] == method].groupby("segment"):
        moved = columns[rows[columns].max() > rows[columns].min()]
        bound = {name.split("_weight_")[0] for name in moved if "_weight_" in name}
        total += len(moved) - len(bound)
    return total


def table1_sample_size(
    estimates: pd.DataFrame, course: pd.DataFrame, alpha: float, beta: float, source: str
) -> pd.DataFrame:
    """Build table I: simulations to convergence by method, and the paper's beside them.

    Parameters
    ----------
    estimates, course
        ``estimates.csv`` and ``estimates_course.csv`` of a study.
    alpha, beta
        Convergence is a relative half-width of the 100 (1 - alpha) % interval of at most beta.
    source
        Description of the data.
    """
    sizes = {method: sample_size(estimates, method) for method in ("piecewise", "single", "heuristic")}
    crude = crude_sample_size(pooled_probability(course, "piecewise", alpha), alpha, beta)
    sizes = {"piecewise": sizes["piecewise"], "single": sizes["single"], "crude": crude} | sizes
    rows = [
        {
            "method": method,
            "simulations": size.value,
            "simulations_low": size.low,
            "simulations_high": size.high,
            "ratio_to_piecewise": size.value / sizes["piecewise"].value,
            "paper_simulations": PAPER_SIMULATIONS.get(method, math.nan),
            "paper_ratio_to_piecewise": PAPER_RATIOS.get(method, math.nan),
            "spread": size.of,
        }
        for method, size in sizes.items()
    ]
    return pd.DataFrame(rows).assign(data=source)


def table2_computation(
    table1: pd.DataFrame, trace: pd.DataFrame, models: Mapping[str, LaneChangeModel], source: str
) -> pd.DataFrame:
    """Build table II: what each stage computes with each method, and the paper's numbers beside ours.

    Parameters
    ----------
    table1
        What `table1_sample_size` returned.
    trace
        ``cross_entropy_trace.csv`` of a study.
    models
        The fitted models by method.
    source
        Description of the data.
    """
    totals, size = search_totals(trace), table1.set_index("method")
    rows = []
    for method in ("crude", "single", "piecewise", "heuristic"):
        if method in models:
            fitted = models[method].n_parameters
            rows.append(("fitting", "parameters", method, count(fitted), PAPER_PARAMETERS.get(method)))
        if method in totals:
            moved, spent = searched_parameters(trace, method), spread_over(totals[method], "seeds")
            rows.append(("Cross-Entropy", "simulations", method, spent, PAPER_SEARCHES.get(method)))
            rows.append(("Cross-Entropy", "parameters", method, count(moved), PAPER_PARAMETERS.get(method)))
        row = size.loc[method]
        spent = Spread(row["simulations"], row["simulations_low"], row["simulations_high"], row["spread"])
        rows.append(("simulation", "simulations", method, spent, PAPER_SIMULATIONS.get(method)))
    table = pd.DataFrame(
        [
            (stage, method, quantity, ours.value, ours.low, ours.high, paper, ours.of)
            for stage, quantity, method, ours, paper in rows
        ],
        columns=["stage", "method", "quantity", "ours", "ours_low", "ours_high", "paper", "spread"],
    )
    stages = ["fitting", "Cross-Entropy", "simulation"]
    table = table.sort_values("stage", key=lambda column: column.map(stages.index), kind="stable")
    return table.assign(data=source).reset_index(drop=True)


def estimates_table(estimates: pd.DataFrame, source: str) -> pd.DataFrame:
    """Arrange the estimates of all replicates, methods and scopes for publication."""
    return estimates[list(ESTIMATE_COLUMNS)].assign(data=source)


def probability_table(estimates: pd.DataFrame, course: pd.DataFrame, alpha: float) -> pd.DataFrame:
    """Compare the estimates at convergence with the pooled one, a row for each scope and method.

    Returns
    -------
    pandas.DataFrame
        scope, method, pooled, ci_low, ci_high; at_convergence, the mean over the replicates; covering, how
        many of their intervals hold the pooled estimate, of how many replicates.
    """
    rows = []
    for (scope, method), ends in estimates.groupby(["scope", "method"], sort=False):
        pooled = pooled_probability(course, method, alpha, scope)
        covering = ends["ci_low"].le(pooled.value) & ends["ci_high"].ge(pooled.value)
        rows.append(
            {
                "scope": scope,
                "method": method,
                "pooled": pooled.value,
                "ci_low": pooled.low,
                "ci_high": pooled.high,
                "at_convergence": ends["probability"].mean(),
                "covering": int(covering.sum()),
                "replicates": len(ends),
            }
        )
    return pd.DataFrame(rows)


def weight_health(estimates: pd.DataFrame) -> pd.DataFrame:
    """Digest the weights at convergence, a row for each scope and method.

    Returns
    -------
    pandas.DataFrame
        scope, method; means over the replicates of simulations, crashes, effective_sample_size and crashes
        for each effective one; the largest share that one crash has in any replicate; how many converged.
    """
    health = estimates.assign(crashes_per_effective=estimates["events"] / estimates["effective_sample_size"])
    return health.groupby(["scope", "method"], sort=False, as_index=False).agg(
        simulations=("simulations", "mean"),
        crashes=("events", "mean"),
        effective_sample_size=("effective_sample_size", "mean"),
        crashes_per_effective=("crashes_per_effective", "mean"),
        largest_weight_share=("largest_weight_share", "max"),
        converged=("converged", "sum"),
    )


def search_digest(trace: pd.DataFrame, source: str) -> pd.DataFrame:
    """Digest the traces, a row for each method and segment.

    Means over the seeds: iterations with an update, simulations (and their extremes), and of the last
    iteration the threshold reached, the crashes and the effective sample size of their weights; and how far
    the heuristic moved the truncation points [1/m] and [1/s].
    """
    first, last = (
        trace.groupby(["method", "segment", "seed"], sort=False).nth(row).reset_index(drop=True)
        for row in (0, -1)
    )
    knots = [f"inverse_{variable}_from_2" for variable in ("range", "ttc")]
    shift = last[knots] - first[knots]
    searches = last.assign(
        updates=last["iteration"] - 1,
        crash_share=last["crashes"] / last["simulations"],
        shift_range=shift[knots[0]],
        shift_ttc=shift[knots[1]],
    )
    digest = searches.groupby(["method", "segment"], sort=False).agg(
        seeds=("seed", "size"),
        iterations=("updates", "mean"),
        simulations=("simulations_total", "mean"),
        simulations_min=("simulations_total", "min"),
        simulations_max=("simulations_total", "max"),
        crash_share=("crash_share", "mean"),
        effective_sample_size=("effective_sample_size", "mean"),
        knot_shift_inverse_range_per_m=("shift_range", "mean"),
        knot_shift_inverse_ttc_per_s=("shift_ttc", "mean"),
    )
    return digest.reset_index().assign(data=source)
