"""Common base of vehicles that are external programs: commands and FMUs."""

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.protocol import Scenario

TIME_LIMIT = 600.0  # [s]


class ForeignVehicle(ABC):
    """A vehicle that is an external program; its outcomes are checked and stored.

    Attributes
    ----------
    time_limit
        Longest time for a batch [s].
    scenario
        The scenario whose encounters it simulates.
    """

    time_limit: float = TIME_LIMIT
    scenario: Scenario = CUT_IN

    @property
    @abstractmethod
    def name(self) -> str:
        """Its name in messages."""

    @property
    @abstractmethod
    def files(self) -> list[Path]:
        """The files that define it; if their contents change, it counts as another vehicle."""

    @abstractmethod
    def simulate(self, *columns: ArrayLike) -> Any:  # noqa: ANN401
        """Simulate n encounters; see `Vehicle`."""
