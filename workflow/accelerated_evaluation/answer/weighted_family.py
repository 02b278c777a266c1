"""The family of laws, with weights that follow from its scores on held-out records."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.answer.posterior import Posterior, draw_posterior
from accelerated_evaluation.answer.scored_family import ScoredFamily
from accelerated_evaluation.answer.weights import bootstrapped_weights
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.laws.smooth.family import Member

DRAWS = 500  # number of draws of the weights
LINES = 2500  # number of lines of a thinned crash map
GUIDE = 0.95  # level of the thresholds whose laws, and the law without threshold, determine the lines to keep


@dataclass(frozen=True)
class WeightedLaws(ScoredFamily):
    """A scored family of laws, with draws of the weights of its members.

    Attributes
    ----------
    weights
        Draws of the weights, shape (draws, members), with rows that sum to 1.
    """

    weights: Array

    @classmethod
    def drawn(cls, scored: ScoredFamily, generator: np.random.Generator, draws: int = DRAWS) -> Self:
        """Draw the weights of the laws from their held-out scores, by the Bayesian bootstrap of the records.

        Parameters
        ----------
        scored
            The family with its held-out scores.
        generator
            Source of all randomness.
        draws
            Number of draws.
        """
        weights = bootstrapped_weights(scored.log_scores, scored.critical, draws, generator)
        return cls(scored.fitter, scored.family, scored.log_scores, scored.expected, weights)

    @property
    def heaviest(self) -> Member:
        """The law with the largest mean weight."""
        return self.members[int(np.argmax(self.weights.mean(axis=0)))]

    def mean(self, values: Mapping[Member, Array | float]) -> Array | float:
        """Return the weighted mean of a quantity over the laws.

        The weight of a law is the mean of the draws of its weight.

        Parameters
        ----------
        values
            Value of the quantity for each law.
        """
        weights = self.weights.mean(axis=0)
        return sum(weight * values[member] for weight, member in zip(weights, self.members, strict=True))

    def weights_at(self, level: float) -> Array:
        """Return draws of the weights, shape (draws, members), in which only laws with one threshold count.

        ``level`` is the level of this threshold; see `weights_of`.
        """
        return self.weights_of(np.array([member.level == level for member in self.members]))

    def weights_of(self, chosen: NDArray[np.bool_]) -> Array:
        """Return draws of the weights, shape (draws, members), in which only chosen laws have weight.

        The weights of these laws are scaled so that they sum to 1; if all of them are 0 in a draw, they
        become equal. ``chosen`` has shape (members,).
        """
        weights = np.where(chosen, self.weights, 0.0)
        weights[~weights.any(axis=1)] = chosen
        return weights / weights.sum(axis=1, keepdims=True)

    def thinned(self, lines: CrashLines, generator: np.random.Generator, size: int = LINES) -> CrashLines:
        """Select ``size`` lines of a crash map at random, by their probabilities under some of the laws.

        Parameters
        ----------
        lines
            Lines of a crash map: pairs of lead speed and range, with the intervals of closing speed in which
            the event happens.
        generator
            Source of the random choice.
        size
            Number of lines to keep.

        Returns
        -------
        CrashLines
            The selected lines, weighted to represent all lines.
        """
        guides = [member for member in self.members if member.level in (None, GUIDE)]
        shares = [mass / mass.sum() for mass in lines.masses_of(self.family, guides) if mass.any()]
        if not shares:  # the event never happens, or its probability underflows
            return lines
        return lines.thinned(np.mean(shares, axis=0), size, generator)

    def draw(
        self,
        lines: Mapping[str, CrashLines],
        generator: np.random.Generator,
        weights: Array | None = None,
        risks: Mapping[str, Array] = MappingProxyType({}),
    ) -> dict[str, Posterior]:
        """Draw the probabilities of events from their posterior.

        Parameters
        ----------
        lines
            Lines of a crash map, by event: pairs of lead speed and range, with the intervals of closing speed
            in which the event happens.
        generator
            Source of all randomness.
        weights
            Draws of the weights, shape (draws, members); by default those of this family.
        risks
            Risks, such as the risk of an injury, in each interval of the lines of some events, shape (risks,
            intervals).

        Returns
        -------
        dict
            The posterior of the probability of each event, by event.
        """
        chosen = self.weights if weights is None else weights
        return draw_posterior(lines, self.family, self.members, chosen, generator, risks)
