"""The few coordinates on which an event depends, for problems with many normal scores.

They are the components along a few orthogonal directions (active subspaces, Constantine 2015), and the
distance from their span, because many small effects may act through their sum. They are transformed such that
they are standard normal, and independent of the uniform direction of z across the subspace. A distribution of
the coordinates therefore defines a distribution of z with the same ratio to the normal density.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtr, chdtrc, chdtri, gammaincinv, ndtr, ndtri_exp

from fewruns.arrays import Array
from fewruns.constants import LEAST_SINGULAR

OUTERMOST = 37.0  # largest normal score; tail probabilities beyond it underflow


@dataclass(frozen=True)
class WholeSpace:
    """The space of all normal scores, in which the coordinates of a point are its normal scores."""

    dimension: int

    def coordinates(self, z: Array) -> Array:
        """Return the coordinates of points z, shape (n, d), which are the points themselves."""
        return z

    def draw(self, coordinates: Array, generator: np.random.Generator) -> Array:
        """Return the points with given coordinates, shape (n, d), which are the coordinates themselves."""
        return coordinates


@dataclass(frozen=True)
class Subspace:
    """A subspace spanned by a few directions, with the distance from it as additional coordinate."""

    axes: Array  # orthonormal directions as columns, shape (d, k) with k < d

    @property
    def dimension(self) -> int:
        """Number of coordinates, k + 1."""
        return self.axes.shape[1] + 1

    @property
    def _across(self) -> int:
        return self.axes.shape[0] - self.axes.shape[1]

    def coordinates(self, z: Array) -> Array:
        """Return components of z along the k axes and score of the distance from them, (n, k + 1)."""
        along = z @ self.axes
        square = np.maximum((z * z).sum(1) - (along * along).sum(1), 0.0)
        return np.column_stack([along, outward(square, self._across)])

    def draw(self, coordinates: Array, generator: np.random.Generator) -> Array:
        """Draw points, shape (n, d), with given coordinates and uniform directions across the axes."""
        across = generator.normal(size=(len(coordinates), len(self.axes)))
        across -= (across @ self.axes) @ self.axes.T
        radius = np.sqrt(square_of_distance(coordinates[:, -1], self._across))
        across *= (radius / np.linalg.norm(across, axis=1))[:, None]
        return coordinates[:, :-1] @ self.axes.T + across


Space = WholeSpace | Subspace


def space_along(directions: Array | None, dimension: int) -> Space:
    """Return the space along directions, shape (d, k), or of all normal scores if they are None."""
    if directions is None:
        return WholeSpace(dimension)
    axes, length, _ = np.linalg.svd(directions, full_matrices=False)
    return Subspace(axes[:, length > LEAST_SINGULAR * length[0]])


def outward(square: Array, dimension: int) -> Array:
    """Return the normal scores of squared distances, from the smaller tail of the chi-squared law."""
    outer = square > 2 * gammaincinv(dimension / 2, 0.5)
    with np.errstate(divide="ignore"):  # where the smaller probability underflows
        smaller = np.log(np.where(outer, chdtrc(dimension, square), chdtr(dimension, square)))
    return np.where(outer, -1, 1) * np.maximum(ndtri_exp(smaller), -OUTERMOST)


def square_of_distance(score: Array, dimension: int) -> Array:
    """Return the squared distances whose normal scores are given, shape (n,); the inverse of `outward`."""
    smaller = ndtr(-np.minimum(np.abs(score), OUTERMOST))
    return np.where(score > 0, chdtri(dimension, smaller), 2 * gammaincinv(dimension / 2, smaller))
