"""Laws of cut-ins in strata of the lead speed, in each of which two further coordinates are independent.

A law is a mixture over strata of the lead speed v_L. In each stratum, v_L follows the recorded values, and
two further coordinates describe a cut-in. They are independent of each other within the stratum.

For the paper's laws the coordinates are R^-1 and TTC^-1 themselves. A law whose closing speed depends on the
range uses coordinates with unit exponential distributions: the Rosenblatt transformation maps any pair of
dependent variables to such independent ones. Drawing, tilting, likelihood ratios, normal scores and interval
probabilities then need only the distributions of the two coordinates and the map from coordinates to cut-ins.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from fewruns.problems import normal_score_quantile
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import value_digest
from accelerated_evaluation.base.randomness import DRAWING
from accelerated_evaluation.laws.distributions import Empirical, Tiltable
from accelerated_evaluation.laws.protocol import Box, Law

VARIABLES = ("lead_speed", "range", "closing_speed")


@dataclass(frozen=True)
class Factors:
    """The distributions of the two independent coordinates of a cut-in in a stratum.

    One instance describes the law f, and further instances describe proposals f*.
    """

    first: Tiltable
    second: Tiltable

    def logpdf(self, first: Array, second: Array) -> Array:
        """Return the joint log density of n pairs of coordinates; arguments and result have shape (n,)."""
        return self.first.logpdf(first) + self.second.logpdf(second)

    def rvs(self, generator: np.random.Generator, size: int) -> tuple[Array, Array]:
        """Return independent draws of both coordinates, each of shape (size,)."""
        return self.first.rvs(generator, size), self.second.rvs(generator, size)


class Stratum(ABC):
    """The distribution of the cut-ins in one stratum of the lead speed."""

    lead_speed: Empirical  # of v_L [m/s]; importance sampling does not change it
    factors: Factors  # distributions of the two coordinates under the law

    @property
    def pieces(self) -> Factors:
        """The distributions of `factors` as piecewise mixtures, whose pieces the paper's methods tilt.

        By default they are `factors` itself.
        """
        return self.factors

    @abstractmethod
    def points(self, lead_speed: Array, first: Array, second: Array) -> Array:
        """Return the n cut-ins with given v_L [m/s] and coordinates, each of shape (n,).

        The columns are lead speed [m/s], range [m] and closing speed [m/s] before any cap, shape (n, 3).
        """

    @abstractmethod
    def first(self, lead_speed: ArrayLike, inverse_range: ArrayLike) -> Array:
        """Return the first coordinate, which increases with R^-1 [1/m] for fixed v_L [m/s]."""

    @abstractmethod
    def second(self, lead_speed: ArrayLike, inverse_range: ArrayLike, closing_speed: ArrayLike) -> Array:
        """Return the second coordinate, which increases with the closing speed for fixed v_L and R^-1.

        The arguments are v_L [m/s], R^-1 [1/m] and closing speed [m/s], of shapes that broadcast.
        """

    def second_at(self, lead_speed: Array, inverse_range: Array, closing_speeds: Array) -> Array:
        """Return the second coordinate of m closing speeds for each of n pairs of v_L and R^-1, (n, m)."""
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
    def range_max(self) -> float:
        """The largest range [m] in the support of the law; it may be infinite."""

    def closing_speed_probability(
        self, lead_speed: Array, inverse_range: Array, start: Array, end: Array
    ) -> Array:
        """Return P(start <= closing speed < end) given v_L [m/s] and R^-1 [1/m], all of shape (n,).

        The end may be infinite. The exact crash probability of a crash map needs the distribution of the
        closing speed only in the form of these probabilities.
        """
        ends = self.second_at(lead_speed, inverse_range, np.column_stack([start, end]))
        return self.factors.second.interval_probability(*ends.T)

    def cell_probability(self, lead_speed: Array, inverse_range: Array) -> Array:
        """Return the probability of cells of v_L [m/s] and R^-1 [1/m], given by bounds (cells, 2).

        The last R^-1 may be infinite. If the first coordinate depends on v_L, it is evaluated at the middle
        of the cell's interval of v_L.
        """
        middle = lead_speed.mean(axis=1)
        ends = (self.first(middle, inverse_range[:, side]) for side in (0, 1))
        return self.lead_speed_share(lead_speed) * self.factors.first.interval_probability(*ends)

    def lead_speed_share(self, lead_speed: Array) -> Array:
        """Return the share of the recorded v_L in each of n intervals.

        ``lead_speed`` contains the ends of the intervals [low, high) [m/s], shape (n, 2).
        """
        speeds = self.lead_speed.values
        return np.diff(np.searchsorted(speeds, lead_speed), axis=1)[:, 0] / speeds.size

    def log_density(self, x: Array, cap: float = math.inf) -> Array:
        """Return the log density of range and closing speed given v_L at cut-ins x, shape (n, 3).

        At the cap on the closing speed [m/s], the density of the closing speed is replaced by the probability
        that it reaches the cap.
        """
        lead_speed, range_, closing_speed = x.T
        inverse_range = 1 / range_
        second = self.second(lead_speed, inverse_range, closing_speed)
        of_speed = self.factors.second.logpdf(second)
        of_speed += self.log_second_slope(lead_speed, inverse_range, closing_speed)
        of_speed = np.where(closing_speed >= cap, self.factors.second.logsf(second), of_speed)
        return self._log_density_of_range(lead_speed, inverse_range) + of_speed

    def log_slice(self, x: Array, low: Array, high: Array) -> Array:
        """Return the log of the density of the range given v_L, times P(low <= closing speed < high).

        Lead speeds [m/s] and ranges [m] are those of cut-ins x, shape (n, 3). The ends [m/s] have the shape
        (n,), and the upper ones may be infinite.
        """
        lead_speed, inverse_range = x[:, 0], 1 / x[:, 1]
        with np.errstate(divide="ignore"):
            of_speed = np.log(self.closing_speed_probability(lead_speed, inverse_range, low, high))
        return self._log_density_of_range(lead_speed, inverse_range) + of_speed

    def _log_density_of_range(self, lead_speed: Array, inverse_range: Array) -> Array:
        """Return the log density of the range given v_L [m/s], at n values of R^-1 [1/m]."""
        first = self.first(lead_speed, inverse_range)
        # |d(first) / dR| = |d(first) / d(R^-1)| R^-2
        slope = self.log_first_slope(lead_speed, inverse_range) + 2 * np.log(inverse_range)
        return self.factors.first.logpdf(first) + slope


class StratifiedLaw(Law):
    """A law of cut-ins: a mixture over strata of the lead speed.

    Attributes
    ----------
    closing_speed_max
        Cap on the closing speed [m/s]; infinity means no cap.
    counts
        Number of lane changes in each stratum, by name of the stratum and in order of the lead speed. A law
        whose `shares` do not follow from them has no counts.
    shares
        Share of each stratum in the lane changes, by name of the stratum and in order of the lead speed; the
        shares sum to one.
    strata
        The distribution in each stratum, by the same names.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> config = ae.load(given={"data": {"sample": 2000, "spmd": {"outlier_rows": []}}})
    >>> law = ae.fit_paper_law("two_pieces", ae.read_records(config), config)
    >>> isinstance(law, ae.StratifiedLaw), len(law.strata)
    (True, 3)
    """

    needs_records: ClassVar[bool] = True
    closing_speed_max: float
    counts: Mapping[str, int]

    @property
    def shares(self) -> dict[str, float]:
        """Share of each stratum, by name of the stratum."""
        total = sum(self.counts.values())
        return {stratum: count / total for stratum, count in self.counts.items()}

    @property
    @abstractmethod
    def strata(self) -> Mapping[str, Stratum]:
        """The distribution in each stratum, by name of the stratum."""

    @abstractmethod
    def only(self, stratum: str) -> Self:
        """Return the law restricted to one stratum, given by its name, whose share is then one."""

    @property
    def box(self) -> Box:
        """Limits of the cut-ins; none for the lead speed [m/s], which is drawn from the records."""
        farthest = max(stratum.range_max for stratum in self.strata.values())
        return Box(VARIABLES, (0.0, 0.0, 0.0), (math.inf, farthest, self.closing_speed_max))

    @property
    def digest(self) -> str:
        """The digest of the law and of its lead speeds, which are not part of its content."""
        return value_digest([super().digest, *(repr(part.lead_speed) for part in self.strata.values())])

    def capped(self, closing_speed: Array) -> Array:
        """Return closing speeds [m/s], in which values above the cap of the law are replaced by the cap."""
        return np.minimum(closing_speed, self.closing_speed_max)

    @checked(**DRAWING)
    def draw(self, n: int, generator: np.random.Generator) -> Array:
        """Draw n independent cut-ins, ordered by stratum, shape (n, 3)."""
        return self.draw_in_strata(n, generator)[0]

    def draw_in_strata(self, n: int, generator: np.random.Generator) -> tuple[Array, NDArray[np.intp]]:
        """Draw n independent cut-ins, shape (n, 3), and the index of the stratum of each, shape (n,)."""
        counts = generator.multinomial(n, list(self.shares.values()))
        parts = []
        for stratum, count in zip(self.strata.values(), counts.tolist(), strict=True):
            lead_speed = stratum.lead_speed.rvs(generator, count)
            parts.append(stratum.points(lead_speed, *stratum.factors.rvs(generator, count)))
        return self.with_cap(np.concatenate(parts)), np.repeat(np.arange(len(counts)), counts)

    def stratum_of_normal_scores(self, z: Array) -> NDArray[np.intp]:
        """Return the index of the stratum for each row of normal scores z, shape (n, 3)."""
        share = np.array(list(self.shares.values()))
        return np.searchsorted(np.cumsum(share) - share, ndtr(z[:, 0]), side="right") - 1

    def from_normal_scores(self, z: Array) -> Array:
        """Map normal scores of v_L and of the two coordinates to cut-ins, both of shape (n, 3).

        The first normal score determines both the stratum and v_L: the strata occupy adjacent intervals of
        the score, in order of v_L. A sampler in normal scores can therefore choose strata according to their
        contribution to the event.
        """
        x = np.empty((len(z), 3))
        for here, stratum, *coordinates in self.in_strata(z):
            x[here] = stratum.points(*coordinates)
        return self.with_cap(x)

    def in_strata(self, z: Array) -> Iterator[tuple[NDArray[np.bool_], Stratum, Array, Array, Array]]:
        """Yield the flags of the normal scores z, shape (n, 3), that belong to each stratum, and the stratum.

        With them come v_L [m/s] and the two coordinates at these m normal scores, each of shape (m,).
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

    def log_density(self, x: Array) -> Array:
        """Return the log density of range and closing speed given v_L at cut-ins, shape (n, 3).

        At the cap, the density of the closing speed is replaced by the probability of the cap.
        """
        logs, inside, stratum = np.full(len(x), -math.inf), self.box.contains(x), self._stratum_of(x[:, 0])
        for k, each in enumerate(self.strata.values()):
            here = inside & (stratum == k)
            logs[here] = each.log_density(x[here], self.closing_speed_max)
        return logs

    def log_slice(self, k: int, x: Array, low: Array, high: Array) -> Array:
        """Return the log of the integral of the density over the closing speed; see `SlicedLaw`.

        As in `log_density`, it is the density given the lead speed. The probability of the cap belongs to the
        intervals that contain the cap. InputError is raised for another variable than the closing speed.
        """
        low, high = self._speed_interval(k, low, high)
        logs, stratum = np.full(len(x), -math.inf), self._stratum_of(x[:, 0])
        met = (x[:, 1] > 0) & (x[:, 1] <= self.box.upper[1]) & (low < high)
        for index, each in enumerate(self.strata.values()):
            here = met & (stratum == index)
            logs[here] = each.log_slice(x[here], low[here], high[here])
        return logs

    def _speed_interval(self, k: int, low: Array, high: Array) -> tuple[Array, Array]:
        """Return intervals of the closing speed, with an infinite end where they contain the cap.

        An interval above the cap is empty.
        """
        if k != VARIABLES.index("closing_speed"):
            raise InputError(
                "log_slice of a law of cut-ins, argument k",
                seen=f"{k}, the variable {VARIABLES[k]}",
                expected="2, the closing speed, whose conditional distribution is known in closed form",
                change="Integrate over the closing speed.",
            )
        cap = self.closing_speed_max
        return np.where(low < cap, low, math.inf), np.where(high >= cap, math.inf, high)

    def _stratum_of(self, lead_speed: Array) -> NDArray[np.intp]:
        """Return the index of the stratum of each lead speed [m/s]; strata begin at their least record."""
        begins = [stratum.lead_speed.values[0] for stratum in self.strata.values()]
        return np.maximum(np.searchsorted(begins, lead_speed, side="right") - 1, 0)

    def with_cap(self, x: Array) -> Array:
        """Apply the cap on the closing speed to cut-ins x, shape (n, 3), in place, and return them."""
        x[:, 2] = self.capped(x[:, 2])
        return x
