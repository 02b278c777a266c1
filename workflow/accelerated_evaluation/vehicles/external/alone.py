"""Compare the outcomes of a user's vehicle with those of a new copy that simulates one encounter at a time.

Some vehicles keep a state between calls, or compute an encounter from the others in its batch. As long as the
state and the batches are the same, repeated simulations have the same outcomes, and the fault is not noticed.
A new copy has another state, and simulates batches of one encounter.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.protocol import Event, Scenario
from accelerated_evaluation.vehicles.events import CRASH
from accelerated_evaluation.vehicles.external.checked import CheckedVehicle
from accelerated_evaluation.vehicles.loading import load_vehicle

COMPARED = 4  # number of crashes, and number of other encounters, that the new copy simulates


def difference_when_alone(
    vehicle: Mapping[str, Any],
    encounters: Array,
    crashed: NDArray[np.bool_],
    scenario: Scenario = CUT_IN,
    event: Event = CRASH,
) -> str | None:
    """Return a description of the first outcome that a new copy of a vehicle does not reproduce.

    The new copy simulates at most four crashes and four other encounters, one at a time. The latest
    encounters are compared first, because a state of the vehicle has changed most by then.

    Parameters
    ----------
    vehicle
        Section ``vehicle`` of the configuration.
    encounters
        The encounters in the order in which they were simulated, shape (d, n).
    crashed
        Whether the event happened in each encounter, shape (n,).
    scenario
        The scenario of the encounters.
    event
        The event that is compared, a crash by default.

    Returns
    -------
    str or None
        The description; None if all outcomes are reproduced, if the vehicle is built in, or if it is stated
        to be random.
    """
    copy = load_vehicle(vehicle["name"], scenario, **vehicle["parameters"])
    if not isinstance(copy, CheckedVehicle) or False in (copy.deterministic, vehicle.get("deterministic")):
        return None
    copy.was_repeated = True  # because this comparison repeats encounters
    chosen = [row for kind in (crashed, ~crashed) for row in np.flatnonzero(kind)[: -COMPARED - 1 : -1]]
    for row in chosen:
        again = bool(event.happens(copy.simulate(*encounters[:, [row]]))[0])
        if again != crashed[row]:
            named = scenario.event_in_words(event)
            words = f"no {named}", named
            first, second = words[int(crashed[row])], words[int(again)]
            where = f"vehicle {copy.name}, {scenario.described(encounters[:, row])}"
            return (
                f"{where}: seen {first} in the estimate, and "
                f"{second} in a new copy of the vehicle that simulated this encounter alone; expected the "
                "same outcome in every call and in every batch. The estimate cannot be trusted. Keep no "
                "state between calls, and let no encounter depend on the others in its batch. If outcomes "
                "of the vehicle are random, set vehicle.deterministic to false."
            )
    return None
