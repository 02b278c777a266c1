"""The crash probability with all that is not known of it: which law, and what the finite records leave open."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.fitting.family import Family, Member
from accelerated_evaluation.truth.lines import Lines

LEVELS = (0.5, 0.8, 0.95)


@dataclass(frozen=True)
class Posterior:
    """Draws of the probability of an event, and the law that each was drawn from.

    Attributes
    ----------
    probabilities
        Shape (draws,).
    member
        Place of the law among the members, shape (draws,).
    """

    probabilities: Array
    member: NDArray[np.int_]

    @property
    def probability(self) -> float:
        """The answer: the median of the draws."""
        return float(np.median(self.probabilities))

    def interval(self, level: float) -> tuple[float, float]:
        """Return the interval between the quantiles that leave equal parts outside."""
        low, high = np.quantile(self.probabilities, [(1 - level) / 2, (1 + level) / 2])
        return float(low), float(high)


def draw_posterior(
    lines: Lines,
    family: Family,
    members: tuple[Member, ...],
    weights: Array,
    generator: np.random.Generator,
) -> Posterior:
    """Draw a law by its weights, then its parameters, those of its body and those of the range; weigh the map.

    Parameters
    ----------
    lines
        Of the vehicle's map, thinned.
    family
        Fit to all events.
    members
        Laws that are weighed.
    weights
        Shape (draws, members), rows adding up to 1.
    generator
        Draws everything.
    """
    ends = np.cumsum(weights, axis=1)
    chosen = np.minimum((generator.random((len(weights), 1)) > ends).sum(axis=1), len(members) - 1)
    probabilities = np.array(
        [
            lines.probability(family.ranges.drawn(generator), family.law(members[place]).drawn(generator))
            for place in chosen
        ]
    )
    return Posterior(probabilities, chosen)
