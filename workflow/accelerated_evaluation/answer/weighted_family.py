"""The family of laws, weighted by its scores on held-out records."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Self

import numpy as np

from accelerated_evaluation.answer.posterior import Posterior, draw_posterior
from accelerated_evaluation.answer.scored_family import ScoredFamily, region
from accelerated_evaluation.answer.weights import bootstrapped_weights
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.laws.smooth.family import Member

DRAWS = 500
LINES = 2500  # of a thinned map
GUIDE = 0.95  # level of the thresholds whose laws, with the body alone, say which lines to keep


@dataclass(frozen=True)
class WeightedLaws(ScoredFamily):
    """A scored family with its weights.

    Attributes
    ----------
    weights
        Draws of the weights, shape (draws, members).
    """

    weights: Array

    @classmethod
    def drawn(cls, scored: ScoredFamily, generator: np.random.Generator, draws: int = DRAWS) -> Self:
        """Draw weights from the scores of a family; see `weights.bootstrapped_weights`."""
        records = scored.records
        inside = records.closing_speed > region(records) * records.range_
        weights = bootstrapped_weights(scored.log_scores, inside, draws, generator)
        return cls(scored.fitter, scored.family, scored.log_scores, weights)

    @property
    def heaviest(self) -> Member:
        """The law of the largest mean weight."""
        return self.members[int(np.argmax(self.weights.mean(axis=0)))]

    def mean(self, values: Mapping[Member, Array | float]) -> Array | float:
        """Return the mean of a quantity over the laws, with their mean weights."""
        weights = self.weights.mean(axis=0)
        return sum(weight * values[member] for weight, member in zip(weights, self.members, strict=True))

    def weights_at(self, level: float) -> Array:
        """Return the weights restricted to the laws with one threshold, with rows that sum to 1.

        They are equal if all these laws have weight zero.
        """
        chosen = np.array([member.level == level for member in self.members])
        weights = np.where(chosen, self.weights, 0.0)
        weights[~weights.any(axis=1)] = chosen
        return weights / weights.sum(axis=1, keepdims=True)

    def thinned(self, lines: CrashLines, generator: np.random.Generator, size: int = LINES) -> CrashLines:
        """Thin the lines of an event to those that are probable under some of the laws."""
        guides = [member for member in self.members if member.level in (None, GUIDE)]
        shares = [mass / mass.sum() for mass in lines.masses_of(self.family, guides) if mass.any()]
        if not shares:  # the event never happens, or so rarely that its probability is 0 to rounding
            return lines
        return lines.thinned(np.mean(shares, axis=0), size, generator)

    def draw(
        self,
        lines: Mapping[str, CrashLines],
        generator: np.random.Generator,
        weights: Array | None = None,
        risks: Mapping[str, Array] = MappingProxyType({}),
    ) -> dict[str, Posterior]:
        """Draw probabilities of events from the posterior, optionally with other ``weights`` and with risks.

        `posterior.draw_posterior` describes the risks.
        """
        chosen = self.weights if weights is None else weights
        return draw_posterior(lines, self.family, self.members, chosen, generator, risks)
