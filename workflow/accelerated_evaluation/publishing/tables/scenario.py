"""Tables of a study of a scenario other than the cut-in."""

import pandas as pd

from accelerated_evaluation.publishing.published import result_table, table
from accelerated_evaluation.records.verdict import Verdict

DIGITS = 3


# The account of the records: a row for each variable.
records_table = result_table("scenario_records", result="account", digits=DIGITS)

# The laws with their criteria, held-out scores and weights.
laws_table = result_table("scenario_laws", result="laws", digits=6)


@table("scenario_answer", digits=DIGITS)
def answer_table(answer: pd.DataFrame, verdict: Verdict) -> pd.DataFrame:
    """Return the probability of each event with its intervals, and the verdict on the records.

    If a check found a fault, a column ``records`` names it.
    """
    return verdict.added_to(answer)


# Where the uncertainty of the crash probability comes from.
budget_table = result_table("scenario_budget", result="answer_budget", digits=DIGITS)

# Which encounters the crashes come from, by the size of a variable.
crash_shares_table = result_table("scenario_crash_shares", result="crash_shares", digits=DIGITS)


@table("scenario_methods", digits=DIGITS)
def methods_table(scenario_estimates: pd.DataFrame) -> pd.DataFrame:
    """Summarise the replicates of each law and method. The simulations include those for learning."""
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
        )
        .reset_index()
    )


@table("scenario_agreement")
def agreement_table(scenario_agreement: pd.DataFrame) -> pd.DataFrame:
    """Return the table of the published verdicts on crashes, with the share that the vehicle reproduces."""
    share = scenario_agreement["agree"] / scenario_agreement["verdicts"]
    return scenario_agreement.assign(share=share.round(6))
