"""What is believed of the event at a point that was not simulated: what two surrogates say, calibrated.

One surrogate learns from the flags of the runs alone, and is right wherever the event may be. The other one
learns from the scores, which say more where the system is smooth, and mislead where it jumps. Where a like
vehicle is known, the first learns from its runs too, which mislead where the vehicles differ, and the second
from the own flags alone. How far each is believed follows from what they foretold.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.methods.surrogate.calibration import Calibration
from accelerated_evaluation.methods.surrogate.constants import MOST_TRUST, RELEARN
from accelerated_evaluation.methods.surrogate.gaussian_process import EventSurrogate, Predecessor
from accelerated_evaluation.methods.surrogate.graded import GradedSurrogate, end_of_events, graded
from accelerated_evaluation.methods.surrogate.kernel import principal_axes
from accelerated_evaluation.methods.surrogate.state import Progress
from accelerated_evaluation.methods.surrogate.subspace import Space


class Belief:
    """Probability of the event at any point, by all runs so far.

    Parameters
    ----------
    space
        The coordinates that the surrogates know.
    predecessor
        Runs of a vehicle that is alike; None for none. Their scores are not known, so that scores would know
        much less than flags do, and have no say.

    Attributes
    ----------
    space
        The coordinates that the surrogates know.
    flags, scores
        The surrogate of all flags, and the regression of the scores along the same axes.
    """

    def __init__(self, space: Space, predecessor: Predecessor | None) -> None:
        self.space = space
        self.flags = EventSurrogate(space.dimension, predecessor)
        self.scores = GradedSurrogate(space.dimension)
        self._has_predecessor = predecessor is not None
        self._second: Callable[[Array], Array] | None = None
        self._calibration = Calibration()

    def fit(self, progress: Progress) -> None:
        """Learn from what was seen; now and then the axes, the lengths and the amplitudes too.

        The axes tried are the principal ones of the events, and of the points that mattered in the last pool.
        A thin event may lie across the normal scores, and the surrogate then finds its boundary much sooner
        along its own axes.
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
        if self._has_predecessor and runs:
            # With the prior's lengths, so that nothing of it must be kept in a state.
            own_flags = EventSurrogate(z.shape[1])
            own_flags.fit(z, happened, learn=False)
            self._second = own_flags.probability
        elif not self._has_predecessor and happened.any() and not happened.all():
            outcome = graded(happened, progress.score)
            self.scores.fit(z @ self.flags.axes, outcome, learn=learn)
            self._second = partial(self._by_scores, below=end_of_events(outcome, happened))
        foretold = len(progress.foreseen)
        least = 1 - MOST_TRUST if self._has_predecessor else 0.0
        self._calibration = Calibration.learn(progress.foreseen, happened[runs - foretold :], least)

    def probability(self, z: Array) -> Array:
        """Return the calibrated probability of the event at points z, shape (m, d)."""
        return self._calibration(self.foresee(z, both=self._calibration.trust > 0))

    def foresee(self, z: Array, *, both: bool = True) -> Array:
        """Return what the two surrogates say of points z, shape (m, d), as it is: shape (m, 2).

        Where the second says nothing yet, for want of runs or of events among them, or is not asked, the
        first speaks for both.
        """
        z = self.space.coordinates(z)
        by_flags = self.flags.probability(z)
        by_second = self._second(z) if both and self._second is not None else by_flags
        return np.column_stack([by_flags, by_second])

    def _by_scores(self, z: Array, below: float) -> Array:
        return self.scores.probability(z @ self.flags.axes, below)
