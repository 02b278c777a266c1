"""The predicted probability of the event at a point that was not simulated: a mixture of two surrogates.

The first surrogate learns from the flags of the runs. The second one learns from the scores, which contain
more information if the system is smooth, and mislead if it has jumps. If there is a predecessor, the first
surrogate also learns from its runs, and the second one only from the flags of the system under test.
"""

from dataclasses import dataclass
from functools import partial
from typing import Self

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import expit, log_ndtr, ndtr, ndtri

from fewruns.arrays import Array, Flags, Function
from fewruns.constants import (
    AMPLITUDE,
    COVERED,
    FRINGE,
    MOST_RUNS,
    MOST_TRUST,
    NOISY_AMPLITUDE,
    NOISY_LOG_ODDS,
    SLOPE_SPREAD,
    SUREST,
)
from fewruns.gaussian_process import EventSurrogate, principal_axes
from fewruns.graded import GradedSurrogate, end_of_events, graded
from fewruns.pools import Space, Subspace
from fewruns.problems import Predecessor
from fewruns.progress import Progress


@dataclass(frozen=True)
class Slopes:
    """Calibration p -> Phi(b Phi^-1(p)); a slope b above 1 corrects an underconfident surrogate."""

    unlikely: float = 1.0  # the slope for p below one half
    likely: float = 1.0  # the slope for p above one half

    @classmethod
    def learn(cls, foreseen: Array, happened: Flags) -> Self:
        """Return the slopes that follow from predictions made before n runs and their outcomes, shapes (n,).

        Overconfidence is corrected in full, underconfidence only by the amount that the runs support: the
        posterior mode of log b, if it is above 0, is reduced by one posterior standard deviation, but not
        below 0.
        """
        below = foreseen < 0.5
        return cls(*(_slope(foreseen[side], happened[side]) for side in (below, ~below)))

    def __call__(self, probability: Array) -> Array:
        """Return the calibrated values of predicted probabilities, both of shape (n,)."""
        probit = _probit(probability)
        return ndtr(np.where(probit < 0, self.unlikely, self.likely) * probit)


@dataclass(frozen=True)
class Calibration:
    """The mixture of the predictions of two surrogates, each calibrated with its own slopes."""

    first: Slopes = Slopes()
    second: Slopes = Slopes()
    trust: float = 0.0  # weight of the second surrogate

    @classmethod
    def learn(cls, foreseen: Array, happened: Flags, least: float = 0.0, log_odds: float = 0.0) -> Self:
        """Return the mixture that follows from predictions for n runs, shape (n, 2), and their outcomes.

        The weight of the second surrogate is at least ``least``. Otherwise it is `MOST_TRUST` times the
        posterior probability that it predicts better, so that it can lower a probability at most by a factor
        of 20, or 0 if this is below `FRINGE`: it could then not bring a point into the fringe.
        """
        slopes = [Slopes.learn(predicted, happened) for predicted in foreseen.T]
        calibrated = [slope(predicted) for slope, predicted in zip(slopes, foreseen.T, strict=True)]
        first, second = (np.log(np.where(happened, p, 1 - p)).sum() for p in calibrated)
        trust = float(MOST_TRUST * expit(second - first + log_odds))
        return cls(slopes[0], slopes[1], max(trust if trust >= FRINGE else 0.0, least))

    def __call__(self, foreseen: Array) -> Array:
        """Return calibrated probabilities, shape (m,), from both surrogates' predictions, shape (m, 2)."""
        by_first, by_second = self.first(foreseen[:, 0]), self.second(foreseen[:, 1])
        return (1 - self.trust) * by_first + self.trust * by_second


def _slope(foreseen: Array, happened: Flags) -> float:
    """Return the slope that is supported by the runs, as `Slopes.learn` describes."""
    towards = np.where(happened, 1, -1) * _probit(foreseen)

    def loss(log_slope: float) -> float:
        return (log_slope / SLOPE_SPREAD) ** 2 / 2 - log_ndtr(np.exp(log_slope) * towards).sum()

    bounds = -4 * SLOPE_SPREAD, 5 * SLOPE_SPREAD
    best = minimize_scalar(loss, bounds=bounds, method="bounded").x
    u = np.exp(best) * towards
    ratio = np.exp(-u * u / 2 - log_ndtr(u)) / np.sqrt(2 * np.pi)
    # The second derivative of the negative log likelihood of the runs may be negative; it is then ignored.
    information = SLOPE_SPREAD**-2 + max((u * ratio * (u * (u + ratio) - 1)).sum(), 0.0)
    return float(np.exp(best if best < 0 else max(best - information**-0.5, 0.0)))


def _probit(probability: Array) -> Array:
    return ndtri(np.clip(probability, SUREST, 1 - SUREST))


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
        self._second: Function | None = None
        self._calibration = Calibration()

    def fit(self, progress: Progress, *, learn: bool) -> None:
        """Fit both surrogates to all runs, and ``learn`` their parameters again.

        The boundary of a thin set that is oblique to the scores is learnt from fewer runs along its principal
        axes.
        """
        z, happened, runs = self.space.coordinates(progress.z), progress.happened, len(progress.z)
        turned: list[Array] = []
        if learn:
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
            below = end_of_events(outcome, happened)
            self._second = partial(self._by_scores, below=below)
        foreseen = progress.foreseen
        is_fitted = self._predecessor is None and self._second is not None and runs <= MOST_RUNS
        if is_fitted and len(progress.z[0]) <= COVERED and not self._noisy:
            # The runs of the search were not predicted, but show as well which surrogate is better.
            left_out = np.column_stack([self.flags.left_out, self.scores.left_out(below)])
            foreseen = np.vstack([left_out[: runs - len(foreseen)], foreseen])
        least = 0.0 if self._predecessor is None else 1 - MOST_TRUST
        # If most outcomes are random, the regression with noise is the better model of the flags.
        log_odds = NOISY_LOG_ODDS if self._noisy else 0.0
        self._calibration = Calibration.learn(foreseen, happened[runs - len(foreseen) :], least, log_odds)

    def refitted(self, progress: Progress) -> "Belief":
        """Return surrogates with unchanged axes and lengths that are fitted to other runs."""
        other = Belief(self.space, self._predecessor, noisy=self._noisy)
        other.flags.axes, other.flags.theta = self.flags.axes, self.flags.theta
        other.scores.theta = self.scores.theta
        other.fit(progress, learn=False)
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
