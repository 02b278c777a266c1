"""Kernel law: a mixture of truncated normal distributions, one about each record, with one covariance matrix.

The covariance matrix is that of the records times the square of a bandwidth. The bandwidth maximizes the
leave-one-out likelihood. If a record is left out, all records that are equal to it are left out as well,
because the likelihood would otherwise be largest for a bandwidth of zero.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
import pandas as pd
from scipy.special import logsumexp

from accelerated_evaluation.base.arrays import Array, numbers_in
from accelerated_evaluation.laws import LAWS
from accelerated_evaluation.laws.joint import Sample
from accelerated_evaluation.laws.joint.truncated import Normals, shares_of_one, symmetric
from accelerated_evaluation.laws.joint.truncated_normals import TruncatedNormalMixture
from accelerated_evaluation.laws.protocol import Box

FACTORS = (0.3, 0.4, 0.5, 0.6, 0.75, 0.9, 1.1, 1.4)  # multiples of Scott's bandwidth, n^(-1 / (d + 4))


@LAWS.add("kernel")
@dataclass(frozen=True, eq=False)
class KernelLaw(TruncatedNormalMixture):
    """A mixture of truncated normal distributions, one about each record."""

    candidates: ClassVar[Mapping[str, Mapping[str, int]]] = {"kernel": {}}

    @classmethod
    def fitted_to(cls, sample: Sample) -> Self:  # type: ignore[override]  # it has no settings
        """Return the law with the fitted bandwidth, or with the covariance matrix of the start."""
        x, box, start = sample.x, sample.box, sample.start
        shares = sample.normalised / len(x)
        if start is not None and np.array_equal(start.normals.mean, x):
            return replace(start, shares=shares)
        if start is not None:
            return cls(shares, _kernels(x, start.normals.covariance[0], box))
        return cls(shares, _best_kernels(x, shares, box))

    @property
    def n_parameters(self) -> int:
        """Number of fitted parameters: 1, the bandwidth."""
        return 1

    def content(self) -> dict[str, Any]:
        """Return the parameters of the law, for JSON."""
        normals = self.normals
        own = {"covariance": normals.covariance[0].tolist(), "centres": normals.mean.tolist()}
        return own | {"shares": self.shares.tolist()}

    @classmethod
    def from_content(cls, content: Mapping[str, Any], box: Box, records: pd.DataFrame | None = None) -> Self:
        """Build a law from the value that `content` returned, and from its box."""
        covariance = symmetric(content["covariance"])
        return cls(
            shares_of_one(content["shares"]), _kernels(numbers_in(content["centres"]), covariance, box)
        )


def _kernels(x: Array, covariance: Array, box: Box) -> Normals:
    return Normals(x, np.broadcast_to(covariance, (len(x), *covariance.shape)), box)


def _best_kernels(x: Array, shares: Array, box: Box) -> Normals:
    """Return the kernels with the largest leave-one-out likelihood."""
    n, d = x.shape
    covariance = np.atleast_2d(np.cov(x.T, aweights=shares))
    _, same = np.unique(x, axis=0, return_inverse=True)
    repeated = same[:, None] == same
    best, likelihood = None, -np.inf
    for factor in FACTORS:
        kernels = _kernels(x, (factor * n ** (-1 / (d + 4))) ** 2 * covariance, box)
        logs = kernels.log_densities(x) + (np.log(shares) - np.log(kernels.masses))[:, None]
        left = np.maximum(1 - np.where(repeated, shares, 0.0).sum(axis=1), np.finfo(float).tiny)
        values = logsumexp(np.where(repeated, -np.inf, logs), axis=0) - np.log(left)
        if (total := float(shares @ values)) > likelihood:
            best, likelihood = kernels, total
    return best
