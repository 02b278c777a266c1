"""The paper's law of the closing speed, with which laws with dependence are compared."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.paper.piecewise import usable_knots
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.draws import Hazards
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.records.segments import MINIMUM_ROWS

BODY_BINS = 200  # number of bins below the knot, in each of which the hazard of TTC^-1 is constant
LEAST_RATE = 1e-12  # [s], hazard in bins without records, so that its logarithm is finite


@dataclass(frozen=True)
class IndependentTail:
    """A law in which TTC^-1 is independent of the range; each segment has bins and an exponential tail."""

    hazards: Hazards  # of TTC^-1 [1/s] in each segment, (1, segments, bins)
    between: tuple[float, ...]  # lead speeds at which the segments meet [m/s]

    @classmethod
    def fit(cls, records: DistinctRecords, level: float) -> "IndependentTail":
        """Return the law with bins and a tail of TTC^-1 fitted in each segment of the lead speed.

        A segment with fewer than `MINIMUM_ROWS` records gets the distribution of all records. A knot that too
        few records exceed is moved as little as necessary. The knot is the quantile of the given level.
        """
        inverse_ttc, between = records.closing_speed / records.range_, records.support.segment_edges
        segment = np.digitize(records.lead_speed, between)
        parts = []
        for number in range(len(between) + 1):
            x = inverse_ttc[segment == number]
            x = inverse_ttc if x.size < MINIMUM_ROWS else x
            (knot,) = usable_knots(x, [float(np.quantile(x, level))])
            counts, edges = np.histogram(x[x <= knot], BODY_BINS, range=(0, knot))
            hazard = np.diff(-np.log1p(-level * np.append(0, np.cumsum(counts)) / counts.sum()))
            rates = np.append(hazard / np.diff(edges), 1 / (x[x > knot] - knot).mean())
            parts.append((edges, np.maximum(rates, LEAST_RATE)))
        every = np.unique(np.concatenate([edges for edges, _ in parts]))
        rates = np.array([own[np.searchsorted(edges, every, side="right") - 1] for edges, own in parts])
        table = np.pad(np.cumsum(rates[:, :-1] * np.diff(every), axis=1), [(0, 0), (1, 0)])
        return cls(Hazards(np.append(every, np.inf), rates[None], table[None]), between)

    def given(self, places: Places) -> "GivenIndependent":
        """Return the distributions of the closing speed given n pairs of lead speed and range."""
        return GivenIndependent(self.hazards, np.digitize(places.lead_speed, self.between), places.range_)


@dataclass(frozen=True)
class GivenIndependent:
    """Distributions of the closing speed given n pairs of lead speed and range, under `IndependentTail`."""

    hazards: Hazards
    segment: NDArray[np.intp]  # index of the segment of each pair, (n,)
    range_: Array  # m, (n,)

    def cumulative(self, closing_speed: Array) -> Array:
        """Return the cumulative hazard -log P(C > c) at a closing speed c [m/s] for each pair, (n,)."""
        return self.hazards.at(closing_speed / self.range_, self.segment)[0][0]

    def log_density(self, closing_speed: Array) -> Array:
        """Return the log density of the closing speed at one value [m/s] for each pair, shape (n,)."""
        cumulative, rate = self.hazards.at(closing_speed / self.range_, self.segment)
        return (np.log(rate) - cumulative)[0] - np.log(self.range_)
