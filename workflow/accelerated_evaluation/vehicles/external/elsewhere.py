"""Comparison of a vehicle with itself in another process, in another order and in batches of another size.

If a vehicle has a state, its outcomes may change from call to call; if its encounters depend on each other,
they may depend on the batch; and if its random numbers are seeded once in a process, every repetition in this
process ends in the same way. Repetition of whole batches in the same process need not notice any of them.
"""

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError, StudyError
from accelerated_evaluation.scenarios.protocol import Event, Scenario
from accelerated_evaluation.vehicles.checks import outcome_error
from accelerated_evaluation.vehicles.external.checked import CheckedVehicle, difference_in, error_in_words
from accelerated_evaluation.vehicles.external.workers import simulate_batch

COMPARED = 4  # number of runs with the event, and number of others, that are repeated one by one
TIME_LIMIT = 3600.0  # [s], longest time for the repetition of a batch of a vehicle that is not stored


@dataclass(frozen=True)
class Elsewhere:
    """A copy of a user's vehicle in another process."""

    name: str
    parameters: Mapping[str, Any]
    scenario: Scenario
    executor: Executor = field(repr=False)  # with the other process, which loads the vehicle itself

    def __call__(self, encounters: Array) -> Any:  # noqa: ANN401
        """Return the outcomes of encounters, shape (d, n), which are simulated in reverse order."""
        work = self.name, dict(self.parameters), encounters[:, ::-1], TIME_LIMIT, self.scenario.name
        try:
            outcomes = self.executor.submit(simulate_batch, *work).result()
        except StudyError:
            raise
        except Exception as error:  # executors raise various errors for a process that died
            shown = self.scenario.described_batch(encounters)
            seen = f"in another process, {error_in_words(error)}"
            raise outcome_error(self.name, shown, seen, "outcomes", "Correct the vehicle.") from error
        return self.scenario.outcomes_of(outcomes[:, ::-1])


def difference_elsewhere(vehicle: Any, encounters: Array, outcomes: Any, event: Event) -> InputError | None:  # noqa: ANN401
    """Simulate runs of an estimate again in another process, and return the error of the first difference.

    The last runs with the event and the last runs without it are repeated one by one. If the vehicle is not
    stored, because it is fast, all runs are repeated once more in one batch. The result is None without a
    difference, for outcomes that are stated to be random, and for vehicles of the project, which have no
    method ``repeat``.
    """
    if not hasattr(vehicle, "repeat") or vehicle.deterministic is False or not encounters.shape[1]:
        return None
    happened = event.happens(outcomes)
    alone = [row for kind in (happened, ~happened) for row in np.flatnonzero(kind)[: -COMPARED - 1 : -1]]
    batches = [np.array([row]) for row in alone]
    if isinstance(vehicle, CheckedVehicle):
        batches.append(np.arange(len(happened)))
    for rows in batches:
        again = vehicle.repeat(*encounters[:, rows])
        found = difference_in(again, rows, encounters, outcomes, vehicle.name, vehicle.scenario)
        if found is not None:
            return found
    return None
