"""How bad, and how often: impact speeds of the crashes, near misses, and what they mean per distance."""

import numpy as np
import pandas as pd

from accelerated_evaluation.crash_map.exact import exact_probabilities
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.laws import Law

UNITS = {"crash": "", "impact_speed": "m/s", "min_range": "m", "min_ttc": "s"}
QUANTILES = (0.1, 0.25, 0.5, 0.75, 0.9)


def severity_table(
    crash_map: CrashMap, law: Law, encounters: int, *, distance: float | None = None
) -> pd.DataFrame:
    """Tabulate the probability of every event of the map, by segment and over all.

    Parameters
    ----------
    crash_map, law
        As in `exact_probabilities`.
    encounters
        Number of recorded encounters.
    distance
        Distance [km] in which they were recorded, if it is known.

    Returns
    -------
    pandas.DataFrame
        Columns ``segment``, ``quantity``, ``threshold``, ``unit``, ``probability`` and ``standard_error``,
        ``to_crash``, the ratio to the crash probability, and ``per_million_km``, empty without a distance.
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
    """Summarize the impact speeds of the crashes from the rows of `severity_table`.

    The survival function is linear between thresholds, and zero from one step after the last.

    Returns
    -------
    pandas.DataFrame
        Columns ``segment``, ``mean`` and ``q10`` .. ``q90`` [m/s]; no row where nothing crashes, and
        none at all with fewer than two thresholds.
    """
    rows = []
    impacts = severity[severity["quantity"] == "impact_speed"].sort_values("threshold")
    for segment, group in impacts.groupby("segment", sort=False):
        speed, survival = group["threshold"].to_numpy(), group["to_crash"].to_numpy()
        if speed.size < 2 or np.isnan(survival).any():
            continue
        # A crash at no closing speed is one too, so that all survive below the first threshold of 0.
        speed = np.concatenate([[0.0], speed, [2 * speed[-1] - speed[-2]]])
        survival = np.minimum.accumulate(np.concatenate([[1.0], survival, [0.0]]))
        mean = np.trapezoid(survival, speed)
        # Reversed, as interpolation wants rising abscissae.
        quantiles = np.interp(1 - np.array(QUANTILES), survival[::-1], speed[::-1])
        rows.append((segment, mean, *quantiles))
    names = [f"q{100 * quantile:.0f}_m_s" for quantile in QUANTILES]
    return pd.DataFrame(rows, columns=["segment", "mean_m_s", *names])
