"""The predicted probability of the event at a point that was not simulated: a mixture of two surrogates.

The first surrogate learns from the flags of the runs. The second one learns from the scores, which contain
more information if the system is smooth, and mislead if it has jumps. If there is a predecessor, the first
surrogate also learns from its runs, and the second one only from the flags of the system under test.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from fewruns.arrays import Array
from fewruns.calibration import Calibration
from fewruns.constants import AMPLITUDE, MOST_TRUST, NOISY_AMPLITUDE, NOISY_LOG_ODDS, RELEARN
from fewruns.gaussian_process import EventSurrogate
from fewruns.graded import GradedSurrogate, end_of_events, graded
from fewruns.kernel import principal_axes
from fewruns.predecessor import Predecessor
from fewruns.progress import Progress
from fewruns.subspace import Space, Subspace


class Belief:
    """Predicted probability of the event at any point, given all runs so far.

    If most outcomes are random (``noisy``), the predictions by the scores include the noise of the
    regression; in a subspace they always do, because points with the same coordinates may have different
    outcomes.
    """

    def __init__(self, space: Space, predecessor: Predecessor | None, *, noisy: bool = False) -> None:
        amplitude = NOISY_AMPLITUDE if noisy else AMPLITUDE
        self.space = space
        self.flags = EventSurrogate(space.dimension, predecessor, amplitude)
        self.scores = GradedSurrogate(space.dimension)
        self._predecessor, self._noisy = predecessor, noisy
        self._scores_are_noisy = noisy or isinstance(space, Subspace)
        self._second: Callable[[Array], Array] | None = None
        self._calibration = Calibration()

    def fit(self, progress: Progress) -> None:
        """Fit both surrogates to all runs, and learn their parameters again if there are enough new runs.

        The boundary of a thin set that is oblique to the scores is learnt from fewer runs along its principal
        axes.
        """
        z, happened, runs = self.space.coordinates(progress.z), progress.happened, len(progress.z)
        learn = not progress.estimates or runs >= RELEARN * progress.learnt_at
        turned: list[Array] = []
        if learn:
            progress.learnt_at = runs
            mattered = [] if progress.centres is None else [self.space.coordinates(progress.centres)]
            turned = [axes for points in (*mattered, z[happened]) for axes in principal_axes(points)]
        self.flags.fit(z, happened, learn=learn, turned=turned)
        self._second = None
        if self._predecessor is not None and runs:
            # It keeps the prior's lengths, so that none of its parameters has to be saved in a state.
            own_flags = EventSurrogate(z.shape[1], amplitude=NOISY_AMPLITUDE if self._noisy else AMPLITUDE)
            own_flags.fit(z, happened, learn=False)
            self._second = own_flags.probability
        elif self._predecessor is None and happened.any() and not happened.all():
            outcome = graded(happened, progress.score)
            self.scores.fit(z @ self.flags.axes, outcome, learn=learn)
            self._second = partial(self._by_scores, below=end_of_events(outcome, happened))
        predicted = len(progress.foreseen)
        least = 0.0 if self._predecessor is None else 1 - MOST_TRUST
        # If most outcomes are random, the regression with noise is the better model of the flags.
        log_odds = NOISY_LOG_ODDS if self._noisy else 0.0
        self._calibration = Calibration.learn(
            progress.foreseen, happened[runs - predicted :], least, log_odds
        )

    def refitted(self, progress: Progress) -> "Belief":
        """Return surrogates with unchanged axes and lengths that are fitted to other runs."""
        other = Belief(self.space, self._predecessor, noisy=self._noisy)
        other.flags.axes, other.flags.theta = self.flags.axes, self.flags.theta
        other.scores.theta = self.scores.theta
        other.fit(progress)
        return other

    def probability(self, z: Array) -> Array:
        """Return the calibrated predicted probability of the event, shape (m,), at points z, shape (m, d)."""
        return self._calibration(self.foresee(z, both=self._calibration.trust > 0))

    def foresee(self, z: Array, *, both: bool = True) -> Array:
        """Return the uncalibrated predictions of both surrogates at z, shape (m, d), as (m, 2)."""
        z = self.space.coordinates(z)
        by_flags = self.flags.probability(z)
        by_second = self._second(z) if both and self._second is not None else by_flags
        return np.column_stack([by_flags, by_second])

    def _by_scores(self, z: Array, below: float) -> Array:
        return self.scores.probability(z @ self.flags.axes, below, noisy=self._scores_are_noisy)
