"""Mixture of normal distributions, each truncated to a box: the law of left turns and of pedestrians.

The density is sum_k share_k N(x; mean_k, covariance_k) / mass_k on the box, where mass_k is the probability
of the box under component k.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.special import logsumexp, ndtr, ndtri

from accelerated_evaluation.base.arrays import Array, Chosen, numbers_in
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.randomness import DRAWING
from accelerated_evaluation.laws import LAWS
from accelerated_evaluation.laws.joint import JointLaw, Sample
from accelerated_evaluation.laws.joint.expectation_maximisation import (
    Fitted,
    fit_mixture,
    parameters_of_mixture,
)
from accelerated_evaluation.laws.joint.truncated import Normals, shares_of_one, symmetric
from accelerated_evaluation.laws.protocol import Box
from accelerated_evaluation.laws.smooth.mixtures import solve

COMPONENTS = 4
TABLE_STEP = 0.25  # distance of nodes in the table of the first variable, in standard deviations
TABLE_REACH = 6.0  # number of standard deviations around a component within which nodes are dense
FARTHEST = 8.0  # largest absolute value of a normal score
PAIRS_AT_ONCE = 1_000_000  # number of points times components, which limits the memory for densities
MAPPED_AT_ONCE = 800  # number of points times components, so that arrays stay in the cache of the processor


@LAWS.add("truncated_normals")
@dataclass(frozen=True, eq=False)
class TruncatedNormalMixture(JointLaw):
    """Mixture of K normal distributions, each truncated to the box."""

    candidates: ClassVar[Mapping[str, Mapping[str, int]]] = {
        f"truncated normals, K = {k}": {"components": k} for k in (2, 3, 4, 6, 8)
    }

    shares: Array  # share of each component in the probability within the box, (K,)
    normals: Normals  # the components before the truncation, with the box
    fitted: Fitted | None = None  # None if the law was not fitted

    @classmethod
    def fitted_to(cls, sample: Sample, components: int = COMPONENTS) -> Self:  # type: ignore[override]
        """Return the mixture of K ``components``, fitted by the EM algorithm for truncated data."""
        begin = None if sample.start is None else (sample.start.shares, sample.start.normals)
        own = sample.x, sample.box, components, sample.generator, sample.weights
        return cls(*fit_mixture(*own, begin))

    @property
    def box(self) -> Box:
        """The variables and their limits."""
        return self.normals.box

    @property
    def components(self) -> int:
        """Number K of components."""
        return len(self.shares)

    @property
    def n_parameters(self) -> int:
        """Number of fitted parameters: 10 K - 1 in three dimensions."""
        return parameters_of_mixture(self.components, self.dimension)

    @cached_property
    def log_scale(self) -> Array:
        """Log of share_k / mass_k of each component, shape (K,)."""
        with np.errstate(divide="ignore"):
            return np.log(self.shares) - np.log(self.normals.masses)

    def log_density(self, x: Array) -> Array:
        """Return the log density, shape (n,), at points x, shape (n, d); it is -inf outside the box."""
        logs, size = np.full(len(x), -np.inf), max(PAIRS_AT_ONCE // self.components, 1)
        inside = np.flatnonzero(self.box.contains(x))
        for first in range(0, inside.size, size):
            part = inside[first : first + size]
            logs[part] = logsumexp(self.normals.log_densities(x[part]) + self.log_scale[:, None], axis=0)
        return logs

    def log_slice(self, k: int, x: Array, low: Array, high: Array) -> Array:
        """Return the log of the integral of the density over variable k; see `SlicedLaw`."""
        low, high = (np.clip(end, self.box.lower[k], self.box.upper[k]) for end in (low, high))
        logs, size = np.empty(len(x)), max(PAIRS_AT_ONCE // self.components, 1)
        for first in range(0, len(x), size):
            part = slice(first, first + size)
            slices = self.normals.log_slices(k, x[part], low[part], high[part])
            logs[part] = logsumexp(slices + self.log_scale[:, None], axis=0)
        return logs

    @checked(**DRAWING)
    def draw(self, n: int, generator: np.random.Generator) -> Array:
        """Draw n independent points, shape (n, d); points outside the box are rejected and drawn again."""
        missing = generator.multinomial(n, self.shares)
        drawn = []
        while missing.any():
            component = np.repeat(np.arange(self.components), missing)
            e = generator.standard_normal((len(component), self.dimension))
            x = self.normals.mean[component] + np.einsum("nij,nj->ni", self.normals.factor[component], e)
            inside = self.box.contains(x)
            drawn.append(x[inside])
            missing = missing - np.bincount(component[inside], minlength=self.components)
        return generator.permutation(np.concatenate([np.empty((0, self.dimension)), *drawn]))

    def from_normal_scores(self, z: Array) -> Array:
        """Map independent standard normal z to points that follow the law, both of shape (n, d).

        The distribution of the first variable is tabulated. The conditional distributions of the other
        variables are inverted by Newton's method. Probabilities are measured from the nearer end of the box,
        so that both tails are accurate.
        """
        first = self._first_quantile(z[:, 0])
        if self.dimension == 1:
            return first[:, None]
        size = max(MAPPED_AT_ONCE // self.components, 1)
        parts = [slice(begin, begin + size) for begin in range(0, len(z), size)]
        mapped = (self._mapped(first[part], z[part, 1:]) for part in parts)
        return np.concatenate([np.empty((0, self.dimension)), *mapped])

    def _mapped(self, first: Array, z: Array) -> Array:
        """Return points given the first variable, shape (n,), and normal scores of the others."""
        x, e = first[:, None], np.empty((self.components, len(z), 0))
        log_weight = np.repeat(self.log_scale[:, None], len(z), axis=1)
        for score in z.T:
            own, j = self.normals.next_standardised(e, x[:, -1]), e.shape[-1]
            e = np.concatenate([e, own[..., None]], axis=2)
            log_weight -= 0.5 * own**2 + np.log(self.normals.factor[:, j, j])[:, None]
            weight = np.exp(log_weight - log_weight.max(axis=0))
            x = np.column_stack([x, self._next_quantile(e, weight, score)])
        return x

    def _next_quantile(self, e: Array, weight: Array, z: Array) -> Array:
        """Return the next variable at normal scores z, shape (n,).

        It is conditional on the earlier e, shape (K, n, j), with the given weight of each component at each
        point.
        """
        low, high = self.box.lower[e.shape[-1]], self.box.upper[e.shape[-1]]
        from_top = z > 0

        def value_at(t: Array, top: Chosen) -> Array:
            return np.clip(np.where(top, high - t, low + t), low, high)

        def reached(t: Array, row: NDArray[np.intp]) -> tuple[Array, Array]:
            top, known, share = from_top[row], e.take(row, axis=1), weight.take(row, axis=1)
            value = value_at(t, top)
            ends = np.where(top, value, low), np.where(top, high, value)
            slope = self.normals.density_of_next(known, value)
            return (share * self.normals.between(known, *ends)).sum(axis=0), (share * slope).sum(axis=0)

        total = (weight * self.normals.between(e, np.full(z.size, low), np.full(z.size, high))).sum(axis=0)
        return value_at(
            solve(reached, total * ndtr(-np.abs(z)), np.full(z.size, (high - low) / 2), high - low), from_top
        )

    def _first_quantile(self, z: Array) -> Array:
        """Return the first variable at normal scores z, shape (n,), from the table of its distribution."""
        nodes, below, above = self._table
        value = np.empty_like(z)
        for sign, side in ((z > 0, above), (z <= 0, below)):
            level = ndtr(-np.abs(z[sign]))
            begin = np.full(level.size, (nodes[-1] - nodes[0]) / 2)
            t = solve(lambda t, _, side=side: (side(t), side(t, 1)), level, begin, nodes[-1] - nodes[0])
            value[sign] = nodes[-1] - t if side is above else nodes[0] + t
        return np.clip(value, nodes[0], nodes[-1])

    @cached_property
    def _table(self) -> tuple[Array, CubicHermiteSpline, CubicHermiteSpline]:
        """Nodes of the first variable, and the probabilities below and above a value as splines.

        The splines are functions of the distance from the lower and from the upper limit of the variable.
        """
        nodes, normals = self._first_nodes(), self.normals
        weight = np.exp(self.log_scale)
        nothing = np.empty((self.components, nodes.size, 0))
        density = weight @ normals.density_of_next(nothing, nodes)
        mass = weight @ normals.between(nothing[:, 1:], nodes[:-1], nodes[1:])
        mass, density = mass / mass.sum(), density / mass.sum()
        below = CubicHermiteSpline(nodes - nodes[0], np.append(0.0, np.cumsum(mass)), density)
        above = CubicHermiteSpline(
            (nodes[-1] - nodes)[::-1], np.append(0.0, np.cumsum(mass[::-1])), density[::-1]
        )
        return nodes, below, above

    def _first_nodes(self) -> Array:
        """Return nodes of the first variable that are dense where a component is narrow."""
        mean, deviation = self.normals.mean[:, 0], self.normals.factor[:, 0, 0]
        nodes, last = [self.box.lower[0]], self.box.upper[0]
        while nodes[-1] < last:
            free = np.abs(nodes[-1] - mean) - TABLE_REACH * deviation
            step = np.maximum(free, TABLE_STEP * deviation).min()
            nodes.append(min(nodes[-1] + min(step, (last - self.box.lower[0]) / 16), last))
        return np.array(nodes)

    def normal_scores(self, x: Array) -> Array:
        """Return the normal scores of values x, shape (n,), for a law of one variable.

        Scores are limited to `FARTHEST`, because the scores of the limits of the variable are infinite.
        """
        nothing, weight = np.empty((self.components, x.size, 0)), np.exp(self.log_scale)
        (low,), (high,) = self.box.lower, self.box.upper
        below, above = (
            weight @ self.normals.between(nothing, *ends)
            for ends in ((np.full(x.size, low), x), (x, np.full(x.size, high)))
        )
        return np.clip(np.where(below < above, ndtri(below), -ndtri(above)), -FARTHEST, FARTHEST)

    def content(self) -> dict[str, Any]:
        """Return the parameters of the law, for JSON."""
        numbers = zip(self.shares.tolist(), self.normals.mean, self.normals.covariance, strict=True)
        return {
            "components": [
                {"share": share, "mean": mean.tolist(), "covariance": covariance.tolist()}
                for share, mean, covariance in numbers
            ],
            "fit": None if self.fitted is None else asdict(self.fitted),
        }

    @classmethod
    def from_content(cls, content: Mapping[str, Any], box: Box, records: pd.DataFrame | None = None) -> Self:
        """Build a law from the value that `content` returned, and from its box."""
        parts = content["components"]
        shares, mean, covariance = (
            [part[name] for part in parts] for name in ("share", "mean", "covariance")
        )
        fitted = None if content["fit"] is None else Fitted(**content["fit"])
        return cls(shares_of_one(shares), Normals(numbers_in(mean), symmetric(covariance), box), fitted)
