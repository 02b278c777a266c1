"""Penalised B-splines and their tensor products on gridded data, with knots inside the support.

A smooth function of three variables is given by an array of coefficients of products of B-splines, with one
axis for each variable (Eilers and Marx 1996). If the data are binned on a grid, products with the design
matrix can be computed along one axis after the other (generalised linear array models, Currie, Durban and
Eilers 2006).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve

from accelerated_evaluation.base.arrays import Array

DEGREE = 3
ORDER = 2  # order of the differences that are penalised, so that linear functions have no penalty
RIDGE = 1e-6  # added to the diagonal, so that coefficients of regions without data stay finite
SMOOTHING_BOUNDS = (1e-3, 1e5)  # smallest and largest smoothing parameter
SMOOTHING_TOLERANCE = 0.05  # relative change at which the search for smoothing parameters ends
SMOOTHING_ROUNDS = 30

# Maximises a penalised likelihood: takes starting values and the precision of the coefficients, and returns
# the values at the maximum and the upper Cholesky factor of the information there.
Maximise = Callable[[Array, Array], tuple[Array, Array]]


@dataclass(frozen=True)
class Basis:
    """Cubic B-splines with equally spaced knots on an interval; beyond its ends they are constant."""

    low: float
    high: float
    segments: int  # number of intervals between knots; there are three more functions

    @property
    def size(self) -> int:
        """Number of B-splines in the basis."""
        return self.segments + DEGREE

    def __call__(self, x: ArrayLike) -> Array:
        """Return the values of the functions at n points, shape (n, size)."""
        step = (self.high - self.low) / self.segments
        knots = self.low + step * np.arange(-DEGREE, self.segments + DEGREE + 1)
        inside = np.clip(np.asarray(x, dtype=float), self.low, self.high)
        return BSpline.design_matrix(inside, knots, DEGREE, extrapolate=True).toarray()

    def penalty(self) -> Array:
        """Return the matrix P, shape (size, size), of the roughness penalty b' P b of coefficients b.

        The penalty is the sum of squared second differences of the coefficients.
        """
        differences = np.diff(np.eye(self.size), n=min(ORDER, self.size - 1), axis=0)
        return differences.T @ differences


@dataclass(frozen=True)
class Constant:
    """The basis for a variable on which the function does not depend: one function, which is 1."""

    size: int = 1

    def __call__(self, x: ArrayLike) -> Array:
        """Return ones, shape (n, 1)."""
        return np.ones((np.size(x), 1))

    def penalty(self) -> Array:
        """Return the matrix of the roughness penalty, shape (1, 1): it is 0, as a constant has none."""
        return np.zeros((1, 1))


@dataclass(frozen=True)
class Penalty:
    """Roughness penalties of the coefficients of a tensor product, one for each axis."""

    matrices: Array  # one for each axis, for all coefficients in C order, (axes, coefficients, coefficients)
    roots: Array  # eigenvalues of the matrices, which have common eigenvectors, (axes, coefficients)

    @classmethod
    def of(cls, bases: Sequence[Basis | Constant]) -> "Penalty":
        """Return the roughness penalties of a tensor product of bases, one for each axis."""
        matrices, roots = [], []
        for axis, basis in enumerate(bases):
            parts = [np.eye(other.size) for other in bases]
            values = [np.ones(other.size) for other in bases]
            parts[axis] = basis.penalty()
            # Linear functions have no penalty; eigenvalues that are zero up to rounding are set to zero.
            values[axis] = np.linalg.eigvalsh(parts[axis])
            values[axis][values[axis] < 1e-10] = 0
            matrices.append(reduce(np.kron, parts))
            roots.append(reduce(np.kron, values))
        return cls(np.array(matrices), np.array(roots))

    def total(self, smoothing: ArrayLike) -> Array:
        """Return the precision matrix of the normal prior of the coefficients.

        It is the sum of the penalty matrices, each multiplied by its smoothing parameter, and of a small
        ridge, so that the coefficients of regions without data stay finite.
        """
        whole = np.tensordot(np.asarray(smoothing, dtype=float), self.matrices, 1)
        whole[np.diag_indices_from(whole)] += RIDGE
        return whole

    def maximised(
        self, maximise: Maximise, values: Array, known: tuple[float, ...] | None = None
    ) -> tuple[Array, Array, tuple[float, ...]]:
        """Return the values at the maximum, the Cholesky factor of the information, and the smoothing.

        ``maximise`` begins at given values, of which the coefficients come first. The smoothing parameters
        are estimated if they are not ``known``.
        """
        chosen = np.ones(len(self.roots)) if known is None else np.array(known)
        values, factor = maximise(values, self.total(chosen))
        for _ in range(SMOOTHING_ROUNDS if known is None else 0):
            covariance, p = cho_solve((factor, False), np.eye(len(factor))), self.matrices.shape[1]
            before, chosen = chosen, self.smoother(chosen, values.ravel()[:p], covariance[:p, :p])
            values, factor = maximise(values, self.total(chosen))
            if np.all(np.abs(np.log(chosen / before)) < SMOOTHING_TOLERANCE):
                break
        return values, factor, tuple(map(float, chosen))

    def smoother(self, smoothing: Array, coefficients: Array, covariance: Array) -> Array:
        """Return improved smoothing parameters by one fixed-point step of Wood and Fasiolo (2017).

        Coefficients and covariance are the posterior mean and covariance for the current parameters. The
        result is within `SMOOTHING_BOUNDS`.
        """
        total = smoothing @ self.roots
        inverse = np.divide(1.0, total, out=np.zeros_like(total), where=total > 0)
        free = self.roots @ inverse - np.einsum("kij,ij->k", self.matrices, covariance)
        rough = np.einsum("i,kij,j->k", coefficients, self.matrices, coefficients)
        # A constant basis has no penalty, and its parameter is not changed.
        new = smoothing * np.maximum(free, 1e-6) / np.maximum(rough, 1e-12)
        return np.where(self.roots.any(axis=1), np.clip(new, *SMOOTHING_BOUNDS), smoothing)


@dataclass(frozen=True)
class Tensor:
    """Tensor product of three bases on a grid."""

    # For each axis, the values of its basis functions at the nodes, (nodes, size).
    matrices: tuple[Array, Array, Array]

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the coefficient array: the number of basis functions of each axis."""
        return tuple(matrix.shape[1] for matrix in self.matrices)

    def values(self, coefficients: Array) -> Array:
        """Return the values on the grid of the function with the given coefficient array."""
        return _along(coefficients, self.matrices)

    def transposed(self, grid: Array) -> Array:
        """Return X' y for the design matrix X and values y on the grid, as a coefficient array."""
        return _along(grid, tuple(matrix.T for matrix in self.matrices))

    def gram(self, weights: Array) -> Array:
        """Return X' W X for the design matrix X and weights W on the grid, (coefficients, coefficients)."""
        squares = tuple(
            (matrix[:, :, None] * matrix[:, None, :]).reshape(len(matrix), -1).T for matrix in self.matrices
        )
        a, b, c = self.shape
        product = _along(weights, squares).reshape(a, a, b, b, c, c)
        return product.transpose(0, 2, 4, 1, 3, 5).reshape(a * b * c, a * b * c)


def _along(array: Array, matrices: Sequence[Array]) -> Array:
    """Multiply an array with a matrix along each of its axes."""
    for matrix in matrices:
        # Each step contracts the first axis and appends the result as the last axis. After all steps the axes
        # are in the original order.
        array = np.tensordot(array, matrix, (0, 1))
    return array
