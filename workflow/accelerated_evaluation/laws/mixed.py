"""Mixtures of laws of any kind, by weights."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import pandas as pd
from scipy.special import logsumexp, ndtr, ndtri

from accelerated_evaluation.base.arrays import Array, numbers_in
from accelerated_evaluation.base.files import value_digest
from accelerated_evaluation.laws import LAWS, nested_content, nested_law
from accelerated_evaluation.laws.protocol import Box, Law, log_slice_of


@LAWS.add("mixed")
@dataclass(frozen=True, eq=False)
class MixedLaws(Law):
    """The mixture of laws of the same variables.

    The first normal score chooses the law: the laws occupy adjacent intervals of it.
    """

    laws: Sequence[Law]
    weights: Array  # of the laws, positive and with sum 1
    description: str = "mixture of laws"

    @property
    def box(self) -> Box:
        """The smallest box that contains those of the laws."""
        boxes = [law.box for law in self.laws]
        lower = np.min([box.lower for box in boxes], axis=0)
        return Box(boxes[0].names, tuple(lower), tuple(np.max([box.upper for box in boxes], axis=0)))

    @property
    def uses_records(self) -> bool:
        """Whether one of the laws needs the records."""
        return any(law.uses_records for law in self.laws)

    @property
    def digest(self) -> str:
        """The digest of the mixture and of the laws, which may have values that are not in their content."""
        return value_digest([super().digest, *(law.digest for law in self.laws)])

    def from_normal_scores(self, z: Array) -> Array:
        """Map normal scores to points of the mixture, both of shape (n, d)."""
        u, x = ndtr(z[:, 0]), np.empty(z.shape)
        before = np.cumsum(self.weights) - self.weights
        chosen = np.searchsorted(before, u, side="right") - 1
        for k, (law, weight) in enumerate(zip(self.laws, self.weights, strict=True)):
            own = z[chosen == k].copy()
            own[:, 0] = ndtri((u[chosen == k] - before[k]) / weight)
            x[chosen == k] = law.from_normal_scores(own)
        return x

    def log_density(self, x: Array) -> Array:
        """Return the log density of the mixture at points x, shape (n, d)."""
        parts = [law.log_density(x) for law in self.laws]
        return logsumexp(np.log(self.weights)[:, None] + parts, axis=0)

    def log_slice(self, k: int, x: Array, low: Array, high: Array) -> Array:
        """Return the log of the integral of the density over variable k; see `SlicedLaw`."""
        parts = [log_slice_of(law, k, x, low, high) for law in self.laws]
        return logsumexp(np.log(self.weights)[:, None] + parts, axis=0)

    def with_cap_at(self, closing_speed_max: float) -> Self:
        """Return the mixture of the laws with another cap on the closing speed [m/s]."""
        return replace(self, laws=[each.with_cap_at(closing_speed_max) for each in self.laws])

    def content(self) -> dict[str, Any]:
        """Return the weights and the content of the laws."""
        return {"weights": list(map(float, self.weights)), "laws": [nested_content(law) for law in self.laws]}

    @classmethod
    def from_content(cls, content: Mapping[str, Any], box: Box, records: pd.DataFrame | None) -> Self:
        """Build the mixture from its content, its limits, and the records."""
        laws = [nested_law(part, records) for part in content["laws"]]
        return cls(laws, numbers_in(content["weights"]), content["description"])
