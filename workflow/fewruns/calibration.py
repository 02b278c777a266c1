"""Calibration of the surrogates' predictions by the outcomes of later runs (Dawid 1984)."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import expit, log_ndtr, ndtr, ndtri

from fewruns.arrays import Array, Flags
from fewruns.constants import LEAST_TRUST, LOG_SLOPE_BOUNDS, MOST_TRUST, SLOPE_SPREAD, SUREST


@dataclass(frozen=True)
class Slopes:
    """Calibration p -> Phi(b Phi^-1(p)); a slope b above 1 corrects an underconfident surrogate."""

    unlikely: float = 1.0  # the slope below one half  # the slope for p below one half
    likely: float = 1.0  # the slope above one half  # the slope for p above one half

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
        of 20, or 0 if this is below `LEAST_TRUST`.
        """
        slopes = [Slopes.learn(predicted, happened) for predicted in foreseen.T]
        calibrated = [slope(predicted) for slope, predicted in zip(slopes, foreseen.T, strict=True)]
        first, second = (np.log(np.where(happened, p, 1 - p)).sum() for p in calibrated)
        trust = float(MOST_TRUST * expit(second - first + log_odds))
        return cls(*slopes, max(trust if trust >= LEAST_TRUST else 0.0, least))

    def __call__(self, foreseen: Array) -> Array:
        """Return calibrated probabilities, shape (m,), from both surrogates' predictions, shape (m, 2)."""
        by_first, by_second = self.first(foreseen[:, 0]), self.second(foreseen[:, 1])
        return (1 - self.trust) * by_first + self.trust * by_second


def _slope(foreseen: Array, happened: Flags) -> float:
    """Return the slope that is supported by the runs, as `Slopes.learn` describes."""
    towards = np.where(happened, 1, -1) * _probit(foreseen)

    def loss(log_slope: float) -> float:
        return (log_slope / SLOPE_SPREAD) ** 2 / 2 - log_ndtr(np.exp(log_slope) * towards).sum()

    best = minimize_scalar(loss, bounds=LOG_SLOPE_BOUNDS, method="bounded").x
    u = np.exp(best) * towards
    ratio = np.exp(-u * u / 2 - log_ndtr(u)) / np.sqrt(2 * np.pi)
    # The second derivative of the negative log likelihood of the runs may be negative; it is then ignored.
    information = SLOPE_SPREAD**-2 + max((u * ratio * (u * (u + ratio) - 1)).sum(), 0.0)
    return float(np.exp(best if best < 0 else max(best - information**-0.5, 0.0)))


def _probit(probability: Array) -> Array:
    return ndtri(np.clip(probability, SUREST, 1 - SUREST))
