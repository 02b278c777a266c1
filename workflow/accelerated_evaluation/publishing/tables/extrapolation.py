"""Tables of what the answer rests on: extrapolation, choices, and clusters of critical records."""

import pandas as pd

from accelerated_evaluation.publishing.published import result_table
from accelerated_evaluation.publishing.tables.laws import interval_column, with_intervals

DIGITS = 2


def without_replay(extrapolation: pd.DataFrame) -> pd.DataFrame:
    """Return the parts of the answer with their 80 % intervals, and the numbers of replayed records."""
    shown = ["part", "share", "probability", "median", "80 %", "expected", "recorded"]
    ends = interval_column(extrapolation["low80"], extrapolation["high80"])
    return extrapolation.assign(**{"80 %": ends})[shown]


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
