"""Common base of vehicles that are external programs: commands and FMUs."""

from abc import ABC, abstractmethod
from pathlib import Path

from numpy.typing import ArrayLike

from accelerated_evaluation.vehicles.protocol import Outcomes

TIME_LIMIT = 600.0  # [s]


class ForeignVehicle(ABC):
    """A vehicle that is an external program; its outcomes are checked and stored.

    Attributes
    ----------
    time_limit
        Longest time for a batch [s].
    """

    time_limit: float = TIME_LIMIT

    @property
    @abstractmethod
    def name(self) -> str:
        """Its name in messages."""

    @property
    @abstractmethod
    def files(self) -> list[Path]:
        """The files that define it; if their contents change, it counts as another vehicle."""

    @abstractmethod
    def simulate(self, lead_speed: ArrayLike, range_: ArrayLike, closing_speed: ArrayLike) -> Outcomes:
        """Simulate n cut-ins; see `Vehicle`."""
