"""Kernel law: a truncated normal distribution about each record, all with one covariance matrix.

The covariance matrix is that of the records times the square of a bandwidth. The bandwidth is the one with
the largest leave-one-out likelihood. Records that repeat the record that is left out are left out too,
because a repeated row would otherwise ask for a bandwidth of zero.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from scipy.special import logsumexp

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.joint import JOINT_LAWS
from accelerated_evaluation.laws.joint.protocol import Box, normalised
from accelerated_evaluation.laws.joint.truncated import Normals
from accelerated_evaluation.laws.joint.truncated_normals import TruncatedNormalMixture

FACTORS = (0.3, 0.4, 0.5, 0.6, 0.75, 0.9, 1.1, 1.4)  # of the bandwidth of Scott, n^(-1 / (d + 4))


@JOINT_LAWS.add("kernel")
@dataclass(frozen=True, eq=False)
class KernelLaw(TruncatedNormalMixture):
    """A truncated normal distribution about each record."""

    kind: ClassVar[str] = "kernel"

    @classmethod
    def fit(
        cls,
        x: Array,
        box: Box,
        generator: np.random.Generator,
        *,
        weights: Array | None = None,
        start: Self | None = None,
    ) -> Self:
        """Choose the bandwidth, unless ``start`` has one for the same records; see `JointLaw.fit`."""
        box.require(x, "the records")
        shares = normalised(weights, len(x)) / len(x)
        if start is not None and np.array_equal(start.normals.mean, x):
            return replace(start, shares=shares)
        if start is not None:
            return cls(shares, _kernels(x, start.normals.covariance[0], box))
        return cls(shares, _best_kernels(x, shares, box))

    @property
    def n_parameters(self) -> int:
        """The bandwidth is the only fitted parameter."""
        return 1

    def content(self) -> dict[str, Any]:
        """Return the parameters for JSON."""
        normals = self.normals
        own = {"covariance": normals.covariance[0].tolist(), "centres": normals.mean.tolist()}
        return own | {"shares": self.shares.tolist()}

    @classmethod
    def from_content(cls, content: Mapping[str, Any], box: Box) -> Self:
        """Build the law that `content` described."""
        names = ("shares", "centres", "covariance")
        shares, centres, covariance = (np.array(content[name], float) for name in names)
        return cls(shares, _kernels(centres, covariance, box))


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
