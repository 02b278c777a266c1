"""Tables of what supports the answer: the records near the crashes, other choices, and rare records."""

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.candidates.far_records import EVERY_LAW
from accelerated_evaluation.answer.ways.extrapolation import ALL, CAPPED, FAR, NEAR, RECORDED
from accelerated_evaluation.answer.ways.variants import WITHOUT_CRASHES
from accelerated_evaluation.publishing.published import result_table
from accelerated_evaluation.publishing.tables.laws import interval_column, with_intervals
from accelerated_evaluation.publishing.texts import fill

DIGITS = 2
# How much of the answer lies beyond the records: by closing speed for cut-ins, otherwise by distance.
RESTS = """\
**What the answer rests on.** {{ near | percent }} of the predicted crashes
{% if by_speed %}
close faster than any record at a similar range, and {{ far.share | percent }} faster than any record at all.
{% else %}
are farther from the nearest record than 95 % of the records are from each other, and
{{ far.share | percent }} farther than any record is.
{% endif %}
{{ "It is an extrapolation: the" if near > 0.5 else "The" }} median of the crash probability is
{{ whole["median"] | readable(2) }}, and that of crashes like those that were recorded is
{{ recorded["median"] | readable(2) }}.
{% if whole.recorded == whole.recorded %}
A check without a model: the vehicle crashes in {{ whole.recorded | number }} of
{{ whole.records | number }} replayed records, a share of {{ (whole.recorded / whole.records) | readable(2) }}
(95 % interval {{ whole.replay_low95 | readable(2) }} to {{ whole.replay_high95 | readable(2) }}).
The answer predicts {{ whole.expected | readable(2) }} crashes in these replays;
{{ recorded.expected | readable(2) }} of them are like recorded encounters.
{% if without is not none and whole.recorded %}
If the records that crash are left out of the fit, it predicts
{{ (without.events * without.probability) | readable(2) }}.
{% endif %}
This can contradict only an answer whose mean lies outside the interval.
{% endif %}
"""


def without_replay(extrapolation: pd.DataFrame) -> pd.DataFrame:
    """Return the parts of the answer with their 80 % intervals, and the numbers of replayed records.

    The table has no parts if no crash is known.
    """
    if extrapolation.empty:
        return extrapolation
    shown = ["part", "share", "median", "80 %", "expected", "recorded"]
    ends = interval_column(extrapolation["low80"], extrapolation["high80"])
    return extrapolation.assign(**{"80 %": ends})[shown]


def rests_in_words(extrapolation: pd.DataFrame, data_quality: pd.DataFrame | None = None) -> str:
    """Return a paragraph that says how much of the answer lies beyond the records; empty without crashes.

    The table ``data_quality`` has the crash probability without the records that crash the vehicle.
    """
    rows = extrapolation.set_index("part")
    if rows.empty or rows["share"].isna().any():
        return ""
    parts = {"whole": rows.loc[ALL], "recorded": rows.loc[RECORDED], "far": rows.loc[FAR]}
    near = rows.loc[[NEAR, FAR], "share"].sum()
    without = None if data_quality is None else data_quality.set_index("reading").loc[WITHOUT_CRASHES]
    found = parts | {"near": near, "by_speed": CAPPED in rows.index, "without": without}
    return fill(RESTS, found).strip().replace("\n", " ")


# Shares of the answer by distance of the predicted crashes from the records.
extrapolation_table = result_table("extrapolation", digits=DIGITS, digest=without_replay)


def by_effect(choices: pd.DataFrame) -> pd.DataFrame:
    """Return the answer, and then the answers for other choices, the one that is furthest from it first."""
    ratio = choices["median"] / choices["median"].iloc[0]
    order = np.maximum(ratio, 1 / ratio).iloc[1:].sort_values(ascending=False, kind="stable").index
    return with_intervals(choices.loc[[choices.index[0], *order]])


# The answer for other choices of laws, weights, priors and splines.
choices_table = result_table("choices", digits=DIGITS, digest=by_effect)

# Crashes and impacts with and without a limit to the speed of the host.
host_limit_table = result_table("host_limit", digits=DIGITS, digest=with_intervals)

# The answer from near misses alone.
near_miss_answer_table = result_table("near_miss_answer", digits=DIGITS, digest=with_intervals)


def of_all_laws(far_records: pd.DataFrame) -> pd.DataFrame:
    """Return the mean of the counts over all laws, by group of records."""
    of_all = far_records[far_records["law"] == EVERY_LAW]
    return of_all.drop(columns=["law", *of_all.filter(like="expected")])


# Expected and counted records beyond the levels of the far tail.
far_records_table = result_table("far_records", digits=3, digest=of_all_laws)


def with_both_intervals(near_misses: pd.DataFrame) -> pd.DataFrame:
    """Return the events with their dispersion, and both 95 % intervals in one column each."""
    ends = {
        name: interval_column(near_misses[f"{prefix}low95"], near_misses[f"{prefix}high95"])
        for name, prefix in (("95 %", ""), ("95 % with clusters", "clustered_"))
    }
    return near_misses.drop(columns=near_misses.filter(regex="95$").columns).assign(**ends)


# Intervals of near misses that allow for clusters of critical records.
near_misses_table = result_table("near_misses", digits=DIGITS, digest=with_both_intervals)
