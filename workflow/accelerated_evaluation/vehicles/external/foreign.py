"""Common base class of vehicles that are external programs: commands and FMUs."""

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.protocol import Scenario

TIME_LIMIT = 600.0  # [s], default of the longest time for a batch


class ForeignVehicle(ABC):
    """Base class of a vehicle that is an external program; its outcomes are checked and stored."""

    time_limit: float = TIME_LIMIT  # longest time for a batch [s]
    scenario: Scenario = CUT_IN

    @property
    @abstractmethod
    def name(self) -> str:
        """Name of the vehicle in messages."""

    @property
    @abstractmethod
    def files(self) -> list[Path]:
        """Files that define the vehicle; if their contents change, stored outcomes are not used any more."""

    @abstractmethod
    def simulate(self, *columns: ArrayLike) -> Any:  # noqa: ANN401
        """Return the outcomes of n encounters, given the scenario's variables, each of shape (n,)."""
