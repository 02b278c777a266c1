"""The surrogate-guided sampler beside the paper's three methods, learning counted."""

import pandas as pd

from accelerated_evaluation.publishing.published import table
from accelerated_evaluation.publishing.search_tables import search_totals
from accelerated_evaluation.publishing.spreads import of_method

PHASES = ("search", "learn", "estimate")


def side_by_side(
    estimates: pd.DataFrame, trace: pd.DataFrame, surrogate: pd.DataFrame, runs: pd.DataFrame, scope: str
) -> pd.DataFrame:
    """Tabulate what every replicate of the four methods costs and finds in one scope.

    Parameters
    ----------
    estimates, trace, surrogate, runs
        ``estimates.csv``, ``cross_entropy_trace.csv``, ``surrogate.csv`` and ``surrogate_runs.csv`` of a
        study.

    Returns
    -------
    pandas.DataFrame
        method, replicate; the simulations for ``learning``, for ``estimating`` and ``together``; probability,
        ci_low, ci_high, converged. A replicate of the paper's methods has learnt in the search whose f* it
        took, in all segments of the scope; one of the surrogate in the runs that do not enter its estimate.
    """
    searched = search_totals(trace if scope == "all" else trace[trace["segment"] == scope])
    learning = runs[runs["phase"] != PHASES[-1]].groupby(["scope", "replicate"]).size()
    everything = pd.concat([estimates, surrogate], ignore_index=True)
    parts = []
    for method in everything["method"].unique():
        rows = of_method(everything, method, scope).copy()
        if method in searched:
            search = searched[method]
            rows["learning"] = search.to_numpy()[rows["replicate"] % len(search)].astype(int)
            rows["estimating"] = rows["simulations"]
            rows["together"] = rows["learning"] + rows["estimating"]
        else:
            rows["learning"] = learning[scope].reindex(rows["replicate"], fill_value=0).to_numpy()
            rows["together"] = rows["simulations"]
            rows["estimating"] = rows["together"] - rows["learning"]
        parts.append(rows)
    columns = ["method", "replicate", "learning", "estimating", "together"]
    columns += ["probability", "ci_low", "ci_high", "converged"]
    return pd.concat(parts, ignore_index=True)[columns]


@table("surrogate", digits=3)
def surrogate_table(
    estimates: pd.DataFrame,
    trace: pd.DataFrame,
    surrogate: pd.DataFrame,
    runs: pd.DataFrame,
    exact: pd.DataFrame,
) -> pd.DataFrame:
    """Compare the four methods, a row for each scope and method.

    Parameters
    ----------
    estimates, trace, surrogate, runs
        As in `side_by_side`.
    exact
        ``exact.csv`` of a study.

    Returns
    -------
    pandas.DataFrame
        scope, method, replicates; means over them of the simulations for ``learning``, for ``estimating`` and
        ``together``, the largest in ``together_max``; ``to_exact`` and ``to_exact_sd``, mean and standard
        deviation of estimate / exact; how many of the intervals hold the exact value, ``holding``; how many
        converged.
    """
    tables = []
    for scope in surrogate["scope"].unique():
        truth = exact.set_index("segment").loc[scope, "probability"]
        rows = side_by_side(estimates, trace, surrogate, runs, scope)
        rows["ratio"] = rows["probability"] / truth
        rows["held"] = rows["ci_low"].le(truth) & rows["ci_high"].ge(truth)
        means = rows.groupby("method", sort=False, as_index=False).agg(
            replicates=("replicate", "size"),
            learning=("learning", "mean"),
            estimating=("estimating", "mean"),
            together=("together", "mean"),
            together_max=("together", "max"),
            to_exact=("ratio", "mean"),
            to_exact_sd=("ratio", "std"),
            holding=("held", "sum"),
            converged=("converged", "sum"),
        )
        tables.append(means.assign(scope=scope)[["scope", *means.columns]])
    return pd.concat(tables, ignore_index=True)
