"""What other parts of the event the runs of a sampler exclude, and the runs that exclude more of them.

The certificate says what has to be excluded. It is stated by the user, or a cover by default. The cover
itself, its open balls (`parts`) and its clearances (`clearance`) take long, so each is computed once for each
state of the runs.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fewruns.arrays import Array
from fewruns.certificate import Certificate, Unseen, look_beyond
from fewruns.clearance import points_in_open_balls
from fewruns.constants import (
    AGREEMENT,
    COVERED,
    FEW,
    LONGEST,
    LONGEST_SHARE,
    MOST_INPUTS,
)
from fewruns.cover import Cover
from fewruns.graded import say_more
from fewruns.parts import draw_in_balls_together, open_balls
from fewruns.progress import Progress
from fewruns.two_phase import reach_of


@dataclass(frozen=True)
class Exclusion:
    """The certificate after the runs of a sampler so far."""

    progress: Progress
    stated: Certificate | Cover | None  # the certificate that the user has stated
    most: int  # largest number of runs of a batch

    @property
    def dimension(self) -> int:
        """Number of inputs."""
        return self.progress.z.shape[1]

    @cached_property
    def required(self) -> Certificate | Cover:
        """The required certificate; by default a cover, which is stricter for flags without scores."""
        return self.stated or Cover.by_default(self.dimension, with_scores=self.has_scores)

    @cached_property
    def has_scores(self) -> bool:
        """Whether the scores of the runs say more than their flags."""
        return say_more(self.progress.happened, self.progress.score)

    @property
    def is_sufficient(self) -> bool:
        """Whether the certificate was stated, or the default one excludes parts of a moderate size."""
        most = MOST_INPUTS if self.has_scores else COVERED
        return self.stated is not None or self.dimension <= most

    @cached_property
    def is_certified(self) -> bool:
        """Whether the runs exclude all other parts of the event that the certificate speaks of.

        If this is to be shown by a cover, no known part may be larger than estimated, and the scores may
        leave no room for another part. If a whole batch was spent on them, one more is sampled, because the
        surrogate has learnt from them.
        """
        if not self.is_covered or isinstance(self.required, Certificate):
            return self.is_covered
        # The search for open balls takes long, so the simple condition comes first.
        is_sampled = self.progress.estimates[-1].runs > 0
        return is_sampled and not len(self._balls) and not len(self._in_clearances)

    @cached_property
    def is_covered(self) -> bool:
        """Whether an unobserved mode has at most the required share of the probability of the event."""
        return self.unseen(self._mean).mode <= self.required.share * self._mean

    @property
    def is_late(self) -> bool:
        """Whether the default certificate has taken as many runs as it may since the interval was narrow."""
        narrow_at = self.progress.narrow_at
        if self.stated is not None or narrow_at is None:
            return False
        total = narrow_at + max(LONGEST_SHARE * narrow_at, LONGEST)
        if self.dimension > 3:
            total = max(total, LONGEST * self.dimension)
        return len(self.progress.z) >= total

    @property
    def gives_up(self) -> bool:
        """Whether other parts of the event are not excluded, although that has taken as long as it may."""
        if not self.is_late or not self.progress.estimates[-1].runs:
            return False
        return self.is_covered and not self.is_certified

    def unseen(self, probability: float) -> Unseen:
        """Return the bounds on an unobserved part of the event, given the probability of the known part."""
        known, required = (self.progress.wide_draws, self.dimension, reach_of(probability)), self.required
        if isinstance(required, Cover):
            return replace(Unseen.after(*known, required.curvature), mode=self._unseen_mode)
        return Unseen.after(*known, required.curvature, required.filled)

    @property
    def beyond(self) -> float:
        """Rarity beyond which defensive runs exclude unobserved parts of the event; 0 for a cover."""
        required, probability = self.required, self._mean
        if (
            isinstance(required, Cover)
            or not 0 < (share := required.share * probability / required.filled) < 0.5
        ):
            return 0.0
        wide_draws = self.progress.wide_draws * [required.filled, 1, 1]
        return look_beyond(wide_draws, self.dimension, reach_of(probability), required.curvature, share)

    @property
    def can_cover(self) -> bool:
        """Whether a cover may have the next batch before the interval is narrow: every other one.

        Two batches must agree on an estimate that is not far below the last prediction.
        """
        if len(self.progress.sampled) < 2 or not self.progress.estimates[-1].runs:
            return False
        return self.progress.reaches_prediction(AGREEMENT)

    def runs(self, generator: np.random.Generator) -> Array:
        """Return up to ``most`` runs, shape (m, d), that exclude other parts; none if none are needed.

        The required certificate is a cover. The surroundings of known parts are checked first, because the
        estimate begins again if a known part is larger than its runs have shown. With at most two inputs, the
        runs of the cover reach all places, known parts included. Late runs only complete the cover.
        """
        progress, is_open = self.progress, not self.is_covered
        if not self.is_late:
            if not (is_open and self.dimension <= COVERED) and len(self._balls):
                return draw_in_balls_together(self.most, self._balls, generator)
            if len(self._in_clearances):
                return self._in_clearances
        if not is_open:
            return progress.z[:0]
        wanted = self.required.share * self._mean, self._unseen_mode
        return self.required.next_runs(self.most, progress.z, *wanted, generator)

    @cached_property
    def _mean(self) -> float:
        return self.progress.mean

    @cached_property
    def _unseen_mode(self) -> float:
        return self.required.unseen(self.progress.z)

    @property
    def _can_see(self) -> bool:
        """Whether more than the cover can be checked: not with random outcomes, and not with many inputs.

        With many inputs, no run is near another one.
        """
        return not self.progress.chance and self.dimension <= FEW

    @cached_property
    def _balls(self) -> Array:
        """Open balls around known events, shape (k, d + 1)."""
        progress = self.progress
        if not self._can_see:
            return np.empty((0, self.dimension + 1))
        return open_balls(progress.z, progress.happened, self._centres, self._mean, self.required.share)

    @cached_property
    def _in_clearances(self) -> Array:
        """Points where the scores leave room for another part of the event, shape (m, d)."""
        progress, required = self.progress, self.required
        if not (self._can_see and progress.happened.any() and self.has_scores):
            return progress.z[:0]
        known = progress.z, progress.happened, progress.score, self._centres
        return points_in_open_balls(self.most, *known, required.share * self._mean, 1 / required.curvature)

    @property
    def _centres(self) -> Array:
        return self.progress.z[:0] if self.progress.centres is None else self.progress.centres
