"""Beyond the paper: tables of the laws with dependence, and of the answer."""

import pandas as pd

from accelerated_evaluation.answer.calibration import HOST
from accelerated_evaluation.answer.motion_budget import motion_budget
from accelerated_evaluation.answer.posterior import LEVELS
from accelerated_evaluation.publishing.published import result_table, table
from accelerated_evaluation.publishing.tables.formats import readable

DIGITS = 2  # of a probability whose interval spans a factor


def with_intervals(rows: pd.DataFrame) -> pd.DataFrame:
    """Combine both ends of each interval into one column, for readability.

    Parameters
    ----------
    rows
        Table with the columns ``low50`` and ``high50``, and so on.
    """
    levels = [f"{100 * level:.0f}" for level in LEVELS]
    ends = {f"{level} %": interval_column(rows[f"low{level}"], rows[f"high{level}"]) for level in levels}
    return rows.drop(columns=[f"{end}{level}" for level in levels for end in ("low", "high")]).assign(**ends)


def interval_column(low: pd.Series, high: pd.Series) -> list[str]:
    """Write intervals as text, and a dash if an end is unknown."""
    known = low.notna() & high.notna()
    pairs = zip(low, high, known, strict=True)
    return [f"{readable(a, DIGITS)} to {readable(b, DIGITS)}" if known else "–" for a, b, known in pairs]


def without_details(laws: pd.DataFrame) -> pd.DataFrame:
    """Return the columns of the scores for a reader, with laws of weight zero last."""
    shown = ["law", "gain_inverse_ttc_0.25", "gain_inverse_ttc_0.35", "gain_inverse_ttc_0.45"]
    return laws[[*shown, "behind", "weight", "stacking", "probability", "refused"]]


def of_the_answer(calibration: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of the calibration that belong to all laws together, which come first."""
    return calibration[calibration["law"] == calibration["law"].iloc[0]].drop(columns="law")


# The scores, weights and crash probabilities of all laws.
laws_table = result_table("laws", digits=3, digest=without_details)

# Recorded and expected counts near the crash set.
calibration_table = result_table("calibration", digits=3, digest=of_the_answer)


@table("answer", digits=DIGITS, digest=with_intervals)
def answer_table(answer: pd.DataFrame, stops: list[str]) -> pd.DataFrame:
    """Return the probabilities of a crash and of near misses in the published form."""
    return answer.assign(records=f"STOP: {', '.join(stops)}") if stops else answer


# The rates per kilometre and hour.
exposure_table = result_table("exposure", digits=DIGITS, digest=with_intervals)


def rates_in_words(exposure: pd.DataFrame) -> str:
    """Return sentences with the crash rate per million kilometres and hours, if the exposure is known."""
    crashes = exposure[exposure["event"] == "crash"]
    if crashes.empty:
        return "In how many kilometres or hours the records were made is not known, so there is no rate."
    medians = [
        f"{readable(1e6 * row.median, DIGITS)} (80 % interval {readable(1e6 * row.low80, DIGITS)} to "
        f"{readable(1e6 * row.high80, DIGITS)}) per million {row.per}s"
        for row in crashes.itertuples()
    ]
    return f"**Crashes of cut-ins, median: {' and '.join(medians)}.**"


@table("answer_budget", digits=3)
def answer_budget_table(answer_budget: pd.DataFrame, lead_motion: pd.DataFrame) -> pd.DataFrame:
    """Return the sources of the uncertainty of the answer in the published form.

    If lead motion was studied for the vehicle under test, the last row is what not knowing it adds
    (`answer.motion_budget`). The other rows are for a lead vehicle that keeps its speed.
    """
    together = answer_budget.set_index("source").loc["together", "factor"]
    motion = motion_budget(lead_motion, "under test", together)
    return pd.concat([answer_budget, motion], ignore_index=True) if len(motion) else answer_budget


def thresholds_digest(answer_thresholds: pd.DataFrame) -> pd.DataFrame:
    """Return the answer by threshold with unrounded levels, which two digits would not distinguish."""
    levels = answer_thresholds["level"].map("{:g}".format)
    return with_intervals(answer_thresholds.assign(level=levels))


# The answer for each threshold alone.
answer_thresholds_table = result_table("answer_thresholds", digits=DIGITS, digest=thresholds_digest)

# The answer for alternative treatments of the records.
data_quality_table = result_table("data_quality", digits=DIGITS, digest=with_intervals)


def vehicles_digest(vehicles: pd.DataFrame) -> pd.DataFrame:
    """Return the columns of compared vehicles for a reader: probability and ratio with 80 % intervals."""
    return pd.DataFrame(
        {
            "vehicle": vehicles["vehicle"],
            "recorded": vehicles["recorded"],
            "expected": vehicles["expected"],
            "median": vehicles["median"],
            "80 %": interval_column(vehicles["low80"], vehicles["high80"]),
            "ratio": vehicles["ratio"],
            "80 % of ratio": interval_column(vehicles["ratio_low80"], vehicles["ratio_high80"]),
            "safer": vehicles["safer"],
            "ratio to human": vehicles["human_ratio"],
            "80 % of it": interval_column(vehicles["human_ratio_low80"], vehicles["human_ratio_high80"]),
            "safer than human": vehicles["human_safer"],
        }
    )


# The comparison of vehicles.
vehicles_table = result_table("vehicles", digits=DIGITS, digest=vehicles_digest)


def calibration_verdict(calibration: pd.DataFrame) -> pd.DataFrame:
    """Count for each law the cells outside their limits, and the most extreme p-value.

    Parameters
    ----------
    calibration
        ``calibration.csv`` of a study.

    Returns
    -------
    pandas.DataFrame
        ``law``; ``cells``, ``outside`` and ``smallest_p_value`` of the counts near the crash set;
        ``host_cells``, ``host_outside`` and ``host_smallest_p_value`` of those by lead and host speed.
    """
    is_host = calibration["counted"] == HOST
    near, host = (_verdict(calibration[chosen]) for chosen in (~is_host, is_host))
    return near.join(host.add_prefix("host_")).reset_index()


def _verdict(calibration: pd.DataFrame) -> pd.DataFrame:
    groups = calibration.groupby("law", sort=False)
    counts = {"cells": groups.size(), "outside": groups["within"].apply(lambda within: int((~within).sum()))}
    return pd.DataFrame(counts).assign(smallest_p_value=groups["p_value"].min())


def threshold_ratio(answer_thresholds: pd.DataFrame) -> float:
    """Return the ratio of the largest to the smallest answer of a single threshold."""
    return float(answer_thresholds["probability"].max() / answer_thresholds["probability"].min())


def stated_margin(crash_places: pd.DataFrame, level: float = 0.95) -> float:
    """Return by how much crashes close faster than any record at a similar range [m/s].

    Parameters
    ----------
    crash_places
        ``crash_places.csv`` of a study.
    level
        Share of the crashes that lie within the margin, for the law with the largest margin.
    """
    if crash_places.empty:  # the vehicle never crashes
        return float("nan")
    return float(crash_places.groupby("law")["beyond_recorded"].quantile(level).max())


def without_sources(counted: pd.DataFrame) -> pd.DataFrame:
    """Return the columns that a reader needs, both limits of a rate in one."""
    shown = ["who", "what", "count", "per_million_miles", "95 %", "in_hundred_car", "verdict"]
    return counted.assign(**{"95 %": interval_column(counted["low95"], counted["high95"])})[shown]


# Predicted and counted crash rates.
counted_crashes_table = result_table("counted_crashes", digits=2, digest=without_sources)


def with_limits_in_one(predictions: pd.DataFrame) -> pd.DataFrame:
    """Return the predicted numbers of crashes and near-crashes, both limits of a count in one column."""
    shown = ["driver", "event", "expected", "90 %", "counted", "verdict"]
    return predictions.assign(**{"90 %": interval_column(predictions["low90"], predictions["high90"])})[shown]


# Predicted and counted crashes and near-crashes of human drivers.
human_predictions_table = result_table("human_predictions", digits=2, digest=with_limits_in_one)


def with_errors(lead_motion: pd.DataFrame) -> pd.DataFrame:
    """Return the columns that a reader needs of crash probabilities with lead motion."""
    shown = ["vehicle", "gap", "constant", "moving", "standard_error", "high95", "factor", "factor_error"]
    return lead_motion[shown]


# The crash probabilities with a lead vehicle that changes its speed.
lead_motion_table = result_table("lead_motion", digits=2, digest=with_errors)
