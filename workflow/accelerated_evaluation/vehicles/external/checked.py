"""A user's vehicle, with checks of its outcomes and messages for its exceptions."""

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.users_code import running
from accelerated_evaluation.scenarios.outcomes import have_failed
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.moving import checked_lead_speeds, require_motion, takes_motion
from accelerated_evaluation.vehicles.protocol import (
    OUTCOMES_GUIDE,
    Vehicle,
    checked_outcomes,
    outcome_error,
    repeats_itself,
)

BATCH_TIME_LIMIT = 600.0  # [s], default of the longest time for a batch
REPEATED = 4  # number of encounters of the first batch that are simulated again, each twice
TOLERANCE = 1e-5  # tolerance for repeated outcomes of an encounter, because rounding may depend on the batch


class ForeignVehicle(ABC):
    """Base class of a vehicle that is an external program; its outcomes are checked and stored."""

    time_limit: float = BATCH_TIME_LIMIT  # longest time for a batch [s]
    scenario: Scenario  # whose encounters are simulated; `load_vehicle` sets it
    stays: bool = False  # whether a program goes on running between the batches

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

    def longest(self, encounters: int) -> float:
        """Return the longest time for a batch of so many encounters [s]."""
        return self.time_limit


@dataclass
class CheckedVehicle:
    """A user's vehicle whose inputs and outcomes are checked against the interface of a vehicle.

    Unless the vehicle is known to be random, at most four encounters of the first batch are simulated again,
    each twice, in another order and in a batch of another size; and so are those of the next batch that is
    more than ten times as large. Each repetition takes at most eight simulations. The repetition detects a
    vehicle whose outcomes usually differ. If outcomes differ in only one run out of a hundred, the many
    repeats of the sampler are needed to detect this.
    """

    vehicle: Vehicle
    name: str  # in messages, such as ``path/to/file.py:ClassName``
    scenario: Scenario = field(repr=False)
    # As stated by the user or by the attribute of the user's class; None means unknown, to be tested. It
    # becomes False if a repetition has other outcomes.
    deterministic: bool | None = field(default=None, repr=False, compare=False)
    # Whether encounters were simulated again; it is set to True if the repetition is done elsewhere.
    was_repeated: bool = field(default=False, init=False, repr=False, compare=False)
    _repeated_in: int = field(default=0, init=False, repr=False, compare=False)  # size of the batch
    elsewhere: Callable[[Array], Any] | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.deterministic is None:
            self.deterministic = repeats_itself(self.vehicle)
        if not isinstance(self.deterministic, bool | None):
            seen, expected = repr(self.deterministic), "True, False or None"
            raise outcome_error(self.name, "its attribute deterministic", seen, expected)

    def simulate(self, *columns: ArrayLike) -> Any:  # noqa: ANN401
        """Return the checked outcomes of n encounters, given by the variables of the scenario, (n,) each.

        InputError is raised if the encounters are not valid, if the user's code raises an error or exits, if
        the outcomes are not valid, or if repeated encounters have other outcomes although the vehicle is
        stated to be deterministic.
        """
        encounters = self.scenario.checked(*columns)
        outcomes = self._outcomes(encounters)
        size = encounters.shape[1]
        if size > 0 and (not self.was_repeated or 0 < 10 * self._repeated_in < size):
            self.was_repeated, self._repeated_in = True, size
            own = encounters, outcomes, self.name, self.scenario
            self.deterministic = after_repetition(self._outcomes, *own, declared=self.deterministic)
        return outcomes

    def repeat(self, *columns: ArrayLike) -> Any:  # noqa: ANN401
        """Return the outcomes of n encounters from another process, or from this one if there is no other.

        The arguments and errors are those of `simulate`.
        """
        encounters = self.scenario.checked(*columns)
        return self._outcomes(encounters) if self.elsewhere is None else self.elsewhere(encounters)

    @property
    def takes_motion(self) -> bool:
        """Whether the vehicle can be simulated with given lead speeds over time."""
        return takes_motion(self.vehicle)

    def simulate_moving(
        self, lead_speed: ArrayLike, range_: ArrayLike, closing_speed: ArrayLike, lead_speeds: ArrayLike
    ) -> Any:  # noqa: ANN401
        """Return the checked outcomes of n cut-ins with lead speeds at 0, 0.1, ... s, (n, at least 81).

        InputError is raised as in `simulate`; also if the vehicle cannot be simulated with lead speeds over
        time, or if these are negative, not finite, or end before 8 s.
        """
        require_motion(self.vehicle, self.name)
        encounters = self.scenario.checked(lead_speed, range_, closing_speed)
        return self._outcomes(encounters, checked_lead_speeds(lead_speeds, encounters[0]))

    def _outcomes(self, encounters: Array, lead_speeds: Array | None = None) -> Any:  # noqa: ANN401
        """Return the checked outcomes of the user's vehicle for valid encounters, shape (d, n)."""
        with running(f"vehicle {self.name}, simulate", "outcomes", f"Correct the vehicle. {OUTCOMES_GUIDE}"):
            if lead_speeds is None:
                outcomes = self.vehicle.simulate(*encounters.copy())
            else:
                outcomes = self.vehicle.simulate_moving(*encounters.copy(), lead_speeds.copy())
        return checked_outcomes(outcomes, encounters, vehicle=self.name, scenario=self.scenario)


def after_repetition(
    simulate: Callable[[Array], Any],
    encounters: Array,
    first: Any,  # noqa: ANN401
    vehicle: str,
    scenario: Scenario,
    *,
    declared: bool | None,
) -> bool | None:
    """Simulate some encounters again, and return whether the vehicle is deterministic, or None if unknown.

    At most four encounters are simulated again, each twice. They are spread over the batch. The new batch
    contains them in order and then in reverse order, so that the number of earlier calls, the size of the
    batch, the neighbours and the position in the batch are different.

    Nothing is simulated if ``declared``, the user's statement, is False. If it is None and an outcome
    differs, a warning names the outcome. If it is True, InputError is raised.
    """
    if declared is False:
        return False
    count = encounters.shape[1]
    chosen = np.unique(np.linspace(0, count - 1, min(count, REPEATED)).astype(int))
    rows = np.concatenate([chosen, chosen[::-1]])
    difference = difference_in(simulate(encounters[:, rows]), rows, encounters, first, vehicle, scenario)
    if difference is not None and declared:
        raise difference
    if difference is not None:
        warnings.warn(f"{difference} The vehicle is treated as one with random outcomes.", stacklevel=3)
        return False
    return declared


def difference_in(
    again: Any,  # noqa: ANN401
    rows: NDArray[np.intp],
    encounters: Array,
    first: Any,  # noqa: ANN401
    vehicle: str,
    scenario: Scenario,
) -> InputError | None:
    """Return the error for the first outcome of ``again`` that differs from that of its row in ``first``.

    Runs that have failed are not compared.
    """
    known = ~(have_failed(first)[rows] | have_failed(again))
    for name in scenario.outcome_names:
        before, after = getattr(first, name)[rows] * 1.0, getattr(again, name) * 1.0
        differs = known & ~np.isclose(after, before, rtol=TOLERANCE, atol=TOLERANCE, equal_nan=True)
        if differs.any():
            row = int(np.argmax(differs))
            return outcome_error(
                vehicle,
                f"{name} of {scenario.described(encounters[:, rows[row]])}",
                f"{before[row]:g} at first, and {after[row]:g} when simulated again in another batch",
                "the same outcomes of an encounter in every call, in every batch and in every process",
                change="If the outcomes of this vehicle are random, set vehicle.deterministic to false. "
                "Otherwise seed its random numbers in each call, keep no state between calls, and let "
                "no encounter depend on the others in its batch.",
            )
    return None
