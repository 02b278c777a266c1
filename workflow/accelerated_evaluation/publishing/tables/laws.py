"""Tables, beyond the paper, of the laws with dependence, and of the answer: the crash probability."""

import pandas as pd

from accelerated_evaluation.answer.all_cut_ins import ALL
from accelerated_evaluation.answer.calibration import HOST
from accelerated_evaluation.answer.lead_motion import motion_budget
from accelerated_evaluation.answer.posterior import LEVELS
from accelerated_evaluation.publishing.published import result_table, table
from accelerated_evaluation.publishing.tables.display import readable
from accelerated_evaluation.records.verdict import Verdict

DIGITS = 2  # significant digits of probabilities, which are enough for their wide intervals
# Columns of the ratios to a reference vehicle: prefix in the table, and headings in the short table.
RATIOS = {
    "": ("ratio", "80 % of ratio", "safer"),
    "human_": ("ratio to human", "80 % of it", "safer than human"),
}


def with_intervals(rows: pd.DataFrame) -> pd.DataFrame:
    """Replace the limits ``low50`` to ``high95`` of each interval by one column of text at the end."""
    levels = [f"{100 * level:.0f}" for level in LEVELS]
    ends = {f"{level} %": interval_column(rows[f"low{level}"], rows[f"high{level}"]) for level in levels}
    return rows.drop(columns=[f"{end}{level}" for level in levels for end in ("low", "high")]).assign(**ends)


def interval_column(low: pd.Series, high: pd.Series) -> list[str]:
    """Write intervals as text, such as "0.1 to 0.2", with a dash if one of the limits is NaN."""
    known = low.notna() & high.notna()
    pairs = zip(low, high, known, strict=True)
    return [f"{readable(a, DIGITS)} to {readable(b, DIGITS)}" if known else "–" for a, b, known in pairs]


def without_details(laws: pd.DataFrame) -> pd.DataFrame:
    """Return the main columns of the table of laws, with all rows in the same order.

    These are the gains of the held-out scores over the paper's law in three regions, the weights, the crash
    probability, and whether the law is rejected.
    """
    shown = ["law", "gain_inverse_ttc_0.25", "gain_inverse_ttc_0.35", "gain_inverse_ttc_0.45"]
    return laws[[*shown, "behind", "weight", "stacking", "probability", "refused"]]


def of_the_answer(calibration: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a table of the calibration for the weighted mean of all laws.

    The weighted mean is the first law of the table.
    """
    return calibration[calibration["law"] == calibration["law"].iloc[0]].drop(columns="law")


# The scores, weights and crash probabilities of all laws.
laws_table = result_table("laws", digits=3, digest=without_details)

# The joint laws of a scenario other than the cut-in, with their criteria, held-out scores and weights.
joint_laws_table = result_table("joint_laws", digits=6)

# Recorded and expected counts near the crash set.
calibration_table = result_table("calibration", digits=3, digest=of_the_answer)

# The same counts by block of the records.
fold_calibration_table = result_table("fold_calibration", digits=3, digest=of_the_answer)


@table("answer", digits=DIGITS, digest=with_intervals)
def answer_table(answer: pd.DataFrame, verdict: Verdict) -> pd.DataFrame:
    """Return the table of the probabilities of a crash and of near misses for publication.

    If a check of the records found a fault, a column ``records`` names it.
    """
    return verdict.added_to(answer)


# Which encounters the crashes come from, by the size of a variable.
crash_shares_table = result_table("crash_shares", digits=3)

# The ratios of the vehicle under test to the references.
compared_table = result_table("compared", digits=DIGITS)


# The rates per kilometre and hour.
exposure_table = result_table("exposure", digits=DIGITS, digest=with_intervals)


@table("answer_budget", digits=3)
def answer_budget_table(answer_budget: pd.DataFrame, lead_motion: pd.DataFrame | None = None) -> pd.DataFrame:
    """Return the budget of the uncertainty of the crash probability, by source, for publication.

    It is for a lead vehicle that keeps its speed. If lead motion was studied for the vehicle under test, a
    last row contains the contribution of the unknown lead motion (`answer.lead_motion.motion_budget`).
    """
    if lead_motion is None or answer_budget.empty:
        return answer_budget
    together = answer_budget.set_index("source").loc["together", "factor"]
    motion = motion_budget(lead_motion, "under test", together)
    return pd.concat([answer_budget, motion], ignore_index=True) if len(motion) else answer_budget


def thresholds_digest(answer_thresholds: pd.DataFrame) -> pd.DataFrame:
    """Return a short table of the crash probability by the threshold of the laws' tails.

    The thresholds are written with all digits, because some of them are equal if they are rounded to two
    digits.
    """
    levels = answer_thresholds["level"].map("{:g}".format)
    return with_intervals(answer_thresholds.assign(level=levels))


# The answer for each threshold alone.
answer_thresholds_table = result_table("answer_thresholds", digits=DIGITS, digest=thresholds_digest)

# The answer for alternative treatments of the records.
data_quality_table = result_table("data_quality", digits=DIGITS, digest=with_intervals)


def vehicles_digest(vehicles: pd.DataFrame) -> pd.DataFrame:
    """Return a short table of compared vehicles: crash probabilities and ratios with 80 % intervals.

    The ratios are left out if the scenario has no reference vehicles.
    """
    shown = vehicles[["vehicle", "recorded", "expected", "median"]]
    shown = shown.assign(**{"80 %": interval_column(vehicles["low80"], vehicles["high80"])})
    for prefix, (ratio, interval, safer) in RATIOS.items():
        if f"{prefix}ratio" in vehicles:
            ends = interval_column(vehicles[f"{prefix}ratio_low80"], vehicles[f"{prefix}ratio_high80"])
            columns = {ratio: vehicles[f"{prefix}ratio"], interval: ends, safer: vehicles[f"{prefix}safer"]}
            shown = shown.assign(**columns)
    return shown


# The comparison of vehicles.
vehicles_table = result_table("vehicles", digits=DIGITS, digest=vehicles_digest)


def calibration_verdict(calibration: pd.DataFrame) -> pd.DataFrame:
    """Count for each law the cells in which the recorded and the expected number of cut-ins disagree.

    A cell is a region of the cut-ins. The numbers disagree if the recorded one is outside the prediction
    limits of the law. ``smallest_p_value`` and the other numbers are for the cells near the crash set. Those
    that begin with ``host_`` are for cells of lead speed and host speed.
    """
    is_host = calibration["counted"] == HOST
    near, host = (_verdict(calibration[chosen]) for chosen in (~is_host, is_host))
    return near.join(host.add_prefix("host_")).reset_index()


def _verdict(calibration: pd.DataFrame) -> pd.DataFrame:
    groups = calibration.groupby("law", sort=False)
    counts = {"cells": groups.size(), "outside": groups["within"].apply(lambda within: int((~within).sum()))}
    return pd.DataFrame(counts).assign(smallest_p_value=groups["p_value"].min())


def without_sources(counted: pd.DataFrame) -> pd.DataFrame:
    """Return a short table of predicted and counted crash rates, without the columns of references.

    The 95 % limits of a rate [per million miles] are in one column.
    """
    shown = ["who", "what", "count", "per_million_miles", "95 %", "in_hundred_car", "verdict"]
    return counted.assign(**{"95 %": interval_column(counted["low95"], counted["high95"])})[shown]


# Predicted and counted crash rates.
counted_crashes_table = result_table("counted_crashes", digits=2, digest=without_sources)


def with_limits_in_one(predictions: pd.DataFrame) -> pd.DataFrame:
    """Return a short table of predicted and counted crashes, with both 90 % limits in one column."""
    shown = ["driver", "event", "expected", "90 %", "counted", "verdict"]
    return predictions.assign(**{"90 %": interval_column(predictions["low90"], predictions["high90"])})[shown]


# Predicted and counted crashes and near-crashes of human drivers.
human_predictions_table = result_table("human_predictions", digits=2, digest=with_limits_in_one)


def with_errors(lead_motion: pd.DataFrame) -> pd.DataFrame:
    """Return the main columns of the table of crash probabilities with a changing lead speed.

    These are the probabilities with a constant and a changing lead speed, and their ratio, with errors.
    """
    shown = ["vehicle", "gap", "constant", "moving", "standard_error", "high95", "factor", "factor_error"]
    return lead_motion[shown]


# The crash probabilities with a lead vehicle that changes its speed.
lead_motion_table = result_table("lead_motion", digits=2, digest=with_errors)


def rates_of_all_cut_ins(all_cut_ins: pd.DataFrame) -> pd.DataFrame:
    """Return a short table: all parts of the rate of the first vehicle, and the sums of the others."""
    is_first = all_cut_ins["vehicle"] == all_cut_ins["vehicle"].iloc[0] if len(all_cut_ins) else True
    shown = all_cut_ins[is_first | (all_cut_ins["part"] == ALL)]
    rows = with_intervals(shown.drop(columns="mean"))
    return rows[["vehicle", "part", "per", "median", "80 %", "95 %", "upper95", "share", "in_hundred_car"]]


# One crash rate of all cut-ins, by its parts.
all_cut_ins_table = result_table("all_cut_ins", digits=DIGITS, digest=rates_of_all_cut_ins)


def passed_tests(prescribed: pd.DataFrame) -> pd.DataFrame:
    """Return which vehicles pass each prescribed test: a row for each test, and a column for each vehicle."""
    words = prescribed["passed"].map({True: "passed", False: "failed"})
    wide = prescribed.assign(passed=words).pivot_table(
        index=["source", "test"], columns="vehicle", values="passed", aggfunc="first", sort=False
    )
    return wide.reset_index().rename_axis(columns=None)


# Tests that regulations prescribe, by vehicle.
prescribed_table = result_table("prescribed", digest=passed_tests)

# Crash probabilities with other steps of the simulation.
numerical_error_table = result_table("numerical_error", digits=3)
