"""The surrogate-guided sampler beside the paper's three methods, learning counted."""

import pandas as pd

from accelerated_evaluation.publishing.published import table

PHASES = ("search", "learn", "estimate")


def side_by_side(replicates: pd.DataFrame, scope: str) -> pd.DataFrame:
    """Tabulate what every replicate of every method costs and finds in one scope.

    Parameters
    ----------
    replicates
        As `Study.replicates` has them. A replicate of the paper's methods has learnt in the search whose f*
        it took, in all segments of the scope; one of the surrogate in the runs before its estimate.
    scope
        ``all`` or the name of a segment.

    Returns
    -------
    pandas.DataFrame
        method, replicate; the simulations for ``learning``, for ``estimating`` and ``together``; probability,
        ci_low, ci_high, converged.
    """
    columns = ["method", "replicate", "learning", "estimating", "together"]
    columns += ["probability", "ci_low", "ci_high", "converged"]
    return replicates.loc[replicates["scope"] == scope, columns].reset_index(drop=True)


@table("surrogate", digits=3)
def surrogate_table(replicates: pd.DataFrame, exact: pd.DataFrame) -> pd.DataFrame:
    """Compare the methods, a row for each scope and method.

    Parameters
    ----------
    replicates
        As in `side_by_side`.
    exact
        ``exact.csv`` of a study.

    Returns
    -------
    pandas.DataFrame
        scope, method, replicates; means over them of the simulations for ``learning``, for ``estimating`` and
        ``together``, the largest in ``together_max``; ``to_exact`` and ``to_exact_sd``, mean and standard
        deviation of estimate / exact; how many of the intervals hold the exact value, ``holding``; how many
        converged; and the largest bound on the probability of a half-space that no run met, ``unseen_mode``,
        NaN for methods that have none.
    """
    tables = []
    for scope in replicates["scope"].unique():
        truth = exact.set_index("segment").loc[scope, "probability"]
        rows = side_by_side(replicates, scope)
        rows["unseen_mode"] = replicates.loc[replicates["scope"] == scope, "unseen_mode"].to_numpy()
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
            unseen_mode=("unseen_mode", "max"),
        )
        tables.append(means.assign(scope=scope)[["scope", *means.columns]])
    return pd.concat(tables, ignore_index=True)
