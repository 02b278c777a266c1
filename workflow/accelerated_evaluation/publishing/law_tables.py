"""Tables about laws with dependence: their scores, their calibration, the answer and what it depends on."""

import pandas as pd

from accelerated_evaluation.publishing.published import table

DIGITS = 3


def without_details(laws: pd.DataFrame) -> pd.DataFrame:
    """Return the columns of the scores that a reader needs, laws with no weight last."""
    shown = ["law", "gain_inverse_ttc_0.25", "gain_inverse_ttc_0.35", "gain_inverse_ttc_0.45"]
    return laws[[*shown, "behind", "weight", "stacking", "probability", "refused"]]


def of_the_answer(calibration: pd.DataFrame) -> pd.DataFrame:
    """Return the calibration of all laws together, which are the first."""
    return calibration[calibration["law"] == calibration["law"].iloc[0]].drop(columns="law")


@table("laws", digits=DIGITS, digest=without_details)
def laws_table(laws: pd.DataFrame) -> pd.DataFrame:
    """Tabulate held-out scores, weights and verdicts of all laws (``laws.csv`` of a study)."""
    return laws


@table("calibration", digits=DIGITS, digest=of_the_answer)
def calibration_table(calibration: pd.DataFrame) -> pd.DataFrame:
    """Tabulate recorded and expected counts near the crash set (``calibration.csv`` of a study)."""
    return calibration


@table("answer", digits=DIGITS)
def answer_table(answer: pd.DataFrame) -> pd.DataFrame:
    """Tabulate the probabilities of crashes and near misses (``answer.csv`` of a study)."""
    return answer


@table("answer_budget", digits=DIGITS)
def answer_budget_table(answer_budget: pd.DataFrame) -> pd.DataFrame:
    """Tabulate where the uncertainty of the answer comes from (``answer_budget.csv`` of a study)."""
    return answer_budget


@table("answer_thresholds", digits=DIGITS)
def answer_thresholds_table(answer_thresholds: pd.DataFrame) -> pd.DataFrame:
    """Tabulate the answer as each threshold alone gives it (``answer_thresholds.csv`` of a study)."""
    return answer_thresholds


@table("data_quality", digits=DIGITS)
def data_quality_table(data_quality: pd.DataFrame) -> pd.DataFrame:
    """Tabulate the answer under other readings of the records (``data_quality.csv`` of a study)."""
    return data_quality


def calibration_verdict(calibration: pd.DataFrame) -> pd.DataFrame:
    """Count for each law the cells outside their limits, and the most extreme p-value.

    Parameters
    ----------
    calibration
        ``calibration.csv`` of a study.

    Returns
    -------
    pandas.DataFrame
        Columns ``law``, ``cells``, ``outside`` and ``smallest_p_value``.
    """
    groups = calibration.groupby("law", sort=False)
    counts = {"cells": groups.size(), "outside": groups["within"].apply(lambda within: int((~within).sum()))}
    return pd.DataFrame(counts).assign(smallest_p_value=groups["p_value"].min()).reset_index()


def threshold_ratio(answer_thresholds: pd.DataFrame) -> float:
    """Return how many times the largest answer of a single threshold is the smallest."""
    return float(answer_thresholds["probability"].max() / answer_thresholds["probability"].min())


def stated_margin(crash_places: pd.DataFrame, level: float = 0.95) -> float:
    """Return by how much [m/s] the crashes of a law are faster than any record at like range, but for a rest.

    Parameters
    ----------
    crash_places
        ``crash_places.csv`` of a study.
    level
        Share of the crashes, of the worst law, that lie within the margin.
    """
    return float(crash_places.groupby("law")["beyond_recorded"].quantile(level).max())
