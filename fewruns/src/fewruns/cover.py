"""A cover: runs that are so dense that every simple part of the event would contain one of them.

As in `certificate`, a mode lies beyond the plane that is perpendicular to its point x nearest to the origin,
and contains the ball of radius 1 / curvature that touches this plane at x. If u is the direction and b the
length of x, a run z is in this ball if

    curvature (|z|^2 + b^2) / 2 + b <= (1 + curvature b) u.z

A mode that contains a run would have been observed. All runs count, whatever they were made for.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri, ndtr, ndtri

from fewruns.arrays import Array, Flags
from fewruns.constants import (
    CANDIDATES,
    COVER_MISSED,
    COVER_REACH,
    COVER_SHARE,
    FARTHEST,
    MODES,
    ROUNDEST,
    ROUNDNESS,
    ROUNDNESS_OF_FLAGS,
)
from fewruns.errors import InputError
from fewruns.two_phase import choose_covering, reach_of


@dataclass(frozen=True)
class Cover:
    """The requirement that the runs exclude all unobserved modes above a probability.

    Attributes
    ----------
    share
        Largest allowed ratio of the probability of an unobserved mode to the estimate.
    curvature
        Largest curvature of the modes, one over a length in normal scores.

    Examples
    --------
    >>> thorough = Cover(share=0.2, curvature=1.0)
    """

    share: float
    curvature: float

    def __post_init__(self) -> None:
        if not (self.share > 0 and 0 < self.curvature < math.inf):
            expected = "share above 0, curvature finite and above 0"
            raise InputError("cover", seen=f"{self}", expected=expected, change="Correct the values.")

    @classmethod
    def by_default(cls, dimension: int, *, with_scores: bool = True) -> "Cover":
        """Return the default cover for a number of inputs; modes are flatter if there are many."""
        curvature = (ROUNDNESS if with_scores else ROUNDNESS_OF_FLAGS) / dimension**2.5
        return cls(COVER_SHARE, min(curvature, ROUNDEST) if with_scores else curvature)

    def unseen(self, z: Array) -> float:
        """Return the probability of the farthest modes up to which all but `COVER_MISSED` contain a run."""
        dimension = z.shape[1]
        generator = np.random.Generator(np.random.PCG64(dimension))
        u, b = draw_modes(MODES, dimension, FARTHEST, generator)
        b = np.sort(b)
        missed = np.cumsum(~self._met(z, u, b)) > COVER_MISSED * np.arange(1, MODES + 1)
        return float(ndtr(-b[missed.argmax()] if missed.any() else -FARTHEST))

    def next_runs(
        self, n: int, z: Array, probability: float, unseen: float, generator: np.random.Generator
    ) -> Array:
        """Return n points, shape (n, d), that exclude most modes at least as probable as ``probability``.

        The modes that are at least as probable as ``unseen`` contain a run z already (`unseen`).
        """
        dimension, farthest = z.shape[1], -float(ndtri(probability))
        # The near modes come first. They are a small share of all modes, but none of them may be missed.
        farthest = min(farthest, max(1.0, -2 * float(ndtri(unseen))))
        # Other modes than those of `unseen`, which would otherwise be excluded better than all others.
        u, b = draw_modes(MODES, dimension, farthest, generator)
        if (met := self._met(z, u, b)).all():
            met[:] = False
        u, b = u[~met], b[~met]
        # Candidates near the directions of these modes, at the radius that needs the least angle.
        mode = generator.integers(len(u), size=CANDIDATES)
        step = generator.normal(size=(CANDIDATES, dimension))
        step *= (generator.random(CANDIDATES) / np.linalg.norm(step, axis=1))[:, None]
        longest = np.sqrt(chdtri(dimension, np.exp(-max(COVER_REACH, reach_of(probability)))))
        radius = np.minimum(np.sqrt(b[mode] ** 2 + 2 * b[mode] / self.curvature), longest)
        points = u[mode] + step
        points *= (radius / np.linalg.norm(points, axis=1))[:, None]
        return points[choose_covering(self._contain(points, u, b), n)]

    def _met(self, z: Array, u: Array, b: Array) -> Flags:
        """Return whether each of t modes contains a run, shape (t,)."""
        return self._contain(z, u, b).any(axis=0)

    def _contain(self, z: Array, u: Array, b: Array) -> Flags:
        """Return whether points z, (n, d), are in the modes of t directions and distances, shape (n, t)."""
        k = self.curvature
        # One product in place of several arrays of this shape, which would take most of the time.
        points, planes = [z.T, k * (z * z).sum(1) / 2], [(1 + k * b) * u.T, -np.ones(len(b))]
        return np.vstack(points).T @ np.vstack(planes) >= k * b * b / 2 + b


def draw_modes(
    n: int, dimension: int, farthest: float, generator: np.random.Generator
) -> tuple[Array, Array]:
    """Return n random modes, more of them the farther out: directions, shape (n, d), and distances."""
    u = generator.normal(size=(n, dimension))
    return u / np.linalg.norm(u, axis=1)[:, None], farthest * np.sqrt(generator.random(n))
