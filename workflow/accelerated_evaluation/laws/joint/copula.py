"""Joint laws with smooth marginal distributions: a Gaussian copula, and independent variables.

Each marginal distribution is a mixture of truncated normal distributions. Under the Gaussian copula, the
normal scores of the variables, each computed from its own marginal distribution, are jointly normal.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
import pandas as pd

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws import LAWS
from accelerated_evaluation.laws.joint import JointLaw, Sample
from accelerated_evaluation.laws.joint.truncated import log_interval_mass, symmetric
from accelerated_evaluation.laws.joint.truncated_normals import TruncatedNormalMixture
from accelerated_evaluation.laws.protocol import Box

MARGIN_COMPONENTS = (1, 2, 3, 4)  # numbers of components that are fitted; the smallest BIC decides
STRONGEST = 0.999  # largest absolute correlation


@LAWS.add("gaussian_copula")
@dataclass(frozen=True, eq=False)
class GaussianCopula(JointLaw):
    """Smooth marginal distributions with a Gaussian copula."""

    candidates: ClassVar[Mapping[str, Mapping[str, int]]] = {"Gaussian copula": {}}

    box: Box
    margins: Sequence[TruncatedNormalMixture]  # marginal distribution of each variable
    correlation: Array  # correlation matrix of the normal scores, (d, d)

    @classmethod
    def fitted_to(cls, sample: Sample) -> Self:  # type: ignore[override]  # it has no settings
        """Return the law with fitted marginal distributions, and the correlations of their normal scores."""
        margins = tuple(_margin(sample, j) for j in range(sample.box.dimension))
        z = _scores(margins, sample.x)
        second = z.T @ (sample.normalised[:, None] * z) / len(z)
        deviation = np.sqrt(np.diag(second))
        correlation = np.clip(second / np.outer(deviation, deviation), -STRONGEST, STRONGEST)
        np.fill_diagonal(correlation, 1.0)
        return cls(sample.box, margins, cls._correlation(correlation))

    @classmethod
    def _correlation(cls, estimated: Array) -> Array:
        """Return the correlation matrix of this kind of law, given the estimated one."""
        return estimated

    @property
    def n_parameters(self) -> int:
        """Number of fitted parameters of the margins and of the copula."""
        return (
            sum(margin.n_parameters for margin in self.margins) + self.dimension * (self.dimension - 1) // 2
        )

    @cached_property
    def _factor(self) -> Array:
        return np.linalg.cholesky(self.correlation)

    def log_density(self, x: Array) -> Array:
        """Return the log density, shape (n,), at points x, shape (n, d); it is -inf outside the box."""
        logs, inside = np.full(len(x), -np.inf), self.box.contains(x)
        z = _scores(self.margins, x[inside])
        e = np.linalg.solve(self._factor, z.T)
        copula = 0.5 * ((z**2).sum(axis=1) - (e**2).sum(axis=0)) - np.log(np.diag(self._factor)).sum()
        parts = (margin.log_density(x[inside, [j], None]) for j, margin in enumerate(self.margins))
        logs[inside] = copula + sum(parts)
        return logs

    def log_slice(self, k: int, x: Array, low: Array, high: Array) -> Array:
        """Return the log of the integral of the density over variable k; see `SlicedLaw`.

        Given the other variables, the normal score of the variable is normally distributed.
        """
        rest = [j for j in range(self.dimension) if j != k]
        z = _scores([self.margins[j] for j in rest], x[:, rest])
        precision = np.linalg.inv(self.correlation)
        deviation = 1 / np.sqrt(precision[k, k])
        centre = -(z @ precision[rest, k]) * deviation**2
        factor = np.linalg.cholesky(self.correlation[np.ix_(rest, rest)])
        e = np.linalg.solve(factor, z.T)
        others = 0.5 * ((z**2).sum(axis=1) - (e**2).sum(axis=0)) - np.log(np.diag(factor)).sum()
        others += sum(self.margins[j].log_density(x[:, [j]]) for j in rest)
        ends = (
            np.select(
                [value <= self.box.lower[k], value >= self.box.upper[k]],
                [-np.inf, np.inf],
                self.margins[k].normal_scores(np.clip(value, self.box.lower[k], self.box.upper[k])),
            )
            for value in (low, high)
        )
        return others + log_interval_mass(*((end - centre) / deviation for end in ends))

    def from_normal_scores(self, z: Array) -> Array:
        """Map independent standard normal z to points that follow the law, both of shape (n, d)."""
        dependent = z @ self._factor.T
        values = [margin.from_normal_scores(dependent[:, [j]]) for j, margin in enumerate(self.margins)]
        return np.hstack(values)

    def content(self) -> dict[str, Any]:
        """Return the parameters of the law, for JSON."""
        return {
            "margins": [margin.content() for margin in self.margins],
            "correlation": self.correlation.tolist(),
        }

    @classmethod
    def from_content(cls, content: Mapping[str, Any], box: Box, records: pd.DataFrame | None = None) -> Self:
        """Build a law from the value that `content` returned, and from its box."""
        margins = tuple(
            TruncatedNormalMixture.from_content(part, side(box, j))
            for j, part in enumerate(content["margins"])
        )
        return cls(box, margins, symmetric(content["correlation"]))


@LAWS.add("independent_variables")
@dataclass(frozen=True, eq=False)
class IndependentVariables(GaussianCopula):
    """Independent variables with smooth marginal distributions."""

    candidates: ClassVar[Mapping[str, Mapping[str, int]]] = {"independent": {}}

    @classmethod
    def _correlation(cls, estimated: Array) -> Array:
        return np.eye(len(estimated))

    @property
    def n_parameters(self) -> int:
        """Number of fitted parameters of the margins."""
        return sum(margin.n_parameters for margin in self.margins)


def side(box: Box, j: int) -> Box:
    """Return the one-dimensional box with the limits of the variable with index j."""
    return Box((box.names[j],), (box.lower[j],), (box.upper[j],))


def _margin(sample: Sample, j: int) -> TruncatedNormalMixture:
    """Return the marginal distribution of the variable with index j.

    The number of components is that of ``start`` if it is given, and otherwise the one with the smallest BIC.
    """
    start = None if sample.start is None else sample.start.margins[j]
    own = replace(sample, x=sample.x[:, [j]], box=side(sample.box, j), start=start)
    if start is not None:
        return TruncatedNormalMixture.fitted_to(own)
    fits = (TruncatedNormalMixture.fitted_to(own, components) for components in MARGIN_COMPONENTS)
    return min(fits, key=lambda law: law.fitted.bic)


def _scores(margins: Sequence[TruncatedNormalMixture], x: Array) -> Array:
    """Return the normal score of each variable under its marginal distribution, shape (n, d)."""
    return np.column_stack([margin.normal_scores(x[:, j]) for j, margin in enumerate(margins)])
