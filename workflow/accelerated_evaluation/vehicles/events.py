"""Events of an encounter: the crash, its impact speed, and near misses."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.vehicles.protocol import Outcomes


@dataclass(frozen=True, order=True)
class Event:
    """An event in an encounter: a crash, an impact above a speed, or a near miss.

    Attributes
    ----------
    quantity
        ``crash``; or ``min_range`` [m] or ``min_ttc`` [s], for values at or below the threshold; or
        ``impact_speed`` [m/s], for values above it.
    threshold
        Threshold in the unit of the quantity; a crash has none.
    """

    quantity: str
    threshold: float = 0.0

    @property
    def in_words(self) -> str:
        """Return the event as text for a message, such as ``min_range at most 1``."""
        if self.quantity == "crash":
            return self.quantity
        return (
            f"{self.quantity} {'above' if self.quantity == 'impact_speed' else 'at most'} {self.threshold:g}"
        )

    def happens(self, outcomes: Outcomes) -> NDArray[np.bool_]:
        """Return whether the event happened in each simulated encounter."""
        if self.quantity == "crash":
            return outcomes.crash
        values = getattr(outcomes, self.quantity)
        return values > self.threshold if self.quantity == "impact_speed" else values <= self.threshold

    def score(self, outcomes: Outcomes) -> Array:
        """Return a score, shape (n,), that becomes smaller the closer an encounter came to the event.

        The score is the smallest time to collision [s], or the smallest range [m] if the event refers to the
        range. If the event is an impact above a speed, crashes get smaller scores than all other encounters,
        ordered by their impact speed [m/s].
        """
        if self.quantity == "min_range":
            return outcomes.min_range
        if self.quantity == "impact_speed":
            return np.where(outcomes.crash, -outcomes.impact_speed, outcomes.min_ttc)
        return outcomes.min_ttc


CRASH = Event("crash")


def event_named(text: str) -> Event:
    """Return the event that the option ``--event`` names: ``crash``, or a quantity and a threshold.

    Raises
    ------
    InputError
        If there is no such event.
    """
    quantity, _, threshold = text.partition("=")
    try:
        value = float(threshold or "nan")
    except ValueError:
        value = math.nan
    if text == CRASH.quantity:
        return CRASH
    if quantity in ("impact_speed", "min_range", "min_ttc") and math.isfinite(value) and value >= 0:
        return Event(quantity, value)
    expected = "crash, or impact_speed, min_range or min_ttc with a threshold, such as min_range=1"
    raise InputError("--event", seen=repr(text), expected=expected, change="Correct it.")


def events_from(thresholds: Mapping[str, list[float]]) -> list[Event]:
    """Return the events given by thresholds of quantities, crashes first."""
    return [CRASH, *(Event(name, float(value)) for name, values in thresholds.items() for value in values)]
