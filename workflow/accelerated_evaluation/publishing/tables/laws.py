"""Tables, beyond the paper, of the laws with dependence, and of the answer: the crash probability."""

import pandas as pd

from accelerated_evaluation.answer.candidates.calibration import HOST
from accelerated_evaluation.answer.consequences.all_cut_ins import ALL
from accelerated_evaluation.answer.consequences.lead_motion import motion_budget
from accelerated_evaluation.answer.ways.posterior import CONTRADICTED, LEVELS
from accelerated_evaluation.publishing.published import result_table, table
from accelerated_evaluation.publishing.tables.display import readable, repeated, vehicles_in_words
from accelerated_evaluation.records.verdict import Verdict

LEVELS_SHOWN = (80, 95)  # [%], of intervals in short tables
WIDEST = 6  # largest number of columns of a short table
DIGITS = 2  # significant digits of probabilities, which are enough for their wide intervals
# Columns of the ratios to a reference vehicle: prefix in the table, and headings of median
# and interval in the short table.
RATIOS = {"": ("ratio", "80 % of ratio"), "human_": ("ratio to human", None)}


def with_intervals(rows: pd.DataFrame) -> pd.DataFrame:
    """Return a short table: the median, the 80 and 95 % intervals as text, and the mean if there is room.

    The other columns are in front, without the mean rate per kilometre. The mean, often ``probability``, is
    left out if more than `WIDEST` columns would otherwise differ between rows.
    """
    limits = [f"{end}{100 * level:.0f}" for level in LEVELS for end in ("low", "high")]
    ends = {
        f"{level} %": interval_column(rows[f"low{level}"], rows[f"high{level}"]) for level in LEVELS_SHOWN
    }
    rows = rows.rename(columns={"probability": "mean"})
    front = rows.drop(columns=["median", "mean", "per_km", *limits], errors="ignore")
    shown = front.assign(median=rows["median"], **ends)
    has_room = len(shown.columns) - len(repeated(shown)) < WIDEST
    return shown.join(rows["mean"]) if has_room and "mean" in rows else shown


def interval_column(low: pd.Series, high: pd.Series) -> list[str]:
    """Write intervals as text, such as "0.1 to 0.2", with a dash if one of the limits is NaN."""
    known = low.notna() & high.notna()
    pairs = zip(low, high, known, strict=True)
    return [f"{readable(a, DIGITS)} to {readable(b, DIGITS)}" if known else "–" for a, b, known in pairs]


def with_limits(values: pd.Series, low: pd.Series, high: pd.Series) -> list[str]:
    """Write numbers with their intervals, such as "0.2 (0.1 to 0.3)", or alone if a limit is NaN."""
    ends = interval_column(low, high)
    return [
        readable(value, DIGITS) + ("" if end == "–" else f" ({end})")
        for value, end in zip(values, ends, strict=True)
    ]


def without_details(laws: pd.DataFrame) -> pd.DataFrame:
    """Return the main columns of the table of laws, with all rows in the same order.

    These are the gain of the held-out score over the paper's law in one region, the distance to the best law,
    the weight, the crash probability, and whether the law is rejected.
    """
    return laws[["law", "gain_inverse_ttc_0.35", "behind", "weight", "probability", "refused"]]


def of_the_answer(calibration: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a table of the calibration for the weighted mean of all laws.

    The weighted mean is the first law of the table.
    """
    rows = calibration[calibration["law"] == calibration["law"].iloc[0]]
    return rows.drop(columns=["law", "overdispersed"], errors="ignore")


def least_likely(calibration: pd.DataFrame) -> pd.DataFrame:
    """Return the counts of `of_the_answer` with their 90 % limits, the smallest p-value first."""
    rows = of_the_answer(calibration).sort_values("p_value", kind="stable")
    shown = ["where", "counted", "recorded", "expected", "90 %", "p_value"]
    return rows.assign(**{"90 %": interval_column(rows["low"], rows["high"])})[shown]


# The scores, weights and crash probabilities of all laws.
laws_table = result_table("laws", digits=3, digest=without_details)

# The joint laws of a scenario other than the cut-in, with their criteria, held-out scores and weights.
joint_laws_table = result_table("joint_laws", digits=6)

# Recorded and expected counts near the crash set.
calibration_table = result_table("calibration", digits=3, digest=least_likely)

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

    The ratios are left out if the scenario has no reference vehicles. A vehicle that counted crashes
    contradict is marked.
    """
    shown = vehicles[["vehicle", "median"]]
    marks = vehicles[CONTRADICTED].map({True: " (contradicted by counts)", False: ""})
    shown = shown.assign(vehicle=vehicles_in_words(vehicles["vehicle"]) + marks)
    shown = shown.assign(**{"80 %": interval_column(vehicles["low80"], vehicles["high80"])})
    for prefix, (ratio, interval) in RATIOS.items():
        if f"{prefix}ratio" in vehicles:
            shown = shown.assign(**{ratio: vehicles[f"{prefix}ratio"]})
            if interval:
                limits = (vehicles[f"{prefix}ratio_{end}80"] for end in ("low", "high"))
                shown = shown.assign(**{interval: interval_column(*limits)})
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


def by_driver(predictions: pd.DataFrame) -> pd.DataFrame:
    """Return the expected crashes and near-crashes by driver or assumption, with their 90 % limits."""
    rows = predictions[predictions["event"].isin(["crash", "near-crash, 0.5 g"])]
    rows = rows.assign(expected=with_limits(rows["expected"], rows["low90"], rows["high90"]))
    wide = rows.pivot_table("expected", "driver", "event", aggfunc="first", sort=False)
    return wide.add_prefix("expected: ").rename_axis(columns=None).reset_index()


# Predicted and counted crashes and near-crashes of human drivers.
human_predictions_table = result_table("human_predictions", digits=2, digest=by_driver)


def with_factors(lead_motion: pd.DataFrame) -> pd.DataFrame:
    """Return the main columns of the table of crash probabilities with a changing lead speed.

    These are the probabilities with a constant and a changing lead speed, and their ratio with its error.
    """
    return lead_motion[["vehicle", "gap", "constant", "moving", "factor", "factor_error"]]


# The crash probabilities with a lead vehicle that changes its speed.
lead_motion_table = result_table("lead_motion", digits=2, digest=with_factors)


def rates_of_all_cut_ins(all_cut_ins: pd.DataFrame) -> pd.DataFrame:
    """Return a short table: all parts of the rate of the first vehicle, and the sums of the others.

    The rates are per kilometre, or per closing cut-in if the distance is not known.
    """
    is_first = all_cut_ins["vehicle"] == all_cut_ins["vehicle"].iloc[0] if len(all_cut_ins) else True
    rows = all_cut_ins[is_first | (all_cut_ins["part"] == ALL)]
    per = rows["per"] == "kilometre"
    rows = with_intervals((rows[per] if per.any() else rows).drop(columns="mean"))
    return rows[["vehicle", "part", "per", "median", "80 %", "in_hundred_car"]]


# One crash rate of all cut-ins, by its parts.
all_cut_ins_table = result_table("all_cut_ins", digits=DIGITS, digest=rates_of_all_cut_ins)


# Tests that regulations prescribe, by vehicle.
prescribed_table = result_table("prescribed")

# Crash probabilities with other steps of the simulation.
numerical_error_table = result_table("numerical_error", digits=3)


def worst_of_each_table(second_ways: pd.DataFrame) -> pd.DataFrame:
    """Return the number of each table that is furthest from its second one, the furthest of all first."""
    off = second_ways["difference"].abs().dropna()
    worst = off.groupby(second_ways["table"], sort=False).idxmax()
    shown = second_ways.loc[off[worst].sort_values(ascending=False, kind="stable").index]
    shown = shown.assign(row=shown["row"] + ", " + shown["column"])
    return shown[["table", "row", "number", "second", "difference"]]


# Every published number with the same by a second way.
second_ways_table = result_table("second_ways", digits=3, digest=worst_of_each_table)
