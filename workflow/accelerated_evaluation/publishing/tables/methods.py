"""Tables that compare the methods by their estimates, and the vehicle with published verdicts."""

import pandas as pd

from accelerated_evaluation.publishing.published import table

DIGITS = 3
PHASES = ("search", "learn", "estimate")


@table("scenario_methods", digits=DIGITS)
def methods_table(scenario_estimates: pd.DataFrame) -> pd.DataFrame:
    """Summarise the replicates of each law and method. The simulations include those for learning.

    The exact probability and its relative error are from a scan, where the scenario has one.
    """
    rows = scenario_estimates.assign(
        simulations=scenario_estimates["learning"] + scenario_estimates["estimating"]
    )
    return (
        rows.groupby(["law", "event", "method"], sort=False)
        .agg(
            replicates=("replicate", "size"),
            converged=("converged", "sum"),
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
