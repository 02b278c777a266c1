"""The paper's tables I and II compared with our numbers, all estimates, and diagnostics of their weights."""

import math

import pandas as pd

from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.publishing.published import table
from accelerated_evaluation.publishing.tables.laws import interval_column
from accelerated_evaluation.publishing.tables.paper_claims import (
    PAPER_PARAMETERS,
    PAPER_RATIOS,
    PAPER_SEARCHES,
    PAPER_SIMULATIONS,
)
from accelerated_evaluation.publishing.tables.searches import search_totals, searched_parameters
from accelerated_evaluation.publishing.tables.spreads import (
    Mean,
    Spread,
    crude_sample_size,
    exactly,
    pooled_probability,
    simulations_needed,
)

ESTIMATE_COLUMNS = (
    *("study", "method", "replicate", "probability", "ci_low", "ci_high", "simulations"),
    *("scope", "relative_half_width", "events", "effective_sample_size", "largest_weight_share", "converged"),
)


def in_six_columns(sizes: pd.DataFrame) -> pd.DataFrame:
    """Return table I with both limits of an interval in one column."""
    ends = interval_column(sizes["simulations_low"], sizes["simulations_high"])
    shown = ["method", "simulations", "95 %", "ratio_to_piecewise"]
    return sizes.assign(**{"95 %": ends})[[*shown, "paper_simulations", "paper_ratio_to_piecewise"]]


def simulations_alone(computed: pd.DataFrame) -> pd.DataFrame:
    """Return the simulations of table II, with both limits of an interval in one column."""
    rows = computed[computed["quantity"] == "simulations"]
    ends = interval_column(rows["ours_low"], rows["ours_high"])
    return rows.assign(**{"95 %": ends})[["stage", "method", "ours", "95 %", "paper"]]


@table("table1_sample_size", digits=3, digest=in_six_columns)
def table1_sample_size(
    estimates: pd.DataFrame, coverage: pd.DataFrame, exact: pd.DataFrame, alpha: float, beta: float
) -> pd.DataFrame:
    """Build table I: simulations to convergence by method, compared with the paper's.

    Convergence is a relative half-width of at most beta of the interval with level 1 - alpha. The interval of
    the mean is that of one more such mean, and numbers that the paper does not state are NaN.
    """
    sizes = {
        method: simulations_needed(estimates, coverage, method) for method in estimates["method"].unique()
    }
    sizes["crude"] = crude_sample_size(exact, alpha, beta)
    rows = [
        {
            "method": method,
            "simulations": sizes[method].value,
            "simulations_low": sizes[method].low,
            "simulations_high": sizes[method].high,
            "ratio_to_piecewise": sizes[method].value / sizes["piecewise"].value,
            "paper_simulations": PAPER_SIMULATIONS.get(method, math.nan),
            "paper_ratio_to_piecewise": PAPER_RATIOS.get(method, math.nan),
            "spread": sizes[method].of,
        }
        for method in dict.fromkeys([*PAPER_SIMULATIONS, *sizes])
    ]
    return pd.DataFrame(rows)


@table("table2_computation", digits=3, digest=simulations_alone)
def table2_computation(
    estimates: pd.DataFrame,
    coverage: pd.DataFrame,
    exact: pd.DataFrame,
    trace: pd.DataFrame,
    single: IndependentLaw,
    piecewise: IndependentLaw,
    alpha: float,
    beta: float,
) -> pd.DataFrame:
    """Build table II: numbers of parameters and simulations of each method by stage, and the paper's numbers.

    Every method except ``single`` accelerates the piecewise model. Convergence is that of
    `table1_sample_size`.
    """
    totals = search_totals(trace)
    size = table1_sample_size(estimates, coverage, exact, alpha, beta).set_index("method")
    rows = []
    for method in ("crude", *estimates["method"].unique()):
        if method in totals:
            fitted = (single if method == "single" else piecewise).n_parameters
            moved, found = searched_parameters(trace, method), len(totals[method])
            spent = Mean.of(totals[method]).further(f"search (from {found})")
            counts = [exactly(number, "none, a count") for number in (fitted, moved)]
            rows.append(("fitting", "parameters", method, counts[0], PAPER_PARAMETERS.get(method)))
            rows.append(("Cross-Entropy", "simulations", method, spent, PAPER_SEARCHES.get(method)))
            rows.append(("Cross-Entropy", "parameters", method, counts[1], PAPER_PARAMETERS.get(method)))
        row = size.loc[method]
        spent = Spread(row["simulations"], row["simulations_low"], row["simulations_high"], row["spread"])
        rows.append(("simulation", "simulations", method, spent, PAPER_SIMULATIONS.get(method)))
    computed = pd.DataFrame(
        [
            (stage, method, quantity, ours.value, ours.low, ours.high, paper, ours.of)
            for stage, quantity, method, ours, paper in rows
        ],
        columns=["stage", "method", "quantity", "ours", "ours_low", "ours_high", "paper", "spread"],
    )
    stages = ["fitting", "Cross-Entropy", "simulation"]
    computed = computed.sort_values("stage", key=lambda column: column.map(stages.index), kind="stable")
    return computed.reset_index(drop=True)


@table("estimates", digits=3)
def estimates_table(estimates: pd.DataFrame) -> pd.DataFrame:
    """Return the published columns of the estimates of all replicates, methods and scopes.

    A scope is one segment of the lead speed, or all segments.
    """
    return estimates[list(ESTIMATE_COLUMNS)]


@table("pooled", digits=3)
def probability_table(estimates: pd.DataFrame, course: pd.DataFrame, alpha: float) -> pd.DataFrame:
    """Compare the estimates at convergence with the pooled estimate of all replicates.

    The intervals have the level 1 - alpha. ``at_convergence`` is the mean estimate at convergence over the
    replicates, and ``covering`` the number of replicates whose interval contains the pooled estimate.
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
