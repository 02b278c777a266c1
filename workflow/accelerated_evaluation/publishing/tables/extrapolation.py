"""Tables of what the answer rests on: extrapolation, choices, and clusters of critical records."""

import pandas as pd

from accelerated_evaluation.answer.extrapolation import ALL, FAR, NEAR, RECORDED
from accelerated_evaluation.publishing.published import result_table
from accelerated_evaluation.publishing.tables.formats import readable
from accelerated_evaluation.publishing.tables.laws import interval_column, with_intervals

DIGITS = 2


def without_replay(extrapolation: pd.DataFrame) -> pd.DataFrame:
    """Return the parts of the answer with their 80 % intervals, and the numbers of replayed records."""
    shown = ["part", "share", "probability", "median", "80 %", "expected", "recorded"]
    ends = interval_column(extrapolation["low80"], extrapolation["high80"])
    return extrapolation.assign(**{"80 %": ends})[shown]


def rests_in_words(extrapolation: pd.DataFrame, *, by_speed: bool = True) -> str:
    """Return a paragraph that says how much of the answer lies beyond the records; empty without crashes.

    The parts are those of cut-ins, by closing speed, or otherwise those by distance from the records.
    """
    rows = extrapolation.set_index("part")
    if rows.empty or rows["share"].isna().any():
        return ""
    near, far = rows.loc[NEAR, "share"] + rows.loc[FAR, "share"], rows.loc[FAR, "share"]
    beyond = (
        f"{100 * near:.0f} % of the predicted crashes close faster than any record at a similar range, and "
        f"{100 * far:.0f} % faster than any record at all."
        if by_speed
        else f"{100 * near:.0f} % of the predicted crashes are farther from the nearest record than 95 % of "
        f"the records are from each other, and {100 * far:.0f} % farther than any record is."
    )
    whole = rows.loc[ALL]
    mean, inside = (readable(rows.loc[part, "probability"], DIGITS) for part in (ALL, RECORDED))
    words = (
        f"**What the answer rests on.** {beyond} It is an extrapolation: of the mean {mean}, only {inside} "
        "belongs to crashes like those that were recorded."
    )
    if pd.isna(whole["recorded"]):
        return words
    share = whole["recorded"] / whole["records"]
    replayed, low, high, expected = (
        readable(value, DIGITS)
        for value in (share, whole["replay_low95"], whole["replay_high95"], whole["expected"])
    )
    return (
        f"{words} A check without a model: {whole['recorded']:.0f} of {whole['records']:,.0f} records crash "
        f"the vehicle when they are replayed, which is {replayed} (95 % interval {low} to {high}). The "
        f"answer expects {expected}."
    )


# Shares of the answer by distance of the predicted crashes from the records.
extrapolation_table = result_table("extrapolation", digits=DIGITS, digest=without_replay)

# The answer for other choices of laws, weights, priors and splines.
choices_table = result_table("choices", digits=DIGITS, digest=with_intervals)


def with_both_intervals(near_misses: pd.DataFrame) -> pd.DataFrame:
    """Return the events with their dispersion, and both 95 % intervals in one column each."""
    ends = {
        name: interval_column(near_misses[f"{prefix}low95"], near_misses[f"{prefix}high95"])
        for name, prefix in (("95 %", ""), ("95 % with clusters", "clustered_"))
    }
    return near_misses.drop(columns=near_misses.filter(regex="95$").columns).assign(**ends)


# Intervals of near misses that allow for clusters of critical records.
near_misses_table = result_table("near_misses", digits=DIGITS, digest=with_both_intervals)
