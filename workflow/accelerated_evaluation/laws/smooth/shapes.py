"""Shapes of the distribution of an excess: exponential, generalised Pareto, and two kinds of drivers.

An excess Z in units of its scale satisfies P(Z > z) = exp(-H(z)), where H is the cumulative hazard. Each
shape provides H(z), the inverse of H, and the log density log H'(z) - H(z) with its derivatives with respect
to z and to the parameters of the shape. The parameters have independent normal priors.
"""

from typing import Protocol

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.registry import Registry

SMALL = 1e-4  # absolute value of the shape parameter below which the derivative is computed from a series
BELOW_ONE = 1 - 2.0**-53  # the largest number below 1
HALVINGS = 40  # number of bisections of an interval that contains the inverse


class Shape(Protocol):
    """Interface of a distribution of the excess over a threshold, divided by its scale.

    The array ``parameters`` has the shape (q,). The methods `cumulative` and `log_density` also accept
    excesses of shape (k, n) with different parameters for each of the k rows, in an array of shape (q, k, 1).
    """

    name: str  # in files and tables
    prior_mean: tuple[float, ...]  # of the normal priors of the q parameters
    prior_deviation: tuple[float, ...]  # standard deviations of these priors

    def cumulative(self, z: Array, parameters: Array) -> Array:
        """Return the cumulative hazard H(z) = -log P(Z > z) at excesses z, of the shape of z."""

    def inverse(self, level: Array, parameters: Array) -> Array:
        """Return the excess z at which the cumulative hazard H(z) equals a level."""

    def log_density(self, z: Array, parameters: Array) -> Array:
        """Return the log density log H'(z) - H(z) at excesses z, of the shape of z."""

    def derivatives(self, z: Array, parameters: Array) -> tuple[Array, Array]:
        """Return the derivatives of the log density at z by z, (n,), and by the parameters, (n, q)."""


# Each shape is a candidate for the tail of the law of the answer. Shapes of users are in extensions.
SHAPES: Registry[Shape] = Registry("tail shape", __package__, [], contract=[Shape])


class Exponential:
    """Exponential excesses, which have the cumulative hazard H(z) = z."""

    name = "exponential"
    prior_mean: tuple[float, ...] = ()
    prior_deviation: tuple[float, ...] = ()

    def cumulative(self, z: Array, parameters: Array) -> Array:
        """Return the cumulative hazard H(z) = z at excesses z; there are no parameters."""
        return np.asarray(z, dtype=float)

    inverse = cumulative

    def log_density(self, z: Array, parameters: Array) -> Array:
        """Return the log density at excesses z, which is -z; there are no parameters."""
        return -np.asarray(z, dtype=float)

    def derivatives(self, z: Array, parameters: Array) -> tuple[Array, Array]:
        """Return the derivatives of the log density at excesses z, shape (n,).

        The derivative with respect to z is -1, shape (n,). There are no parameters, so the other array, with
        the derivatives with respect to them, is empty, shape (n, 0).
        """
        return np.full_like(z, -1.0), np.empty((z.size, 0))


class Generalised:
    """Generalised Pareto excesses (Davison and Smith 1990), or Gompertz excesses for negative shapes.

    A generalised Pareto distribution with a negative shape has a finite upper end, so that larger values are
    impossible, although they may be recorded later. For negative shapes it is therefore replaced by a
    Gompertz distribution, whose hazard increases exponentially and which has no upper end:

        H(z) = log(1 + shape z) / shape         for shape > 0,
        H(z) = (1 - exp(-shape z)) / shape      for shape < 0.

    Each of the two functions is the inverse of the other one with the opposite sign of the shape. Both agree
    with z - shape z^2 / 2 to second order, so the likelihood is smooth in the shape.
    """

    name = "generalised"
    prior_mean: tuple[float, ...] = (0.0,)
    prior_deviation: tuple[float, ...] = (0.1,)

    def cumulative(self, z: Array, parameters: Array) -> Array:
        """Return the cumulative hazard H(z) = -log P(Z > z) at excesses z, given the shape parameter."""
        z, shape = np.asarray(z, dtype=float), np.asarray(parameters[0], dtype=float)
        size = np.abs(shape)
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            curved = np.where(shape > 0, np.log1p(size * z), np.expm1(size * z)) / size
        return np.where(shape == 0, z, curved)

    def inverse(self, level: Array, parameters: Array) -> Array:
        """Return the excess z with H(z) = level: the inverse of H is H with the opposite shape."""
        return self.cumulative(level, -np.asarray(parameters))

    def log_density(self, z: Array, parameters: Array) -> Array:
        """Return the log density log H'(z) - H(z) at excesses z, given the shape parameter."""
        z, shape = np.asarray(z, dtype=float), np.asarray(parameters[0], dtype=float)
        log_hazard = np.where(shape > 0, -np.log1p(np.abs(shape) * z), -shape * z)
        return log_hazard - self.cumulative(z, parameters)

    def derivatives(self, z: Array, parameters: Array) -> tuple[Array, Array]:
        """Return the derivatives of the log density with respect to z and to the shape parameter.

        The arrays have the shapes (n,) and (n, 1) for excesses z of shape (n,).
        """
        shape = float(parameters[0])
        if shape > 0:
            inner = 1 + shape * z
            by_z = -(1 + shape) / inner
            by_shape = -z / inner + np.log1p(shape * z) / shape**2 - z / (shape * inner)
        else:
            growth = np.exp(-shape * z)
            by_z = -shape - growth
            by_shape = -z - (z * growth / shape + np.expm1(-shape * z) / shape**2 if shape else -(z**2) / 2)
        if abs(shape) < SMALL:  # the differences above would consist of rounding errors
            third = 2 / 3 if shape > 0 else 1 / 3
            by_shape = -z + z**2 / 2 + max(shape, 0.0) * z**2 - shape * third * z**3
        return by_z, by_shape[:, None]


class TwoKinds:
    """Excesses of two kinds of drivers: P(Z > z) = (1 - share) exp(-z) + share exp(-z / ratio).

    The first parameter is the logit of the share of the second kind among the excesses. The second parameter
    is the logarithm of the ratio of the scale of the second kind to the scale of the first kind.
    """

    name = "two kinds"
    prior_mean: tuple[float, ...] = (-2.5, 0.3)
    prior_deviation: tuple[float, ...] = (1.0, 0.3)

    def cumulative(self, z: Array, parameters: Array) -> Array:
        """Return the cumulative hazard H(z) = -log P(Z > z) at excesses z, given the two parameters."""
        share, ratio = self._natural(parameters)
        log_survival = np.logaddexp(self._log_first(parameters) - z, np.log(share) - np.asarray(z) / ratio)
        return np.maximum(-log_survival, 0)  # rounding could make it negative at z = 0

    def inverse(self, level: Array, parameters: Array) -> Array:
        """Return the excess z with H(z) = level, by bisection."""
        ratio = np.maximum(self._natural(parameters)[1], 1.0)
        level = np.asarray(level, dtype=float)
        low, high = np.zeros_like(level), level * ratio
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            short = self.cumulative(middle, parameters) < level
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        return (low + high) / 2

    def log_density(self, z: Array, parameters: Array) -> Array:
        """Return the log density log H'(z) - H(z) at excesses z, given the two parameters."""
        first, second = self._parts(z, parameters)
        return np.logaddexp(first, second)

    def derivatives(self, z: Array, parameters: Array) -> tuple[Array, Array]:
        """Return the derivatives of the log density with respect to z and to the two parameters.

        The arrays have the shapes (n,) and (n, 2) for excesses z of shape (n,).
        """
        share, ratio = self._natural(parameters)
        first, second = self._parts(z, parameters)
        second_kind = np.exp(second - np.logaddexp(first, second))
        by_z = -(1 - second_kind) - second_kind / ratio
        return by_z, np.column_stack([second_kind - share, second_kind * (z / ratio - 1)])

    @staticmethod
    def _natural(parameters: Array) -> tuple[Array, Array]:
        """Return share and ratio."""
        return 1 / (1 + np.exp(-parameters[0])), np.exp(parameters[1])

    def _parts(self, z: Array, parameters: Array) -> tuple[Array, Array]:
        """Return the logs of the weighted densities of the two kinds."""
        share, ratio = self._natural(parameters)
        z = np.asarray(z, dtype=float)
        return self._log_first(parameters) - z, np.log(share / ratio) - z / ratio

    def _log_first(self, parameters: Array) -> Array:
        """Return the log of the share of the first kind, from its logit if it is below 1e-16."""
        share = self._natural(parameters)[0]
        return np.where(share < 1, np.log1p(-np.minimum(share, BELOW_ONE)), -parameters[0])


for _shape in (Exponential(), Generalised(), TwoKinds()):
    SHAPES.add(_shape.name)(_shape)
