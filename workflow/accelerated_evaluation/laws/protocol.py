"""Interface of a law of cut-ins, a probability distribution of lead speed, range and closing speed.

A law draws cut-ins, maps normal scores to cut-ins, and computes the probability of intervals of the closing
speed for crash maps. It is a mixture over strata of the lead speed v_L. In each stratum, v_L follows the
recorded values, and two further coordinates describe a cut-in. The two coordinates are independent of each
other within the stratum.

For the paper's laws the coordinates are R^-1 and TTC^-1 themselves. A law whose closing speed depends on the
range uses coordinates with unit exponential distributions: the Rosenblatt transformation maps any pair of
dependent variables to such independent ones. Drawing, tilting, likelihood ratios, normal scores and interval
probabilities then need only the distributions of the two coordinates and the map from coordinates to cut-ins.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from fewruns.problems import normal_score_quantile
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.distributions import Distribution, Empirical
from accelerated_evaluation.distributions.tails import interval_probability


@dataclass(frozen=True)
class CutIns:
    """Cut-ins in the variables of the paper; every array has shape (n,).

    Attributes
    ----------
    lead_speed
        v_L [m/s].
    inverse_range
        R^-1 [1/m].
    inverse_ttc
        TTC^-1 [1/s], the closing speed times R^-1.
    """

    lead_speed: Array
    inverse_range: Array
    inverse_ttc: Array

    @property
    def encounters(self) -> Array:
        """Lead speed [m/s], range [m] and closing speed [m/s], before any cap, shape (n, 3)."""
        return np.column_stack([self.lead_speed, self.range_, self.closing_speed])

    def __len__(self) -> int:
        """Return the number n of cut-ins."""
        return len(self.lead_speed)

    @property
    def range_(self) -> Array:
        """The range R [m]."""
        return 1 / self.inverse_range

    @property
    def closing_speed(self) -> Array:
        """Host speed minus lead speed [m/s], before any cap."""
        return self.inverse_ttc / self.inverse_range


@dataclass(frozen=True)
class Factors:
    """The distributions of the two independent coordinates of a cut-in in a stratum.

    One instance describes the law f, and further instances describe proposals f*.
    """

    first: Distribution
    second: Distribution

    def logpdf(self, first: Array, second: Array) -> Array:
        """Return the joint log density of n pairs of coordinates; arguments and result have shape (n,)."""
        return self.first.logpdf(first) + self.second.logpdf(second)

    def rvs(self, generator: np.random.Generator, size: int) -> tuple[Array, Array]:
        """Return independent draws of both coordinates, each of shape (size,)."""
        return self.first.rvs(generator, size), self.second.rvs(generator, size)


class Stratum(ABC):
    """The distribution of the cut-ins in one stratum of the lead speed.

    Attributes
    ----------
    lead_speed
        Empirical distribution of v_L [m/s]; importance sampling does not change it.
    factors
        Distributions of the two coordinates under the law.
    """

    lead_speed: Empirical
    factors: Factors

    @property
    def pieces(self) -> Factors:
        """The distributions of `factors` as piecewise mixtures, whose pieces the paper's methods tilt.

        By default they are `factors` itself.
        """
        return self.factors

    @abstractmethod
    def cut_ins(self, lead_speed: Array, first: Array, second: Array) -> CutIns:
        """Return the n cut-ins with given v_L [m/s], first and second coordinates, each of shape (n,)."""

    @abstractmethod
    def first(self, lead_speed: ArrayLike, inverse_range: ArrayLike) -> Array:
        """Return the first coordinate, which increases with R^-1 [1/m] for fixed v_L [m/s]."""

    @abstractmethod
    def second(self, lead_speed: ArrayLike, inverse_range: ArrayLike, closing_speed: ArrayLike) -> Array:
        """Return the second coordinate, which increases with the closing speed for fixed v_L and R^-1.

        The arguments are v_L [m/s], R^-1 [1/m] and closing speed [m/s], of shapes that broadcast.
        """

    def second_at(self, lead_speed: Array, inverse_range: Array, closing_speeds: Array) -> Array:
        """Return the second coordinate of m closing speeds for each of n pairs of v_L and R^-1.

        Parameters
        ----------
        lead_speed, inverse_range
            v_L [m/s] and R^-1 [1/m], shape (n,).
        closing_speeds
            Closing speeds [m/s], shape (n, m).

        Returns
        -------
        numpy.ndarray
            The coordinates, shape (n, m).
        """
        columns = [self.second(lead_speed, inverse_range, speed) for speed in closing_speeds.T]
        return np.column_stack(columns)

    def log_first_slope(self, lead_speed: ArrayLike, inverse_range: ArrayLike) -> Array:
        """Return the log of the derivative of the first coordinate with respect to R^-1, for fixed v_L.

        The value is 0 if the first coordinate is R^-1 itself. The arguments are v_L [m/s] and R^-1 [1/m], of
        shapes that broadcast.
        """
        return np.zeros(np.broadcast_shapes(np.shape(lead_speed), np.shape(inverse_range)))

    def log_second_slope(self, lead_speed: Array, inverse_range: Array, closing_speed: Array) -> Array:
        """Return the log of the derivative of the second coordinate with respect to the closing speed.

        The value is log R^-1 if the second coordinate is TTC^-1 itself. Arguments (v_L [m/s], R^-1 [1/m] and
        closing speed [m/s]) and result have shape (n,).
        """
        return np.log(inverse_range)

    @property
    @abstractmethod
    def inverse_range_min(self) -> float:
        """The smallest R^-1 [1/m] in the support of the law."""

    def closing_speed_probability(
        self, lead_speed: Array, inverse_range: Array, start: Array, end: Array
    ) -> Array:
        """Return P(start <= closing speed < end) given v_L and R^-1.

        The exact crash probability of a crash map needs the distribution of the closing speed only in the
        form of these probabilities.

        Parameters
        ----------
        lead_speed, inverse_range
            v_L [m/s] and R^-1 [1/m], shape (n,).
        start, end
            Ends of the intervals of the closing speed [m/s], shape (n,); the end may be infinite.

        Returns
        -------
        numpy.ndarray
            Probabilities, shape (n,).
        """
        ends = (self.second(lead_speed, inverse_range, speed) for speed in (start, end))
        return interval_probability(self.factors.second, *ends)

    def cell_probability(self, lead_speed: Array, inverse_range: Array) -> Array:
        """Return the probability of rectangular cells of v_L and R^-1.

        If the first coordinate depends on v_L, it is evaluated at the middle of the cell's interval of v_L.

        Parameters
        ----------
        lead_speed, inverse_range
            Lower and upper v_L [m/s] and R^-1 [1/m] of each cell, shape (cells, 2); the last R^-1 may be
            infinite.

        Returns
        -------
        numpy.ndarray
            Probabilities, shape (cells,).
        """
        middle = lead_speed.mean(axis=1)
        ends = (self.first(middle, inverse_range[:, side]) for side in (0, 1))
        return self.lead_speed_share(lead_speed) * interval_probability(self.factors.first, *ends)

    def lead_speed_share(self, lead_speed: Array) -> Array:
        """Return the share of the recorded v_L in each interval [low, high) [m/s].

        Parameters
        ----------
        lead_speed
            The intervals, shape (n, 2).

        Returns
        -------
        numpy.ndarray
            Shares, shape (n,).
        """
        speeds = self.lead_speed.values
        return np.diff(np.searchsorted(speeds, lead_speed), axis=1)[:, 0] / speeds.size


class Law(ABC):
    """A law of cut-ins: a mixture over strata of the lead speed.

    Attributes
    ----------
    kind
        Name of this kind of law in files.
    description
        Description of the data to which the law was fitted.
    closing_speed_max
        Cap on the closing speed [m/s], which is applied before a cut-in is simulated; infinity means no cap.
    shares
        Share of each stratum in the lane changes, by name of the stratum and in order of the lead speed; the
        shares sum to one.
    strata
        The distribution in each stratum, by the same names.
    """

    kind: ClassVar[str]
    description: str
    closing_speed_max: float

    @property
    @abstractmethod
    def shares(self) -> Mapping[str, float]:
        """Share of each stratum, by name of the stratum."""

    @property
    @abstractmethod
    def strata(self) -> Mapping[str, Stratum]:
        """The distribution in each stratum, by name of the stratum."""

    @abstractmethod
    def only(self, stratum: str) -> Self:
        """Return the law restricted to one stratum, given by its name, whose share is then one."""

    def capped(self, closing_speed: Array) -> Array:
        """Return closing speeds [m/s], in which values above the cap of the law are replaced by the cap."""
        return np.minimum(closing_speed, self.closing_speed_max)

    def draw(self, generator: np.random.Generator, size: int) -> tuple[CutIns, NDArray[np.intp]]:
        """Draw independent cut-ins from the law, ordered by stratum.

        Parameters
        ----------
        generator
            Random generator.
        size
            Number n of cut-ins.

        Returns
        -------
        cut_ins : CutIns
            The cut-ins, of shape (n,).
        stratum : numpy.ndarray
            Index of the stratum of each cut-in, shape (n,).
        """
        counts = generator.multinomial(size, list(self.shares.values()))
        parts = []
        for stratum, count in zip(self.strata.values(), counts.tolist(), strict=True):
            lead_speed = stratum.lead_speed.rvs(generator, count)
            parts.append(stratum.cut_ins(lead_speed, *stratum.factors.rvs(generator, count)))
        columns = (np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0]))
        return CutIns(*columns), np.repeat(np.arange(len(counts)), counts)

    def stratum_of_normal_scores(self, z: Array) -> NDArray[np.intp]:
        """Return the index of the stratum for each row of normal scores z, shape (n, 3)."""
        share = np.array(list(self.shares.values()))
        return np.searchsorted(np.cumsum(share) - share, ndtr(z[:, 0]), side="right") - 1

    def from_normal_scores(self, z: Array) -> CutIns:
        """Map normal scores to cut-ins by the Rosenblatt transformation (Rosenblatt 1952).

        The first normal score determines both the stratum and v_L: the strata occupy adjacent intervals of
        the score, in order of v_L. A sampler in normal scores can therefore choose strata according to their
        contribution to the event.

        Parameters
        ----------
        z
            Normal scores of v_L and of the two coordinates, shape (n, 3).

        Returns
        -------
        CutIns
            The cut-ins, of shape (n,).
        """
        columns = np.empty((3, len(z)))
        for here, stratum, *coordinates in self.in_strata(z):
            columns[:, here] = list(vars(stratum.cut_ins(*coordinates)).values())
        return CutIns(*columns)

    def in_strata(self, z: Array) -> Iterator[tuple[NDArray[np.bool_], Stratum, Array, Array, Array]]:
        """Yield the strata with the normal scores that belong to them.

        Parameters
        ----------
        z
            Normal scores of v_L and of the two coordinates, shape (n, 3).

        Yields
        ------
        here : numpy.ndarray
            Which rows of z belong to the stratum, shape (n,); m rows do.
        stratum : Stratum
            The stratum.
        lead_speed, first, second : numpy.ndarray
            v_L [m/s] and the two coordinates of these rows, each of shape (m,).
        """
        u, index = ndtr(z[:, 0]), self.stratum_of_normal_scores(z)
        share = np.array(list(self.shares.values()))
        before = np.cumsum(share) - share
        for k, stratum in enumerate(self.strata.values()):
            here = index == k
            lead_speed = stratum.lead_speed.ppf((u[here] - before[k]) / share[k])
            first = normal_score_quantile(stratum.factors.first, z[here, 1])
            second = normal_score_quantile(stratum.factors.second, z[here, 2])
            yield here, stratum, lead_speed, first, second

    def encounters(self, z: Array) -> Array:
        """Return the cut-ins at normal scores z, shape (n, 3), in the form in which vehicles are simulated.

        The rows are lead speed [m/s], range [m] and closing speed [m/s] with the cap of the law, shape (3,
        n).
        """
        cut_ins = self.from_normal_scores(z)
        return np.stack([cut_ins.lead_speed, cut_ins.range_, self.capped(cut_ins.closing_speed)])
