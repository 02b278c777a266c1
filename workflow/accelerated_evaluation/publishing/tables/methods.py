"""Tables that compare the methods by their estimates, and the vehicle with published verdicts."""

import numpy as np
import pandas as pd
from scipy.special import ndtri

from accelerated_evaluation.publishing.published import table

DIGITS = 3
FAR = 4.0  # number of combined standard errors from which on two estimates contradict each other


def contradicted(estimates: pd.DataFrame, alpha: float) -> pd.Series:
    """Return which converged estimates of a probability are contradicted by its other converged estimates.

    An estimate is compared with the exact probability if this is known, otherwise with the median of the
    logarithms of all converged estimates under the same law, whatever their method. It is contradicted if it
    is more than `FAR` combined standard errors away. The error of the logarithm of an estimate follows from
    its interval of the level 1 - ``alpha``. That of the median of n estimates is sqrt(pi / 2n) times their
    median error.
    """
    flags, width = pd.Series(False, index=estimates.index), 2 * ndtri(1 - alpha / 2)
    is_known = estimates["converged"].astype(bool) & (estimates[["probability", "ci_low"]] > 0).all(axis=1)
    known = estimates[is_known]
    for _, rows in known.groupby(["law", "event"]):
        logs, errors = np.log(rows["probability"]), np.log(rows["ci_high"] / rows["ci_low"]) / width
        middle, error = rows[["exact", "exact_error"]].iloc[0]
        if not middle > 0:
            middle, error = np.exp(logs.median()), errors.median() * np.sqrt(np.pi / 2 / len(rows))
        flags[rows.index] = np.abs(logs - np.log(middle)) > FAR * np.hypot(errors, error)
    return flags


def without_extremes(methods: pd.DataFrame) -> pd.DataFrame:
    """Return the main columns of the table of methods."""
    return methods[["law", "method", "converged", "contradicted", "probability", "simulations"]]


@table("scenario_methods", digits=DIGITS, digest=without_extremes)
def methods_table(scenario_estimates: pd.DataFrame, alpha: float) -> pd.DataFrame:
    """Summarise the replicates of each law and method. The simulations include those for learning.

    The exact probability and its relative error are from a scan, where the scenario has one. The column
    ``contradicted`` counts the converged replicates that the other estimates contradict (`contradicted`).
    """
    rows = scenario_estimates.assign(
        simulations=scenario_estimates["learning"] + scenario_estimates["estimating"],
        contradicted=contradicted(scenario_estimates, alpha),
    )
    return (
        rows.groupby(["law", "event", "method"], sort=False)
        .agg(
            replicates=("replicate", "size"),
            converged=("converged", "sum"),
            contradicted=("contradicted", "sum"),
            probability=("probability", "mean"),
            lowest=("probability", "min"),
            highest=("probability", "max"),
            simulations=("simulations", "mean"),
            events=("events", "mean"),
            exact=("exact", "first"),
            exact_error=("exact_error", "first"),
        )
        .reset_index()
    )


@table("agreement")
def agreement_table(scenario_agreement: pd.DataFrame) -> pd.DataFrame:
    """Return the table of the published verdicts on crashes, with the share that the vehicle reproduces."""
    share = scenario_agreement["agree"] / scenario_agreement["verdicts"]
    return scenario_agreement.assign(share=share.round(6))


def side_by_side(replicates: pd.DataFrame, scope: str) -> pd.DataFrame:
    """Tabulate simulations and estimates of every replicate of every method in one scope.

    For the paper's methods, the simulations for ``learning`` are those of the search whose f* the replicate
    uses, in all segments of the scope. For the surrogate, they are the runs before its estimate.
    """
    columns = ["method", "replicate", "learning", "estimating", "together"]
    columns += ["probability", "ci_low", "ci_high", "converged"]
    return replicates.loc[replicates["scope"] == scope, columns].reset_index(drop=True)


@table("surrogate", digits=3)
def surrogate_table(replicates: pd.DataFrame, exact: pd.DataFrame) -> pd.DataFrame:
    """Compare the methods, in a row for each scope and method.

    Mean numbers of simulations are for ``learning``, for ``estimating`` and ``together``. ``to_exact`` and
    ``to_exact_sd`` are mean and standard deviation of estimate / exact, ``holding`` the number of intervals
    that contain the exact value, and ``unseen_mode`` the largest bound on the probability of a half-space
    without any run, NaN for other methods.
    """
    tables = []
    for scope in replicates["scope"].unique():
        truth = exact.set_index("segment").loc[scope, "probability"]
        rows = side_by_side(replicates, scope)
        rows["unseen_mode"] = replicates.loc[replicates["scope"] == scope, "unseen_mode"].to_numpy()
        rows["ratio"] = rows["probability"] / truth
        rows["contains"] = rows["ci_low"].le(truth) & rows["ci_high"].ge(truth)
        means = rows.groupby("method", sort=False, as_index=False).agg(
            replicates=("replicate", "size"),
            learning=("learning", "mean"),
            estimating=("estimating", "mean"),
            together=("together", "mean"),
            together_max=("together", "max"),
            to_exact=("ratio", "mean"),
            to_exact_sd=("ratio", "std"),
            holding=("contains", "sum"),
            converged=("converged", "sum"),
            unseen_mode=("unseen_mode", "max"),
        )
        tables.append(means.assign(scope=scope)[["scope", *means.columns]])
    return pd.concat(tables, ignore_index=True)
