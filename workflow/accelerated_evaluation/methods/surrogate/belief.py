"""What is believed of the event at a point that was not simulated: what two surrogates say, calibrated.

One surrogate learns from the flags of the runs alone, and is right wherever the event may be. The other one
learns from the scores, which say more where the system is smooth, and mislead where it jumps. How far each is
believed follows from what they foretold.
"""

import numpy as np

from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.methods.surrogate.calibration import Calibration
from accelerated_evaluation.methods.surrogate.constants import RELEARN
from accelerated_evaluation.methods.surrogate.gaussian_process import EventSurrogate, Predecessor
from accelerated_evaluation.methods.surrogate.graded import GradedSurrogate, end_of_events, graded
from accelerated_evaluation.methods.surrogate.state import Progress


class Belief:
    """Probability of the event at any point, by all runs so far.

    Parameters
    ----------
    dimension
        Number d of normal scores.
    predecessor
        Runs of a vehicle that is alike; None for none. Their scores are not known, so that scores would know
        much less than flags do, and have no say.

    Attributes
    ----------
    flags, scores
        The surrogate of the flags, and the regression of the scores.
    """

    def __init__(self, dimension: int, predecessor: Predecessor | None) -> None:
        self.flags = EventSurrogate(dimension, predecessor)
        self.scores = GradedSurrogate(dimension)
        self._scores_have_a_say = predecessor is None
        self._end_of_events: float | None = None
        self._calibration = Calibration()

    def fit(self, progress: Progress) -> None:
        """Learn from what was seen; now and then the lengths and the amplitudes too."""
        z, happened, runs = progress.z, progress.happened, len(progress.z)
        first = not progress.estimates
        learn = first or runs >= RELEARN * progress.learnt_at
        if learn:
            progress.learnt_at = runs
        self.flags.fit(z, happened, learn=learn, restart=first)
        self._end_of_events = None
        if self._scores_have_a_say and happened.any() and not happened.all():
            outcome = graded(happened, progress.score)
            self.scores.fit(z, outcome, learn=learn)
            self._end_of_events = end_of_events(outcome, happened)
        foretold = len(progress.foreseen)
        self._calibration = Calibration.learn(progress.foreseen, happened[runs - foretold :])

    def probability(self, z: Array) -> Array:
        """Return the calibrated probability of the event at points z, shape (m, d)."""
        return self._calibration(self.foresee(z, both=self._calibration.trust > 0))

    def foresee(self, z: Array, *, both: bool = True) -> Array:
        """Return what the two surrogates say of points z, shape (m, d), as it is: shape (m, 2).

        Where scores have no say, or say nothing yet for want of events or of other runs, or are not asked,
        the flags speak for both.
        """
        by_flags = self.flags.probability(z)
        if not both or self._end_of_events is None:
            return np.column_stack([by_flags, by_flags])
        return np.column_stack([by_flags, self.scores.probability(z, self._end_of_events)])
