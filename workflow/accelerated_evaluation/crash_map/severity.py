"""Exact probabilities of all events of a crash map, and the distribution of the impact speed."""

import numpy as np
import pandas as pd

from accelerated_evaluation.crash_map.exact import exact_probabilities
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.laws import StratifiedLaw

UNITS = {"crash": "", "impact_speed": "m/s", "min_range": "m", "min_ttc": "s"}
QUANTILES = (0.1, 0.25, 0.5, 0.75, 0.9)


def severity_table(
    crash_map: CrashMap, law: StratifiedLaw, encounters: int, *, distance: float | None = None
) -> pd.DataFrame:
    """Tabulate the probability of every event of the map, for each segment and over all segments.

    ``to_crash`` is the ratio to the crash probability. ``per_million_km`` is empty if the distance driven
    during the recording [km] is unknown.
    """
    crash = exact_probabilities(crash_map, law)
    rows = []
    for event in crash_map.events:
        for segment, value in exact_probabilities(crash_map, law, event).items():
            share = law.shares.get(segment, 1.0)
            rate = value.probability * share * encounters / distance * 1e6 if distance else np.nan
            ratio = value.probability / crash[segment].probability if crash[segment].probability else np.nan
            label = segment, event.quantity, event.threshold, UNITS[event.quantity]
            rows.append((*label, value.probability, value.standard_error, ratio, rate))
    columns = ["segment", "quantity", "threshold", "unit", "probability", "standard_error", "to_crash"]
    return pd.DataFrame(rows, columns=[*columns, "per_million_km"])


def impact_speed_table(severity: pd.DataFrame) -> pd.DataFrame:
    """Tabulate the mean and the quantiles of the impact speeds of crashes for each segment.

    The survival function of the impact speed is interpolated linearly between the thresholds. It is assumed
    to reach 0 one step above the last threshold. Segments without crashes have no row, and the table is empty
    if there are fewer than two thresholds.
    """
    rows = []
    impacts = severity[severity["quantity"] == "impact_speed"].sort_values("threshold")
    for segment, group in impacts.groupby("segment", sort=False):
        speed, survival = group["threshold"].to_numpy(), group["to_crash"].to_numpy()
        if speed.size < 2 or np.isnan(survival).any():
            continue
        # All crashes have an impact speed of at least 0, so the survival function is 1 at 0.
        speed = np.concatenate([[0.0], speed, [2 * speed[-1] - speed[-2]]])
        survival = np.minimum.accumulate(np.concatenate([[1.0], survival, [0.0]]))
        mean = np.trapezoid(survival, speed)
        # The arrays are reversed, because np.interp needs increasing abscissae.
        quantiles = np.interp(1 - np.array(QUANTILES), survival[::-1], speed[::-1])
        rows.append((segment, mean, *quantiles))
    names = [f"q{100 * quantile:.0f}_m_s" for quantile in QUANTILES]
    return pd.DataFrame(rows, columns=["segment", "mean_m_s", *names])
