"""Crash and impact probabilities if there is a limit to the speed of the host.

The closing speed of a cut-in is the host's speed minus the lead's, and the laws do not know that no host is
infinitely fast. A limit leaves out the encounters with a faster host: they do not happen to the vehicle. If
it met them at its own largest speed instead, the crashes at exactly this speed would be added, so a limit of
this kind is the smaller of two answers. The records cannot test a limit, because hardly any of them has a
fast host behind a slow lead.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.ways.posterior import SUMMARY, Posterior, summarise
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines, divided_at
from accelerated_evaluation.laws.draws import Draws

UNLIMITED = "no limit"
LEADS = (2 / 3, 3 / 4)  # shares of the recorded lead speeds below those that count as fast
DRAWN = 10  # number of equally likely limits that represent the distribution of recorded hosts
ROUNDING = 1e-9  # [m/s]
COLUMNS = ["event", "limit", "share", *SUMMARY]


def host_limits(lead_speed: Array, closing_speed: Array) -> dict[str, Array]:
    """Return the limits of the host's speed [m/s] that the records suggest, as equally likely values by name.

    They are the speed of the fastest recorded host, and those of the recorded hosts behind fast leads, whom
    the vehicle ahead does not slow down.
    """
    host = lead_speed + closing_speed
    limits = {f"the fastest recorded host, {host.max():.1f} m/s": host.max(keepdims=True)}
    for level in LEADS:
        fast = np.quantile(lead_speed, level)
        name = f"one of the recorded hosts behind leads of {fast:.0f} m/s and more"
        limits[name] = np.quantile(host[lead_speed >= fast], (np.arange(DRAWN) + 0.5) / DRAWN)
    return limits


def limited_probabilities(lines: CrashLines, draws: Draws, limits: Sequence[Array]) -> Array:
    """Return the probability of an event with each limit of the host's speed under each draw, (limits, K).

    A limit is an array of equally likely values [m/s]; its probability is the mean over them.
    """
    values = np.unique(np.concatenate(limits))
    cut, _ = divided_at(lines, [value - lines.places.lead_speed for value in values])
    masses, host = cut.masses(draws), cut.end + cut.places.lead_speed[cut.row]
    # The ends of the intervals are cut at the limits, up to rounding.
    below = masses @ (host[:, None] <= values + ROUNDING)
    return np.array([below[:, np.searchsorted(values, limit)].mean(axis=1) for limit in limits])


def host_limit_table(
    events: Mapping[str, CrashLines], draws: Draws, lead_speed: Array, closing_speed: Array
) -> pd.DataFrame:
    """Tabulate the probabilities of events with and without a limit of the host's speed.

    ``events`` are the lines of each event by its words, and the speeds [m/s] those of the records. ``share``
    is the mean probability divided by that without a limit, and the other columns are those of
    `posterior.summarise`.
    """
    limits, rows = {UNLIMITED: np.array([np.inf])} | host_limits(lead_speed, closing_speed), []
    for event, lines in events.items():
        own = limited_probabilities(lines, draws, [*limits.values()])
        for limit, probabilities in zip(limits, own, strict=True):
            share = probabilities.mean() / own[0].mean() if own[0].any() else np.nan
            row = {"event": event, "limit": limit, "share": share}
            rows.append(row | summarise(Posterior(probabilities, draws.member)))
    return pd.DataFrame(rows, columns=COLUMNS)


def as_choices(table: pd.DataFrame, event: str) -> pd.DataFrame:
    """Return the rows of an event with a limit in the form of rows of `choices.choice_table`."""
    rows = table[(table["event"] == event) & (table["limit"] != UNLIMITED)]
    return rows.assign(choice="no host faster than " + rows["limit"])[["choice", *SUMMARY]]
