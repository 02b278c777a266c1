"""The embedded default: simulated encounters, as many as the real ones, from the model fitted to them."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pandas as pd

from accelerated_evaluation.encounters.reading import read_csv, require_file
from accelerated_evaluation.encounters.segments import segment_counts
from accelerated_evaluation.errors import InputError

LEAD_SPEED = "lead_speed [m/s]"


class Sampler(Protocol):
    """The part of a distribution that the twin needs."""

    def rvs(self, generator: np.random.Generator, size: int) -> np.ndarray:
        """Independent draws, shape (size,)."""


@dataclass(frozen=True)
class Twin:
    """What the twin is made of.

    Attributes
    ----------
    inverse_range
        Distribution of R^-1 [1/m], the same in all segments.
    inverse_ttc
        Distribution of TTC^-1 [1/s] by segment.
    counts
        Number of events by segment.
    lead_speed
        Quantiles of v_L as `lead_speed_quantiles` makes them.
    """

    inverse_range: Sampler
    inverse_ttc: Mapping[str, Sampler]
    counts: Mapping[str, int]
    lead_speed: pd.DataFrame


def generate(twin: Twin, generator: np.random.Generator, events: int | None = None) -> pd.DataFrame:
    """Draw events: v_L from its quantiles, R^-1 and TTC^-1 from the model, independent inside a segment.

    Parameters
    ----------
    twin
        Model and counts.
    generator
        Source of randomness.
    events
        Number of events in all, shared out over the segments as in ``twin.counts``; None for the same.

    Returns
    -------
    pandas.DataFrame
        Columns ``lead_speed`` [m/s], ``inverse_range`` [1/m], ``inverse_ttc`` [1/s], segment after segment;
        index ``row`` from 1.

    Raises
    ------
    InputError
        If the parts of the twin do not have the same segments.
    """
    counts = twin.counts if events is None else share_out(twin.counts, events)
    quantiles = {str(name): table for name, table in twin.lead_speed.groupby("segment", sort=False)}
    for part, segments in {"inverse_ttc": twin.inverse_ttc, "lead_speed": quantiles}.items():
        if set(segments) != set(counts):
            raise InputError(
                f"twin, {part}",
                seen=f"segments {', '.join(segments)}",
                expected=f"segments {', '.join(counts)}",
                change="Take the files data.twin.model and data.twin.lead_speed from the same fit.",
            )
    parts = []
    for segment, size in counts.items():
        table = quantiles[segment]
        speed = np.interp(generator.random(size), table["probability"], table[LEAD_SPEED])
        inverse_range = twin.inverse_range.rvs(generator, size)
        inverse_ttc = twin.inverse_ttc[segment].rvs(generator, size)
        parts.append(np.column_stack((speed, inverse_range, inverse_ttc)))
    raw = pd.DataFrame(np.concatenate(parts), columns=["lead_speed", "inverse_range", "inverse_ttc"])
    return raw.set_index(pd.RangeIndex(1, len(raw) + 1, name="row"))


def share_out(counts: Mapping[str, int], events: int) -> dict[str, int]:
    """Share ``events`` out in the proportions of ``counts``, by largest remainders."""
    shares = np.array(list(counts.values())) * events / sum(counts.values())
    whole = np.floor(shares).astype(int)
    largest = np.argsort(whole - shares, kind="stable")[: events - whole.sum()]
    whole[largest] += 1
    return dict(zip(counts, whole.tolist(), strict=True))


def lead_speed_quantiles(encounters: pd.DataFrame, probabilities: Sequence[float]) -> pd.DataFrame:
    """Tabulate the quantiles of v_L in each segment.

    Parameters
    ----------
    encounters
        Encounter table.
    probabilities
        Increasing, from 0 to 1; with both ends, no draw can leave the range of the observed speeds.

    Returns
    -------
    pandas.DataFrame
        Columns ``segment``, ``probability``, ``lead_speed [m/s]``.
    """
    parts = []
    for segment in segment_counts(encounters)["segment"]:
        speeds = np.quantile(encounters.loc[encounters["segment"] == segment, "lead_speed"], probabilities)
        parts.append(pd.DataFrame({"segment": segment, "probability": probabilities, LEAD_SPEED: speeds}))
    return pd.concat(parts, ignore_index=True)


def read_lead_speed(path: str | os.PathLike) -> pd.DataFrame:
    """Read a table as `lead_speed_quantiles` makes it.

    Raises
    ------
    InputError
        If the file is missing or its columns, or the order of its values, are not such a table's.
    """
    require_file(path, "Set data.twin.lead_speed to the quantile table of v_L that belongs to the model.")
    table = read_csv(path)
    expected = ["segment", "probability", LEAD_SPEED]
    is_whole = list(table.columns) == expected
    if is_whole:
        table[expected[1:]] = table[expected[1:]].apply(pd.to_numeric, errors="coerce")
        is_whole = all(_is_quantile_table(part) for _, part in table.groupby("segment"))
    if not is_whole:
        raise InputError(
            str(path),
            seen=f"columns {', '.join(table.columns)} and {len(table)} rows",
            expected=f"columns {', '.join(expected)}, in each segment increasing from probability 0 to 1",
            change="Make the table anew with lead_speed_quantiles.",
        )
    return table


def _is_quantile_table(table: pd.DataFrame) -> bool:
    probability = table["probability"].to_numpy()
    whole = probability[0] == 0 and probability[-1] == 1
    return bool(whole and (np.diff(probability) > 0).all() and (np.diff(table[LEAD_SPEED]) >= 0).all())
