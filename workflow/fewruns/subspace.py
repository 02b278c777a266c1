"""The few coordinates on which an event depends, for problems with many normal scores.

In high dimensions, an event usually depends on few directions only (active subspaces, Constantine 2015). A
point z is described by its components along a few orthogonal directions, and by its distance from the
subspace that they span. The distance is included because many small effects may act through their sum. All
these coordinates are transformed such that they are standard normal. They are independent of each other, and
of the direction of z perpendicular to the subspace, which is uniform. A distribution of the coordinates
therefore defines a distribution of z, and the ratio of the normal density to its density is the same in both
spaces.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtr, chdtrc, chdtri, gammaincinv, ndtr, ndtri_exp

from fewruns.arrays import Array
from fewruns.constants import LEAST_SINGULAR

OUTERMOST = 37.0  # largest normal score; tail probabilities beyond it underflow


@dataclass(frozen=True)
class WholeSpace:
    """The space of all normal scores, in which the coordinates of a point are its normal scores.

    Attributes
    ----------
    dimension
        Number of coordinates.
    """

    dimension: int

    def coordinates(self, z: Array) -> Array:
        """Return the coordinates of points z, shape (n, d), which are the points themselves."""
        return z

    def draw(self, coordinates: Array, generator: np.random.Generator) -> Array:
        """Return the points with given coordinates, shape (n, d), which are the coordinates themselves."""
        return coordinates


@dataclass(frozen=True)
class Subspace:
    """A subspace spanned by a few directions, with the distance from it as additional coordinate.

    Attributes
    ----------
    axes
        Orthonormal directions as columns, shape (d, k) with k < d.
    """

    axes: Array

    @property
    def dimension(self) -> int:
        """Number of coordinates, k + 1."""
        return self.axes.shape[1] + 1

    @property
    def _across(self) -> int:
        return self.axes.shape[0] - self.axes.shape[1]

    def coordinates(self, z: Array) -> Array:
        """Return the coordinates of points z, shape (n, k + 1).

        They are the components along the k axes, and the normal score of the distance from their span.
        """
        along = z @ self.axes
        square = np.maximum((z * z).sum(1) - (along * along).sum(1), 0.0)
        return np.column_stack([along, outward(square, self._across)])

    def draw(self, coordinates: Array, generator: np.random.Generator) -> Array:
        """Draw points with given coordinates, and with uniform directions perpendicular to the axes.

        Parameters
        ----------
        coordinates
            Coordinates of n points, shape (n, k + 1).
        generator
            Source of the directions.

        Returns
        -------
        numpy.ndarray
            Points, shape (n, d).
        """
        across = generator.normal(size=(len(coordinates), len(self.axes)))
        across -= (across @ self.axes) @ self.axes.T
        radius = np.sqrt(square_of_distance(coordinates[:, -1], self._across))
        across *= (radius / np.linalg.norm(across, axis=1))[:, None]
        return coordinates[:, :-1] @ self.axes.T + across


Space = WholeSpace | Subspace


def space_along(directions: Array | None, dimension: int) -> Space:
    """Return the space in which the event is learnt: a subspace, or the space of all normal scores.

    Parameters
    ----------
    directions
        Directions on which the event depends, as columns, shape (d, k). Directions with a negligible singular
        value are left out. None stands for the space of all normal scores.
    dimension
        Number d of normal scores.
    """
    if directions is None:
        return WholeSpace(dimension)
    axes, length, _ = np.linalg.svd(directions, full_matrices=False)
    return Subspace(axes[:, length > LEAST_SINGULAR * length[0]])


def outward(square: Array, dimension: int) -> Array:
    """Return the normal scores Phi^-1(F(square)), where F is the chi-squared distribution function.

    The smaller of the two tail probabilities is used, because it is the more accurate one.

    Parameters
    ----------
    square
        Squared distances of standard normal vectors from the origin, shape (n,).
    dimension
        Number of components of the vectors, the degrees of freedom of F.
    """
    outer = square > 2 * gammaincinv(dimension / 2, 0.5)
    with np.errstate(divide="ignore"):  # where the smaller probability underflows
        smaller = np.log(np.where(outer, chdtrc(dimension, square), chdtr(dimension, square)))
    return np.where(outer, -1, 1) * np.maximum(ndtri_exp(smaller), -OUTERMOST)


def square_of_distance(score: Array, dimension: int) -> Array:
    """Return the squared distances from the origin whose normal scores are given; the inverse of `outward`.

    Parameters
    ----------
    score
        Normal scores Phi^-1(F(squared distance)), shape (n,), with the chi-squared distribution function F.
    dimension
        Degrees of freedom of F.

    Returns
    -------
    numpy.ndarray
        Squared distances, shape (n,).
    """
    smaller = ndtr(-np.minimum(np.abs(score), OUTERMOST))
    return np.where(score > 0, chdtri(dimension, smaller), 2 * gammaincinv(dimension / 2, smaller))
