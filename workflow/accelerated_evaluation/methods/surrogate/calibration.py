"""What the probabilities of the two surrogates are worth, by how often they came true.

Before every run of the second phase both surrogates say how probable an event is there, and afterwards the
flag is known. So the runs test them, one after the other (Dawid 1984). A prior does not fit every event: the
smooth boundary of a half-space is farther from any doubt than the surrogate of the flags says, and a fine
structure is nearer. Doubt is learnt at once, and sureness only as far as the runs have shown it.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import expit, log_ndtr, ndtr, ndtri

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.methods.surrogate.constants import (
    LEAST_TRUST,
    LOG_SLOPE_BOUNDS,
    MOST_TRUST,
    SLOPE_SPREAD,
    SUREST,
)
from accelerated_evaluation.methods.surrogate.two_phase import Flags


@dataclass(frozen=True)
class Slopes:
    """p becomes Phi(b Phi^-1(p)), with one slope b where p is below one half, and one above.

    Attributes
    ----------
    unlikely, likely
        The two slopes. Above 1 the surrogate has been less sure than it should be, below 1 surer.
    """

    unlikely: float = 1.0
    likely: float = 1.0

    @classmethod
    def learn(cls, foreseen: Array, happened: Flags) -> Self:
        """Return the slopes that the runs bear out; log b is normal about 0 before any run.

        They are those of highest posterior density, but above 1 less by a posterior standard deviation of the
        logarithm, as Laplace approximates it.

        Parameters
        ----------
        foreseen
            Probabilities that the surrogate gave to runs before they were made, shape (n,).
        happened
            Whether the event happened, shape (n,).
        """
        below = foreseen < 0.5
        return cls(*(_slope(foreseen[side], happened[side]) for side in (below, ~below)))

    def __call__(self, probability: Array) -> Array:
        """Return calibrated probabilities, shape (n,)."""
        probit = _probit(probability)
        return ndtr(np.where(probit < 0, self.unlikely, self.likely) * probit)


@dataclass(frozen=True)
class Calibration:
    """How far the two surrogates are believed: a mixture of what both say, each with its own slopes.

    Attributes
    ----------
    first, second
        Slopes of the two.
    trust
        Share of the second in the mixture.
    """

    first: Slopes = Slopes()
    second: Slopes = Slopes()
    trust: float = 0.0

    @classmethod
    def learn(cls, foreseen: Array, happened: Flags, least: float = 0.0) -> Self:
        """Return what the runs bear out.

        The trust is the posterior probability that the second foretells better, by Bayes' rule and with even
        odds before any run, times `MOST_TRUST`. So the first always keeps a share, and the second alone can
        lower a probability by a factor of 20 at most. Below `LEAST_TRUST` it is 0.

        Parameters
        ----------
        foreseen
            Probabilities that the two surrogates gave to runs before they were made, shape (n, 2).
        happened
            Whether the event happened, shape (n,).
        least
            Share that the second always keeps.
        """
        slopes = [Slopes.learn(said, happened) for said in foreseen.T]
        calibrated = [slope(said) for slope, said in zip(slopes, foreseen.T, strict=True)]
        first, second = (np.log(np.where(happened, p, 1 - p)).sum() for p in calibrated)
        trust = float(MOST_TRUST * expit(second - first))
        return cls(*slopes, max(trust if trust >= LEAST_TRUST else 0.0, least))

    def __call__(self, foreseen: Array) -> Array:
        """Return calibrated probabilities, shape (m,), for what the two surrogates say, shape (m, 2)."""
        by_first, by_second = self.first(foreseen[:, 0]), self.second(foreseen[:, 1])
        return (1 - self.trust) * by_first + self.trust * by_second


def _slope(foreseen: Array, happened: Flags) -> float:
    towards = np.where(happened, 1, -1) * _probit(foreseen)

    def surprise(log_slope: float) -> float:
        return (log_slope / SLOPE_SPREAD) ** 2 / 2 - log_ndtr(np.exp(log_slope) * towards).sum()

    best = minimize_scalar(surprise, bounds=LOG_SLOPE_BOUNDS, method="bounded").x
    u = np.exp(best) * towards
    ratio = np.exp(-u * u / 2 - log_ndtr(u)) / np.sqrt(2 * np.pi)
    # The second derivative of the surprise; of the runs it may be negative, and says nothing then.
    information = SLOPE_SPREAD**-2 + max((u * ratio * (u * (u + ratio) - 1)).sum(), 0.0)
    return float(np.exp(best if best < 0 else max(best - information**-0.5, 0.0)))


def _probit(probability: Array) -> Array:
    return ndtri(np.clip(probability, SUREST, 1 - SUREST))
