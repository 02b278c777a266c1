"""Smooth laws of cut-ins along lines of the closing speed, for the explorer."""

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Self

import numpy as np
from scipy.special import ndtri
from tqdm import tqdm

from accelerated_evaluation.answer.candidates.fitted_records import FittedRecords
from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.ways.explored import TINY, Plane, PlaneCells, Sections
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.mean import MeanLaw
from accelerated_evaluation.laws.smooth.smooth_hazard import SmoothHazard

FEWEST = 20  # smallest number of draws of each member, so that a reader can select a single member
PILOT_DRAWS = 20  # number of draws of the law with whose mean the lines are drawn
PART = 256  # number of lines whose tables fit into the cache of a processor
DEPTH = 28  # largest cumulative hazard; closing speeds beyond it have the conditional probability 7e-13
# Closing speeds [m/s] at which laws are tabulated, with wider steps in the tail, where the laws are smooth.
SPEEDS = np.concatenate([np.arange(0, 24, 0.5), np.arange(24, 60, 1.0), np.arange(60, 241, 4.0)])


class CutInSections(Sections):
    """Draws of smooth laws of cut-ins; the base law is the mean of the draws of the answer."""

    grid, depth, scanned, is_upper_set, lines = SPEEDS, DEPTH, 2, True, 12_288
    shown = 40.0

    def __init__(self, study: LawStudy, draws: MeanLaw, more: np.random.Generator) -> None:
        """Take the draws of the answer, and add draws so that every smooth law has at least `FEWEST`."""
        smooth, own = study.smooth, draws.draws
        # Index of the distribution of the range, which draws share, and distribution of the closing speed of
        # each draw; those of the answer come first.
        self.ranges, self.laws = [*own.ranges], [*zip(own.shared.tolist(), own.laws, strict=True)]
        member = [smooth.names.index(name) for name in own.names]
        for place, count in enumerate(np.bincount(member, minlength=len(smooth.names))):
            for _ in range(FEWEST - count):
                self.ranges.append(smooth.family.ranges.drawn(more))
                law = smooth.family.drawn(smooth.members[place], more)
                self.laws.append((len(self.ranges) - 1, law))
                member.append(place)
        self.names, self.weights = smooth.names, study.mean_weights
        self.member, self.answered = np.array(member), own.size
        self.support = smooth.records.support
        self.recorded = np.sort(smooth.records.lead_speed)
        slowest, fastest = self.support.lead_speeds
        self.plane = Plane((slowest, 0.0), (fastest, self.support.range_max))

    @classmethod
    def of(
        cls, records: FittedRecords, size: int, stream: Callable[..., np.random.Generator], family: Path
    ) -> Self:
        """Return as many draws of the laws as the answer has, and more, from the fit in a family file.

        ``size`` is the number of draws of the answer, and ``stream`` returns a generator for the names of a
        step.
        """
        laws = partial(stream, "laws")
        study = LawStudy.of_smooth(records, size, laws, family)
        return cls(study, study.draws(laws("draws")), stream("explorer", "draws"))

    def survival(self, cells: PlaneCells, *, few: bool = False) -> Array:
        """Return P(cut-in in a cell, closing speed above each of `SPEEDS`), averaged over the draws."""
        laws = self.laws[: self.answered : max(1, self.answered // PILOT_DRAWS) if few else 1]
        places, share = Places.of(*cells.point, self.support), self._share(cells)
        count = share.size
        parts = [slice(first, first + PART) for first in range(0, count, PART)]
        total = np.zeros((SPEEDS.size, count))
        of_range = cache(lambda k: share * _of_range(cells, places, self.ranges[k]))
        for k, law in tqdm(laws, desc="mean law", unit=" draws", disable=few):
            given, probability = law.given(places), of_range(k)
            for part in parts:
                total[:, part] += probability[part] * np.exp(-given.cumulative_at(SPEEDS, part))
        return np.ascontiguousarray(total.T) / len(laws)

    def _share(self, cells: PlaneCells) -> Array:
        """Return the share of the recorded lead speeds in each cell; 1 in cells without a width."""
        ends = self.plane.at(cells.first, np.zeros(2))[0]
        if not np.diff(ends).any():
            return np.ones(len(ends))
        # The fastest recorded lead speed belongs to the last cell.
        below = np.searchsorted(self.recorded, ends)
        below[cells.first == 1] = self.recorded.size
        return np.diff(below)[:, 0] / self.recorded.size

    def log_ratios(self, cells: PlaneCells, levels: Array) -> Array:
        """Return the log of the ratio of each draw to the mean of the draws of the answer."""
        places = Places.of(*cells.point, self.support)
        row = np.repeat(np.arange(len(levels)), levels.shape[1])
        logs = np.empty((len(self.laws), *levels.shape))
        # The ratio is 1 if there are no cut-ins under any draw, as between ranges rounded to 10 m.
        of_range = cache(lambda k: np.log(np.maximum(_of_range(cells, places, self.ranges[k]), TINY)))
        for own, (k, law) in zip(logs, self.laws, strict=True):
            hazard = law.given(places).cumulative(levels.ravel(), row).reshape(own.shape)
            own[:] = of_range(k)[:, None] - hazard
        return logs - np.log(np.mean(np.exp(logs[: self.answered]), axis=0))

    def distance(self, cells: PlaneCells) -> Array:
        """Return the sum of the squared normal scores of the lead speed, and of the range given it."""
        lead_speed, range_ = cells.point
        rank = (np.searchsorted(self.recorded, lead_speed) + 0.5) / (self.recorded.size + 1)
        places, tail = Places.of(lead_speed, range_, self.support), np.zeros(range_.size)
        logarithm = np.log(self.support.range_max / range_)
        beyond = cache(lambda k: np.exp(-places.range_hazards(self.ranges[k]).at(logarithm)) / self.answered)
        for k, _ in self.laws[: self.answered]:
            tail += beyond(k)
        return ndtri(rank) ** 2 + ndtri(tail) ** 2


def _of_range(cells: PlaneCells, places: Places, ranges: SmoothHazard) -> Array:
    """Return the probability of the ranges of each cell for its lead speed, shape (n,)."""
    cumulative, root = places.range_hazards(ranges), cells.second
    touches = root[:, 1] > 0
    far = cumulative.at(-2 * np.log(root[:, 0]))
    near = cumulative.at(-2 * np.log(np.where(touches, root[:, 1], 1.0)))
    inside = np.where(touches, -np.expm1(np.minimum(far - near, 0.0)), 1.0)
    return np.exp(-far) * inside
