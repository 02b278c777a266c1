"""Scores of laws of the closing speed where it matters, on records that a law has not seen.

A region is a set of cut-ins near the crash set: closing speeds above a boundary that depends on lead speed and range. The
censored log score (Diks, Panchenko and van Dijk 2011) is the log density of a record inside the region, and
the log probability of being outside of any other, so a law gains nothing by its fit elsewhere.
"""

from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.fitting.conditional import Places
from accelerated_evaluation.fitting.family import Events, Family, Fitter

BLOCKS = 10


class GivenLaw(Protocol):
    """A law of the closing speed at n pairs of lead speed and range."""

    def cumulative(self, closing_speed: Array) -> Array:
        """Return -log P(C > c), one a pair."""

    def log_density(self, closing_speed: Array) -> Array:
        """Return the log density, one a pair."""


def contiguous_blocks(size: int, blocks: int = BLOCKS) -> NDArray[np.int_]:
    """Return the block of each of ``size`` events, in the order of the record."""
    return np.arange(size) * blocks // size


def censored_log_score(law: GivenLaw, closing_speed: Array, boundary: Array) -> Array:
    """Return the log score of each record, censored to closing speeds above a boundary, shape (n,)."""
    inside = closing_speed > boundary
    with np.errstate(divide="ignore"):
        outside = np.log(-np.expm1(-law.cumulative(boundary)))
    return np.where(inside, law.log_density(closing_speed), np.where(boundary > 0, outside, 0.0))


def held_out_scores(
    fitter: Fitter, family: Family, regions: Mapping[str, Array], blocks: int = BLOCKS, thin: int = 1
) -> dict[str, Array]:
    """Score every member of a family on blocks that its fit has not seen.

    Parameters
    ----------
    fitter, family
        The events with what fits need, and the fit to all of them, from which refits start.
    regions
        Boundaries of closing speeds [m/s] by name, each of shape (events,).
    blocks
        Number of contiguous blocks.
    thin
        Of the events outside all regions, whose scores are all alike, only every so many are scored and stand
        for the others; saves time where many sets of events are scored.

    Returns
    -------
    dict
        Scores by region, shape (members, events).
    """
    events, block = fitter.events, contiguous_blocks(fitter.events.size, blocks)
    inside = np.any([events.closing_speed > boundary for boundary in regions.values()], axis=0)
    times = np.where(inside, 1, np.where(np.arange(events.size) % thin == 0, thin, 0))
    scores = {name: np.zeros((len(fitter.members), events.size)) for name in regions}
    for number in range(blocks):
        refit = fitter.refit(family, np.flatnonzero(block == number))
        out = np.flatnonzero((block == number) & (times > 0))
        places, speeds = Places.of(events.lead_speed[out], events.range_[out]), events.closing_speed[out]
        below = places.body(refit.body)
        for place, member in enumerate(fitter.members):
            given = refit.law(member).given(places, below)
            for name, boundary in regions.items():
                scores[name][place, out] = times[out] * censored_log_score(given, speeds, boundary[out])
    return scores


def held_out(
    fit: Callable[[Events], Callable[[Events], GivenLaw]],
    events: Events,
    regions: Mapping[str, Array],
    blocks: int = BLOCKS,
) -> dict[str, Array]:
    """Score any law: ``fit`` takes events and returns what gives the law at other events; shape (events,)."""
    block = contiguous_blocks(events.size, blocks)
    scores = {name: np.empty(events.size) for name in regions}
    for number in range(blocks):
        out = np.flatnonzero(block == number)
        part = events.only(out)
        given = fit(events.only(np.flatnonzero(block != number)))(part)
        for name, boundary in regions.items():
            scores[name][out] = censored_log_score(given, part.closing_speed, boundary[out])
    return scores
