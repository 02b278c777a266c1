"""What the vehicles have in common that are neither of this project nor a Python class: commands and FMUs."""

from abc import ABC, abstractmethod
from pathlib import Path

from numpy.typing import ArrayLike

from accelerated_evaluation.vehicles.protocol import Outcomes

TIME_LIMIT = 600.0  # [s]


class ForeignVehicle(ABC):
    """A vehicle that is a program of somebody else's; its outcomes are checked, and kept in a store.

    Attributes
    ----------
    time_limit
        How long a batch may take [s].
    """

    time_limit: float = TIME_LIMIT

    @property
    @abstractmethod
    def name(self) -> str:
        """What it is called in messages."""

    @property
    @abstractmethod
    def files(self) -> list[Path]:
        """The files that it is made of; with other contents they are another vehicle."""

    @abstractmethod
    def simulate(self, lead_speed: ArrayLike, range_: ArrayLike, closing_speed: ArrayLike) -> Outcomes:
        """Simulate n cut-ins; see `Vehicle`."""
