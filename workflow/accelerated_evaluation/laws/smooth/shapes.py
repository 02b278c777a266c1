"""Shapes of an excess in units of its scale: exponential, generalised without an end, two kinds of drivers.

Each tells the cumulative hazard H(z), its inverse, and the log density log H'(z) - H(z) with its
derivatives by z and by the parameters of the shape, which have independent normal priors.
"""

from typing import ClassVar, Protocol

import numpy as np

from accelerated_evaluation.base.arrays import Array

SMALL = 1e-4  # shapes for which the derivative is taken from its series
HALVINGS = 40  # of an interval that holds an inverse


class Shape(Protocol):
    """The law of an excess of scale 1, with ``parameters`` of shape (q,)."""

    name: ClassVar[str]
    prior_mean: ClassVar[tuple[float, ...]]
    prior_deviation: ClassVar[tuple[float, ...]]

    def cumulative(self, z: Array, parameters: Array) -> Array:
        """Return H(z)."""

    def inverse(self, level: Array, parameters: Array) -> Array:
        """Return the excess at which H reaches a level."""

    def log_density(self, z: Array, parameters: Array) -> Array:
        """Return log H'(z) - H(z)."""

    def derivatives(self, z: Array, parameters: Array) -> tuple[Array, Array]:
        """Return the derivatives of the log density by z, shape (n,), and by the parameters, (n, q)."""


class Exponential:
    """Excesses without memory: H(z) = z."""

    name = "exponential"
    prior_mean = ()
    prior_deviation = ()

    def cumulative(self, z: Array, parameters: Array) -> Array:
        """Return z."""
        return np.asarray(z, dtype=float)

    inverse = cumulative

    def log_density(self, z: Array, parameters: Array) -> Array:
        """Return -z."""
        return -np.asarray(z, dtype=float)

    def derivatives(self, z: Array, parameters: Array) -> tuple[Array, Array]:
        """Return -1, and nothing."""
        return np.full_like(z, -1.0), np.empty((z.size, 0))


class Generalised:
    """Generalised Pareto excesses (Davison and Smith 1990), continued below shape 0 by a law without an end.

    Below zero the generalised Pareto law ends at a finite value, so that a single later record beyond it is
    impossible. The Gompertz law, whose hazard rises exponentially, takes its place:

        H(z) = log(1 + shape z) / shape         for shape > 0,
        H(z) = (1 - exp(-shape z)) / shape      for shape < 0.

    The two are inverse functions of each other with the sign of the shape changed, and both agree with
    z - shape z^2 / 2 to the second order, so the likelihood is smooth in the shape.
    """

    name = "generalised"
    prior_mean = (0.0,)
    prior_deviation = (0.1,)

    def cumulative(self, z: Array, parameters: Array) -> Array:
        """Return H(z)."""
        shape = float(parameters[0])
        if shape == 0:
            return np.asarray(z, dtype=float)
        with np.errstate(over="ignore"):
            return np.log1p(shape * z) / shape if shape > 0 else -np.expm1(-shape * z) / shape

    def inverse(self, level: Array, parameters: Array) -> Array:
        """Return the inverse of H, which is H with the sign of the shape changed."""
        return self.cumulative(level, -np.asarray(parameters))

    def log_density(self, z: Array, parameters: Array) -> Array:
        """Return log H'(z) - H(z)."""
        shape = float(parameters[0])
        log_hazard = -np.log1p(shape * z) if shape > 0 else -shape * np.asarray(z)
        return log_hazard - self.cumulative(z, parameters)

    def derivatives(self, z: Array, parameters: Array) -> tuple[Array, Array]:
        """Return the derivatives of the log density by z and by the shape."""
        shape = float(parameters[0])
        if shape > 0:
            inner = 1 + shape * z
            by_z = -(1 + shape) / inner
            by_shape = -z / inner + np.log1p(shape * z) / shape**2 - z / (shape * inner)
        else:
            growth = np.exp(-shape * z)
            by_z = -shape - growth
            by_shape = -z - (z * growth / shape + np.expm1(-shape * z) / shape**2 if shape else -(z**2) / 2)
        if abs(shape) < SMALL:  # the differences above are all rounding there
            third = 2 / 3 if shape > 0 else 1 / 3
            by_shape = -z + z**2 / 2 + max(shape, 0.0) * z**2 - shape * third * z**3
        return by_z, by_shape[:, None]


class TwoKinds:
    """Two kinds of drivers: P(Z > z) = (1 - share) exp(-z) + share exp(-z / ratio).

    The parameters are the logit of the share of the second kind among the excesses and the logarithm of the
    ratio of the two scales.
    """

    name = "two kinds"
    prior_mean = (-2.5, 0.3)
    prior_deviation = (1.0, 0.3)

    def cumulative(self, z: Array, parameters: Array) -> Array:
        """Return H(z)."""
        share, ratio = self._natural(parameters)
        log_survival = np.logaddexp(np.log1p(-share) - z, np.log(share) - np.asarray(z) / ratio)
        return np.maximum(-log_survival, 0)  # which rounding makes negative at z = 0

    def inverse(self, level: Array, parameters: Array) -> Array:
        """Return the inverse of H by bisection."""
        ratio = max(self._natural(parameters)[1], 1.0)
        level = np.asarray(level, dtype=float)
        low, high = np.zeros_like(level), level * ratio
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            short = self.cumulative(middle, parameters) < level
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        return (low + high) / 2

    def log_density(self, z: Array, parameters: Array) -> Array:
        """Return the log density."""
        first, second = self._parts(z, parameters)
        return np.logaddexp(first, second)

    def derivatives(self, z: Array, parameters: Array) -> tuple[Array, Array]:
        """Return the derivatives of the log density by z and by the two parameters."""
        share, ratio = self._natural(parameters)
        first, second = self._parts(z, parameters)
        second_kind = np.exp(second - np.logaddexp(first, second))
        by_z = -(1 - second_kind) - second_kind / ratio
        return by_z, np.column_stack([second_kind - share, second_kind * (z / ratio - 1)])

    @staticmethod
    def _natural(parameters: Array) -> tuple[float, float]:
        return float(1 / (1 + np.exp(-parameters[0]))), float(np.exp(parameters[1]))

    def _parts(self, z: Array, parameters: Array) -> tuple[Array, Array]:
        share, ratio = self._natural(parameters)
        z = np.asarray(z, dtype=float)
        return np.log1p(-share) - z, np.log(share / ratio) - z / ratio


SHAPES: dict[str, Shape] = {shape.name: shape for shape in (Exponential(), Generalised(), TwoKinds())}
