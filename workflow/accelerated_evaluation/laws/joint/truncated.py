"""Integrals of normal distributions over a box: probabilities, moments and conditional probabilities.

Let L be the Cholesky factor of a covariance matrix. Then x = mean + L e, and the standardised variables e are
independent and standard normal. If e_1, ..., e_(j-1) are given, the limits of x_j are limits of e_j. An
integral over the box is therefore a sequence of one-dimensional integrals (Genz 1992). The last integral is
known in closed form, and the others are sums over Gauss-Legendre nodes. Unlike quasi-random integration, the
results are deterministic. With three variables a probability takes 32^2 evaluations.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.special import log_ndtr, ndtr

from accelerated_evaluation.base.arrays import Array, numbers_in
from accelerated_evaluation.laws.protocol import Box

NODES, NODE_WEIGHTS = np.polynomial.legendre.leggauss(32)
LOG_ROOT_2PI = 0.5 * np.log(2 * np.pi)
NEGLIGIBLE = 38.0  # log of the ratio of the largest density in an interval to a density that is ignored


def symmetric(value: Any) -> Array:  # noqa: ANN401
    """Return matrices from a file, shape (..., d, d); raise ValueError if they are not symmetric."""
    matrices = numbers_in(value)
    if not np.allclose(matrices, np.swapaxes(matrices, -1, -2)):
        raise ValueError("a covariance or correlation that is not symmetric")
    return matrices


def shares_of_one(value: Any) -> Array:  # noqa: ANN401
    """Return shares from a file, shape (k,); raise ValueError if they are negative or do not add up to 1."""
    shares = numbers_in(value)
    if (shares < 0).any() or not np.isclose(shares.sum(), 1.0, rtol=1e-6):
        raise ValueError(f"shares that are negative or add up to {shares.sum():g} instead of 1")
    return shares


def normal_density(e: Array) -> Array:
    """Return the density of the standard normal distribution at e."""
    return np.exp(-0.5 * e * e - LOG_ROOT_2PI)


def interval_mass(low: Array, high: Array) -> Array:
    """Return P(low < e < high) for a standard normal variable e, without cancellation in the upper tail."""
    flip = low > 0
    return np.maximum(ndtr(np.where(flip, -low, high)) - ndtr(np.where(flip, -high, low)), 0.0)


def log_interval_mass(low: Array, high: Array) -> Array:
    """Return log P(low < e < high) for a standard normal variable e, accurate in both tails."""
    flip = low > 0
    near = log_ndtr(np.where(flip, -low, high))
    far = log_ndtr(np.where(flip, -high, low))
    with np.errstate(divide="ignore", invalid="ignore"):
        mass = near + np.log(-np.expm1(far - near))
    return np.where(high > low, mass, -np.inf)


def gauss_nodes(low: Array, high: Array) -> tuple[Array, Array]:
    """Return Gauss-Legendre nodes in intervals, and their weights times the standard normal density.

    Nodes and weights have the shape (..., 32). Parts of an interval in which the density is negligible
    compared with its largest value are left out.
    """
    nearest = np.clip(0.0, low, high)
    reach = np.sqrt(nearest**2 + 2 * NEGLIGIBLE)
    low, high = np.clip(low, -reach, reach), np.clip(high, -reach, reach)
    half = (high - low)[..., None] / 2
    e = (high + low)[..., None] / 2 + half * NODES
    return e, half * NODE_WEIGHTS * normal_density(e)


@dataclass(frozen=True)
class Normals:
    """K normal distributions of d variables, and their integrals over parts of a box.

    Points are given in standardised variables e of shape (K, n, j): the first j variables of n points for
    each of the K distributions.
    """

    mean: Array  # shape (K, d)
    covariance: Array  # shape (K, d, d)
    box: Box

    def __post_init__(self) -> None:
        if not self.box.is_finite:
            raise ValueError(f"truncated normal distributions need finite limits, got {self.box}")

    @cached_property
    def factor(self) -> Array:
        """Lower Cholesky factors of the covariance matrices, shape (K, d, d)."""
        return np.linalg.cholesky(self.covariance)

    @property
    def nothing_given(self) -> Array:
        """Empty array, shape (K, 1, 0): standardised variables of one point if no variable is given."""
        return np.empty((len(self.mean), 1, 0))

    @cached_property
    def masses(self) -> Array:
        """Probability of the box under each distribution, shape (K,)."""
        return self.mass_beyond(self.nothing_given)[:, 0]

    def standardised(self, x: Array) -> Array:
        """Return the standardised variables e of points x, shape (n, d); the result has shape (K, n, d)."""
        difference = (x - self.mean[:, None, :]).transpose(0, 2, 1)
        return np.linalg.solve(self.factor, difference).transpose(0, 2, 1)

    def log_densities(self, x: Array) -> Array:
        """Return the log density of each distribution at points x, shape (n, d), as shape (K, n)."""
        e = self.standardised(x)
        scale = np.log(np.diagonal(self.factor, axis1=1, axis2=2)).sum(axis=1)
        return -0.5 * (e * e).sum(axis=2) - scale[:, None] - x.shape[1] * LOG_ROOT_2PI

    def log_slices(self, k: int, x: Array, low: Array, high: Array) -> Array:
        """Return the log of the integral of each density over x_k from low to high, shape (K, n).

        The other variables are those of the points x, shape (n, d). Given these, x_k is normal.
        """
        precision = np.linalg.inv(self.covariance)
        deviation = 1 / np.sqrt(precision[:, k, k])
        rest = [j for j in range(x.shape[1]) if j != k]
        difference = x[:, rest] - self.mean[:, None, rest]
        shift = np.einsum("knj,kj->kn", difference, precision[:, k, rest]) * deviation[:, None] ** 2
        centre = self.mean[:, k, None] - shift
        ends = ((end - centre) / deviation[:, None] for end in (low, high))
        others = Box(
            *(tuple(part[j] for j in rest) for part in (self.box.names, self.box.lower, self.box.upper))
        )
        marginal = Normals(self.mean[:, rest], self.covariance[:, rest][:, :, rest], others)
        return marginal.log_densities(x[:, rest]) + log_interval_mass(*ends)

    def next_standardised(self, e: Array, value: Array | float) -> Array:
        """Return e_(j+1), shape (K, n), from x_(j+1), shape (n,), and the earlier e, shape (K, n, j)."""
        j = e.shape[-1]
        shift = self.mean[:, None, j] + np.einsum("kni,ki->kn", e, self.factor[:, j, :j])
        return (value - shift) / self.factor[:, None, j, j]

    def mass_beyond(self, e: Array) -> Array:
        """Return P(remaining variables in the box | first j standardised variables e), shape (K, n)."""
        if e.shape[-1] == self.box.dimension:
            return np.ones(e.shape[:2])
        nodes, weight = self._nodes(e)
        mass = weight * interval_mass(*self._limits(nodes))
        return mass.reshape(*e.shape[:2], -1).sum(axis=2)

    def between(self, e: Array, low: Array | float, high: Array | float) -> Array:
        """Return P(next variable in [low, high], all later ones in the box | e), shape (K, n)."""
        ends = self.next_standardised(e, low), self.next_standardised(e, high)
        if e.shape[-1] == self.box.dimension - 1:
            return interval_mass(*ends)
        node, weight = gauss_nodes(*ends)
        return (weight * self.mass_beyond(_appended(e, node)).reshape(weight.shape)).sum(axis=2)

    def density_of_next(self, e: Array, value: Array) -> Array:
        """Return the density of the next variable times P(all later ones in the box), given e, (K, n)."""
        own = self.next_standardised(e, value)
        scale = self.factor[:, None, e.shape[-1], e.shape[-1]]
        return normal_density(own) / scale * self.mass_beyond(_appended(e, own[..., None]))

    def moments(self) -> tuple[Array, Array, Array]:
        """Return P(box) and the first two moments of x - mean within the box, of each distribution.

        Their shapes are (K,), (K, d) and (K, d, d).
        """
        e, weight = self._nodes(self.nothing_given)
        low, high = self._limits(e)
        ends, zeroth = (normal_density(low), normal_density(high)), interval_mass(low, high)
        first = weight * (ends[0] - ends[1])
        second = weight * (zeroth + low * ends[0] - high * ends[1])
        weight = weight * zeroth
        mass = weight.sum(axis=1)
        m1, m2 = np.empty(self.mean.shape), np.empty(self.covariance.shape)
        m1[:, :-1], m1[:, -1] = (weight[:, None] @ e)[:, 0], first.sum(axis=1)
        m2[:, :-1, :-1] = (weight[..., None] * e).transpose(0, 2, 1) @ e
        m2[:, -1, :-1] = m2[:, :-1, -1] = (first[:, None] @ e)[:, 0]
        m2[:, -1, -1] = second.sum(axis=1)
        m1, m2 = m1 / mass[:, None], m2 / mass[:, None, None]
        return mass, (self.factor @ m1[..., None])[..., 0], self.factor @ m2 @ self.factor.transpose(0, 2, 1)

    def _limits(self, e: Array) -> tuple[Array, Array]:
        """Return the limits of the standardised next variable, given the earlier variables; shape (K, n)."""
        j = e.shape[-1]
        return self.next_standardised(e, self.box.lower[j]), self.next_standardised(e, self.box.upper[j])

    def _nodes(self, e: Array) -> tuple[Array, Array]:
        """Return nodes of all variables but the last one, given the first variables e, shape (K, n, j).

        The nodes have the shape (K, n * m, d - 1), and their weights have the shape (K, n * m).
        """
        weight = np.ones(e.shape[:2])
        while e.shape[-1] < self.box.dimension - 1:
            node, own = gauss_nodes(*self._limits(e))
            e, weight = _appended(e, node), (weight[..., None] * own).reshape(len(e), -1)
        return e, weight


def _appended(e: Array, node: Array) -> Array:
    """Append m nodes of the next variable to each point: (K, n, j) and (K, n, m) to (K, n m, j + 1)."""
    flat = node.reshape(len(node), -1, 1)
    return np.concatenate([np.repeat(e, node.shape[2], axis=1), flat], axis=2)
