"""Held-out scores of laws in a region in which crashes happen, and the weights that follow from them.

A region is a set of cut-ins near the crash set: closing speeds above a boundary that depends on lead speed
and range. The censored log score (Diks, Panchenko and van Dijk 2011) of a record inside the region is its log
density. The score of any other record is the log probability of being outside the region. A law therefore
gains nothing from its fit elsewhere.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.conditional import Given, Places, SpeedLaw, Threshold
from accelerated_evaluation.laws.smooth.family import DistinctRecords, Fitter, LawFamily
from accelerated_evaluation.laws.smooth.independent import GivenIndependent, IndependentTail
from accelerated_evaluation.laws.smooth.support import ROOT_MIN, SUPPORT, Support
from accelerated_evaluation.vehicles.protocol import Vehicle

BLOCKS = 10  # number of blocks of the cross-validation
NODES = 81  # number of nodes on each side of the grid on which a boundary is computed
HALVINGS = 14  # number of steps of bisection
NEVER = 60.0  # [m/s], upper end of the bisection, which no recorded closing speed reaches


GivenLaw = Given | GivenIndependent  # a law of the closing speed at n pairs of lead speed and range
FittedLaw = SpeedLaw | IndependentTail  # a law of the closing speed given lead speed and range


def contiguous_blocks(size: int, blocks: int = BLOCKS) -> NDArray[np.int_]:
    """Divide records into blocks of consecutive records, and return the block of each record, from 0."""
    return np.arange(size) * blocks // size


@dataclass(frozen=True)
class Fold:
    """Records that are predicted, and records that the laws for the prediction must not know."""

    tested: NDArray[np.intp]  # indices of the predicted records
    left_out: NDArray[np.intp]  # indices of the records that are left out of the fit, with the predicted ones


def contiguous_folds(size: int, blocks: int = BLOCKS) -> list[Fold]:
    """Return a fold for each block of consecutive records, which is predicted from all other records."""
    block = contiguous_blocks(size, blocks)
    return [Fold(tested, tested) for tested in (np.flatnonzero(block == number) for number in range(blocks))]


def forward_folds(size: int, blocks: int = BLOCKS) -> list[Fold]:
    """Return a fold for each block of the second half of the records, predicted from those before it."""
    block = contiguous_blocks(size, blocks)
    later = range(-(-blocks // 2), blocks)
    return [Fold(np.flatnonzero(block == number), np.flatnonzero(block >= number)) for number in later]


def censored_log_score(law: GivenLaw, closing_speed: Array, boundary: Array) -> Array:
    """Return the log score of each record, censored to closing speeds above a boundary, shape (n,).

    It is the log density if the closing speed exceeds the boundary, and otherwise log P(C <= boundary).
    """
    inside = closing_speed > boundary
    with np.errstate(divide="ignore"):
        outside = np.log(-np.expm1(-law.cumulative(boundary)))
    return np.where(inside, law.log_density(closing_speed), np.where(boundary > 0, outside, 0.0))


@dataclass(frozen=True)
class HeldOut:
    """Laws fitted without some of the records, for each fold in turn."""

    records: DistinctRecords  # in the order of the records
    folds: Sequence[Fold]
    # For each fold, a function from places to the laws of the closing speed that do not know its records.
    given: Sequence[Callable[[Places], Iterable[GivenLaw]]]
    laws: int = 1

    @classmethod
    def of_family(cls, fitter: Fitter, family: LawFamily, folds: Sequence[Fold] | None = None) -> "HeldOut":
        """Fit every law of a family once for each fold, by default those of `contiguous_folds`.

        The fits start from the fit to all records, on the grids of the fitter.
        """
        folds = contiguous_folds(fitter.records.size) if folds is None else folds

        def given_by(refit: LawFamily, places: Places) -> Iterator[GivenLaw]:
            below = places.body(refit.body)
            return (refit.law(member).given(places, below) for member in fitter.members)

        refits = [fitter.refit(family, fold.left_out) for fold in folds]
        return cls(fitter.records, folds, [partial(given_by, refit) for refit in refits], len(fitter.members))

    @classmethod
    def of_law(
        cls,
        fit: Callable[[DistinctRecords], FittedLaw],
        records: DistinctRecords,
        folds: Sequence[Fold] | None = None,
    ) -> "HeldOut":
        """Fit a single law once for each fold, by default those of `contiguous_folds`."""
        folds = contiguous_folds(records.size) if folds is None else folds
        every = np.arange(records.size)
        fits = [fit(records.only(np.delete(every, fold.left_out))) for fold in folds]
        return cls(records, folds, [lambda places, law=law: [law.given(places)] for law in fits])

    def scores(self, regions: Mapping[str, Array]) -> dict[str, Array]:
        """Score each law at records that were not used for its fit, by region, shape (laws, records).

        The score is `censored_log_score`. The regions are boundaries of closing speeds [m/s], shape
        (records,).
        """
        speed = self.records.closing_speed
        scores = {name: np.zeros((self.laws, speed.size)) for name in regions}
        for fold, given in zip(self.folds, self.given, strict=True):
            out = fold.tested
            for place, law in enumerate(given(self.records.only(out).places)):
                for name, boundary in regions.items():
                    scores[name][place, out] = censored_log_score(law, speed[out], boundary[out])
        return scores


def time_to_collision_boundary(vehicle: Vehicle, ttc: float, support: Support = SUPPORT) -> Threshold:
    """Return the closing speed above which the smallest simulated time to collision is at most ``ttc`` [s].

    It is computed by bisection at the nodes of a grid of lead speeds and square roots of ranges, and
    interpolated between them.
    """
    ends = support.lead_speeds, (ROOT_MIN, np.sqrt(support.range_max))
    nodes = [np.linspace(low, high, NODES) for low, high in ends]
    speeds, roots = (x.ravel() for x in np.meshgrid(*nodes, indexing="ij"))
    low, high = np.zeros(speeds.size), np.full(speeds.size, NEVER)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        near = vehicle.simulate(speeds, roots**2, middle).min_ttc <= ttc
        low, high = np.where(near, low, middle), np.where(near, middle, high)
    return Threshold(float("nan"), *nodes, high.reshape(NODES, NODES))
