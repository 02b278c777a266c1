"""Tables of the study of another scenario than the cut-in."""

import pandas as pd

from accelerated_evaluation.publishing.published import table

DIGITS = 3


@table("scenario_records", digits=DIGITS)
def records_table(scenario_records: pd.DataFrame) -> pd.DataFrame:
    """Return the account of the records: a row for each variable."""
    return scenario_records


@table("scenario_laws", digits=6)
def laws_table(scenario_laws: pd.DataFrame) -> pd.DataFrame:
    """Return the laws with their criteria, held-out scores and weights."""
    return scenario_laws


@table("scenario_answer", digits=DIGITS)
def answer_table(scenario_answer: pd.DataFrame) -> pd.DataFrame:
    """Return the probability of each event with its intervals."""
    return scenario_answer


@table("scenario_budget", digits=DIGITS)
def budget_table(scenario_budget: pd.DataFrame) -> pd.DataFrame:
    """Return where the uncertainty of the crash probability comes from."""
    return scenario_budget


@table("scenario_crash_shares", digits=DIGITS)
def crash_shares_table(scenario_crash_shares: pd.DataFrame) -> pd.DataFrame:
    """Return which encounters the crashes come from, by the size of a variable."""
    return scenario_crash_shares


@table("scenario_methods", digits=DIGITS)
def methods_table(scenario_estimates: pd.DataFrame) -> pd.DataFrame:
    """Return the mean estimate and the mean number of simulations of each method, and who converged."""
    rows = scenario_estimates.assign(
        simulations=scenario_estimates["learning"] + scenario_estimates["estimating"]
    )
    return (
        rows.groupby(["law", "method"], sort=False)
        .agg(
            replicates=("replicate", "size"),
            converged=("converged", "sum"),
            probability=("probability", "mean"),
            lowest=("probability", "min"),
            highest=("probability", "max"),
            simulations=("simulations", "mean"),
            events=("events", "mean"),
        )
        .reset_index()
    )


@table("scenario_agreement")
def agreement_table(scenario_agreement: pd.DataFrame) -> pd.DataFrame:
    """Return how many published verdicts the vehicle reproduces."""
    share = scenario_agreement["agree"] / scenario_agreement["verdicts"]
    return scenario_agreement.assign(share=share.round(6))
