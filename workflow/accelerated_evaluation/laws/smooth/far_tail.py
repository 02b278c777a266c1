"""The far tail: factors of the hazard beyond the levels that only a few records reach.

A finite number of records cannot show whether a tail stays straight beyond them. The hazard of every law is
therefore multiplied by unknown factors where records are few. Let Lambda = -log P(C > c | v_L, R) be the
cumulative hazard of a law. Under the law it has a unit exponential distribution, so that m of N records are
expected beyond the level log(N / m). Between the levels of m = 100, 10 and 1 records, and beyond the last,
the hazard of the law is multiplied by one factor each.

The factors are independent, with a gamma prior of mean 1. Let d records end in a layer between two levels,
and let e be the sum of the parts of their Lambda that lie in the layer. Their likelihood is f^d exp(-f e),
so the posterior of the factor f, given the law, is a gamma distribution, too. Where there are many records,
they determine the factor. Beyond all records, the factor has its prior distribution, and the interval of the
answer opens.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from accelerated_evaluation.base.arrays import Array

RECORDS = np.array([100, 10, 1])  # numbers of records that are expected beyond the levels
# Shape and rate of the gamma prior of a factor. With probability 80 % a factor is between 0.27 and 1.94. For
# comparison: from 3 to 9 scales above the threshold, the hazard of a generalised Pareto law of shape 0.3
# changes by a factor of 0.5, and that of a law of shape -0.1, which ends after 10 scales, by a factor of 7.
PRIOR = 2.0


@dataclass(frozen=True)
class FarTail:
    """Factors of the hazard in layers of the cumulative hazard; there is no factor below the first level."""

    levels: Array  # cumulative hazards at which the layers begin, rising, (layers,)
    # Factor in each layer, (layers,), or (layers, K, 1) for K draws; after a fit, the means of the posterior.
    factors: Array
    shapes: Array | None = None  # shape parameters of the gamma posterior of the factors; None if unknown

    @classmethod
    def of(cls, cumulative: Array, size: int, lowest: float, prior: float = PRIOR) -> Self:
        """Return the posterior of the factors, given the cumulative hazards of the records.

        These are the records, out of ``size``, that exceed ``lowest``, below which no layer begins. ``prior``
        is both the shape and the rate of the gamma prior.
        """
        levels = levels_of(size, lowest)
        inside = np.clip(cumulative - levels[:, None], 0, np.diff(levels, append=np.inf)[:, None])
        ended = np.diff((cumulative > levels[:, None]).sum(axis=1), append=0)
        shapes = prior - ended
        return cls(levels, shapes / (prior + inside.sum(axis=1)), shapes)

    @classmethod
    def stacked(cls, tails: Sequence[Self]) -> Self:
        """Return the far tails of K draws of a law, which have the same levels, as one object."""
        return cls(tails[0].levels, np.array([tail.factors for tail in tails]).T[:, :, None])

    def drawn(self, generator: np.random.Generator) -> Self:
        """Return a far tail with factors drawn from their posterior."""
        return replace(self, factors=self.factors * generator.gamma(self.shapes) / self.shapes)

    def cumulative(self, original: Array) -> Array:
        """Return the cumulative hazard with the factors, given the one without them, of the same shape."""
        value = np.minimum(original, self.levels[0])
        for level, width, factor in zip(self.levels, self._widths, self.factors, strict=True):
            value = value + factor * np.clip(original - level, 0, width)
        return value

    def original(self, cumulative: Array) -> Array:
        """Return the cumulative hazard without the factors; the inverse of `cumulative`."""
        value, rest = np.minimum(cumulative, self.levels[0]), cumulative - self.levels[0]
        for width, factor in zip(self._widths, self.factors, strict=True):
            value = value + np.clip(rest / factor, 0, width)
            rest = rest - factor * width
        return value

    def log_density_ratio(self, original: Array) -> Array:
        """Return log(density with the factors / density without them), given the original hazards."""
        log_factor = np.zeros(1)
        for level, factor in zip(self.levels, np.log(self.factors), strict=True):
            log_factor = np.where(original > level, factor, log_factor)
        with np.errstate(invalid="ignore"):  # where the hazard is infinite, the density is 0 in any case
            change = original - self.cumulative(original)
        return np.where(np.isinf(original), 0.0, log_factor + change)

    @property
    def _widths(self) -> Array:
        return np.diff(self.levels, append=np.inf)

    def content(self) -> dict[str, Any]:
        """Return the content of the law file: levels and factors."""
        return {"levels": self.levels.tolist(), "factors": self.factors.tolist()}

    @classmethod
    def from_content(cls, content: Mapping[str, Any]) -> Self:
        """Build the far tail from the value that `content` returned."""
        return cls(np.array(content["levels"]), np.array(content["factors"]))


def levels_of(size: int, lowest: float) -> Array:
    """Return the cumulative hazards beyond which `RECORDS` of so many records are expected, shape (layers,).

    A level is not below ``lowest``.
    """
    return np.maximum(np.log(size / RECORDS), lowest)
