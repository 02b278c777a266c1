"""What other parts of the event the runs of a sampler exclude, and the runs that exclude more of them.

The certificate says what has to be excluded. It is stated by the user, or a cover by default. The cover
itself and its clearances (`cover`) take long, so each is computed once for each state of the runs.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fewruns.arrays import Array, Generator
from fewruns.certificate import Certificate, Unseen, bound_of_any_set, look_beyond
from fewruns.constants import AGREEMENT, COVERED, FEW, LONGEST, LONGEST_SHARE, MOST_INPUTS
from fewruns.cover import Cover, points_in_open_balls
from fewruns.graded import say_more
from fewruns.progress import Progress
from fewruns.statements import point_the_wrong_way
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
        """Whether the scores of the runs say more than their flags, and say so in time.

        Scores that point the wrong way, and those that still leave room for another part after late runs, say
        too little. The cover is then that of flags alone.
        """
        happened, score = self.progress.happened, self.progress.score
        if not say_more(happened, score) or point_the_wrong_way(happened, score):
            return False
        return not (self.is_late and len(self._in_clearances))

    @property
    def is_sufficient(self) -> bool:
        """Whether the certificate was stated, or the default one excludes parts of a moderate size."""
        most = MOST_INPUTS if self.has_scores else COVERED
        return self.stated is not None or self.dimension <= most

    @cached_property
    def is_certified(self) -> bool:
        """Whether the runs exclude all other parts of the event that the certificate speaks of.

        If this is to be shown by a cover, the scores may leave no room for another part. If a whole batch was
        spent on them, one more is sampled, because the surrogate has learnt from them.
        """
        if not self.is_covered or isinstance(self.required, Certificate):
            return self.is_covered
        # The search for open balls takes long, so the simple condition comes first.
        is_sampled = self.progress.estimates[-1].runs > 0
        return is_sampled and not (self.has_scores and len(self._in_clearances))

    @cached_property
    def is_covered(self) -> bool:
        """Whether an unobserved mode has at most the required share of the probability of the event."""
        return self.unseen(self._mean).mode <= self.required.share * self._mean

    @property
    def is_late(self) -> bool:
        """Whether the clearances have taken as many runs as they may since the interval was narrow."""
        narrow_at = self.progress.narrow_at
        if isinstance(self.stated, Certificate) or narrow_at is None:
            return False
        total = narrow_at + max(LONGEST_SHARE * narrow_at, LONGEST)
        if self.dimension > 3:
            total = max(total, LONGEST * self.dimension)
        return len(self.progress.z) >= total

    def unseen(self, probability: float) -> Unseen:
        """Return the bounds on an unobserved part of the event, given the probability of the known part."""
        draws, required = self.progress.wide_draws, self.required
        if isinstance(required, Cover):
            return Unseen(float(draws[:, 0].sum()), self._unseen_mode, bound_of_any_set(draws))
        reach = reach_of(probability)
        return Unseen.after(draws, self.dimension, reach, required.curvature, required.filled)

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

    def runs(self, generator: Generator) -> Array:
        """Return up to ``most`` runs, shape (m, d), that exclude other parts; none if none are needed.

        The required certificate is a cover. Late runs only complete the cover. Pending runs are expected to
        show no event; failed runs count as well, because they may fail again at the same place.
        """
        progress, required, unknown = self.progress, self.required, self.progress.unknown_runs
        if self.has_scores and not self.is_late and len(self._in_clearances):
            points = self._in_open_balls(unknown) if progress.asked else self._in_clearances
            if len(points):
                return points
        if self.is_covered or isinstance(required, Certificate):
            return progress.z[:0]
        z, wanted = np.vstack([progress.z, unknown]), required.share * self._mean
        unseen = required.unseen(z) if progress.asked else self._unseen_mode
        return required.next_runs(self.most, z, wanted, unseen, generator) if unseen > wanted else z[:0]

    @cached_property
    def _mean(self) -> float:
        return self.progress.mean

    @cached_property
    def _unseen_mode(self) -> float:
        z = np.vstack([self.progress.z, self.progress.failed])
        return self.required.unseen(z)  # type: ignore[union-attr]  # asked of covers only

    @cached_property
    def _in_clearances(self) -> Array:
        """Points where the scores leave room for another part of the event, shape (m, d).

        They are not looked for with random outcomes, and with so many inputs that no run is near another one.
        """
        progress = self.progress
        if progress.chance or self.dimension > FEW or not progress.happened.any():
            return progress.z[:0]
        return self._in_open_balls(progress.failed)

    def _in_open_balls(self, unknown: Array) -> Array:
        """Return points in open balls, shape (m, d), after runs of which some have no outcome, (k, d)."""
        progress, required = self.progress, self.stated or Cover.by_default(self.dimension)
        centres = progress.z[:0] if progress.centres is None else progress.centres
        known = progress.z, progress.happened, progress.score, centres
        asked = required.share * self._mean, 1 / required.curvature
        return points_in_open_balls(self.most, *known, *asked, unknown)
