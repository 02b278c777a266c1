"""Laws given that a condition holds for the encounter."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws import Box, Law
from accelerated_evaluation.laws.draws import DrawnLaws, OneLaw

POINTS = 20_000  # number of points with which the probability of a part of the encounters is estimated
Holds = Callable[[Array], NDArray[np.bool_]]
"""Returns whether each of n encounters, shape (n, d), belongs to the part, shape (n,)."""


@dataclass(frozen=True)
class Restricted:
    """A law given that a condition holds, for crude Monte Carlo; it has no map from normal scores."""

    law: Law
    holds: Holds
    share: float  # estimated probability of the condition

    @classmethod
    def of(cls, law: Law, holds: Holds, generator: np.random.Generator) -> Self:
        """Return the restricted law, with an estimate of the probability of the condition."""
        return cls(law, holds, float(holds(law.draw(POINTS, generator)).mean()))

    @property
    def box(self) -> Box:
        """The limits of the law."""
        return self.law.box

    def log_density(self, x: Array) -> Array:
        """Return the log density at points x, shape (n, d), or -inf at points that are not in the part."""
        return np.where(self.holds(x), self.law.log_density(x) - np.log(self.share), -np.inf)

    def draw(self, n: int, generator: np.random.Generator) -> Array:
        """Draw n points by rejection, shape (n, d)."""
        kept = np.empty((0, self.law.dimension))
        while len(kept) < n:
            x = self.law.draw(n, generator)
            kept = np.concatenate([kept, x[self.holds(x)]])
        return kept[:n]


@dataclass(frozen=True, repr=False)
class RestrictedDraw(OneLaw):
    """A restricted law as one draw, which is only drawn from and weighted by its density."""

    proposal: Restricted


def restricted(draws: DrawnLaws, holds: Holds, generator: np.random.Generator) -> DrawnLaws:
    """Return draws of joint laws given that a condition holds."""
    parts = [
        RestrictedDraw(Restricted.of(law, holds, generator), name)
        for law, name in zip(draws.laws, draws.names, strict=True)
    ]
    return replace(draws, parts=parts)
