"""Events of an encounter: the crash, its impact speed, and near misses."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.vehicles.protocol import Outcomes


@dataclass(frozen=True, order=True)
class Event:
    """What may happen in an encounter.

    Attributes
    ----------
    quantity
        ``crash``; or ``min_range`` [m] or ``min_ttc`` [s], which happen at or below the threshold; or
        ``impact_speed`` [m/s], which happens above it.
    threshold
        In the unit of the quantity; a crash has none.
    """

    quantity: str
    threshold: float = 0.0

    @property
    def in_words(self) -> str:
        """The event for a message, such as ``min_range at most 1``."""
        if self.quantity == "crash":
            return self.quantity
        return (
            f"{self.quantity} {'above' if self.quantity == 'impact_speed' else 'at most'} {self.threshold:g}"
        )

    def happens(self, outcomes: Outcomes) -> NDArray[np.bool_]:
        """Whether the event happened in each simulated encounter."""
        if self.quantity == "crash":
            return outcomes.crash
        values = getattr(outcomes, self.quantity)
        return values > self.threshold if self.quantity == "impact_speed" else values <= self.threshold

    def score(self, outcomes: Outcomes) -> Array:
        """Graded outcome, shape (n,), that falls as the event comes nearer: the smaller, the more dangerous.

        The smallest time to collision [s], or the smallest range [m] where the event is one of the range;
        crashes before an event of the impact speed are ordered by that speed [m/s], below all others.
        """
        if self.quantity == "min_range":
            return outcomes.min_range
        if self.quantity == "impact_speed":
            return np.where(outcomes.crash, -outcomes.impact_speed, outcomes.min_ttc)
        return outcomes.min_ttc


CRASH = Event("crash")


def events_from(thresholds: Mapping[str, list[float]]) -> list[Event]:
    """Return the events of a mapping from quantities to thresholds, crashes first."""
    return [CRASH, *(Event(name, float(value)) for name, values in thresholds.items() for value in values)]
