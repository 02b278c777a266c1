"""Tables of the answer: by event, by vehicle, by threshold of the laws, and by treatment of the records."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.calibration import mid_p
from accelerated_evaluation.answer.posterior import LEVELS, Posterior
from accelerated_evaluation.base.arrays import Array

SUMMARY = (
    "probability",
    "median",
    *(f"{end}{100 * level:.0f}" for level in LEVELS for end in ("low", "high")),
)
MISSED = 1e-4  # a map is rejected unless the mid-p value of the recorded number of crashes exceeds this value
RATIO = ("ratio", "ratio_low80", "ratio_high80")
SAFER = "safer"


def summarise(posterior: Posterior) -> dict[str, float]:
    """Summarise a posterior.

    Returns
    -------
    dict
        The mean ``probability``, the ``median``, and the ends of the equal-tailed credible intervals,
        ``low50``, ``high50``, ``low80``, ``high80``, ``low95`` and ``high95``.
    """
    ends = (end for level in LEVELS for end in posterior.interval(level))
    values = (float(posterior.probabilities.mean()), posterior.probability, *ends)
    return dict(zip(SUMMARY, values, strict=True))


def answer_table(posteriors: Mapping[str, Posterior], events_per_km: float | None) -> pd.DataFrame:
    """Tabulate the probabilities of events per cut-in, and their rates if the distance is known.

    Parameters
    ----------
    posteriors
        Draws of the probability of each event, by event.
    events_per_km
        Distinct closing cut-ins per kilometre [1/km]; None if the distance is not known.

    Returns
    -------
    pandas.DataFrame
        One row for each ``event``: the mean ``probability``, the ``median``, and the ends ``low50`` to
        ``high95`` of the 50, 80 and 95 % credible intervals; and the rate ``per_km`` [1/km], NaN if the
        distance is not known.
    """
    table = pd.DataFrame([{"event": event} | summarise(posterior) for event, posterior in posteriors.items()])
    return table.assign(per_km=table["probability"] * (np.nan if events_per_km is None else events_per_km))


def is_supported(recorded: int, expected: float) -> bool:
    """Return whether a number of recorded crashes agrees with the expected number.

    They agree if the two-sided mid-p value of the Poisson distribution is above `MISSED`.
    """
    return bool(mid_p(recorded, expected) > MISSED)


def vehicle_table(
    posteriors: Mapping[str, Posterior],
    recorded: Mapping[str, int | None],
    size: int,
    references: Mapping[str, str],
) -> pd.DataFrame:
    """Compare the crash probabilities of vehicles.

    All vehicles use the same draws of the law, so the interval of a ratio is much narrower than the quotient
    of two intervals. A crash map can miss crashes in stripes that are narrower than its steps. The replayed
    records reveal this: if the number of records that crash does not agree with the map, the map is rejected,
    and no probability is given for the vehicle.

    Parameters
    ----------
    posteriors
        Draws of the crash probability by vehicle.
    recorded
        Number of distinct records that crash when the vehicle replays them; None if they are not replayed.
    size
        Number of distinct records.
    references
        Names of the vehicles with which the others are compared, by the prefix of the columns of the ratios.
        Vehicles without a posterior are ignored.

    Returns
    -------
    pandas.DataFrame
        Columns ``vehicle``; ``recorded`` and ``expected`` crashes of the records; ``resolved`` (whether the
        map is accepted); the mean ``probability``, the ``median``, and the ends ``low50`` to ``high95`` of
        the 50, 80 and 95 % credible intervals; and for each reference, with its prefix, ``ratio``,
        ``ratio_low80`` and ``ratio_high80`` (median and 80 % interval of the ratio to the reference, NaN if
        the reference never crashes) and ``safer``, the share of the draws in which the vehicle crashes less
        often than the reference. The numbers are NaN if the map is rejected.
    """
    expected = {name: size * posterior.probabilities.mean() for name, posterior in posteriors.items()}
    resolved = {
        name: count is None or is_supported(count, expected[name]) for name, count in recorded.items()
    }
    bases = {
        prefix: posteriors[name].probabilities
        for prefix, name in references.items()
        if resolved.get(name, False) and bool(np.all(posteriors[name].probabilities > 0))
    }
    rows = []
    for name, posterior in posteriors.items():
        row = {"vehicle": name, "recorded": recorded[name], "expected": expected[name]}
        row["resolved"] = resolved[name]
        if resolved[name]:
            row |= summarise(posterior)
            for prefix, base in bases.items():
                row |= _ratio(posterior.probabilities / base, prefix)
        rows.append(row)
    ratios = [f"{prefix}{column}" for prefix in references for column in (*RATIO, SAFER)]
    columns = ["vehicle", "recorded", "expected", "resolved", *SUMMARY, *ratios]
    return pd.DataFrame(rows, columns=columns)


def _ratio(ratio: Array, prefix: str) -> dict[str, float]:
    """Return median, 80 % interval and the share below 1 of draws of a ratio."""
    columns = dict(zip(RATIO, np.quantile(ratio, [0.5, 0.1, 0.9]).tolist(), strict=True))
    return {
        f"{prefix}{name}": value for name, value in (columns | {SAFER: float(np.mean(ratio < 1))}).items()
    }
