"""Compare the outcomes of a user's vehicle with those of a new copy that simulates one encounter at a time.

A vehicle that keeps a state between calls, or in which an encounter depends on the others in its batch,
repeats itself while the state and the batches are the same. A new copy has another state, and batches of one.
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

COMPARED = 4  # crashes, and as many other encounters, that the new copy simulates


def difference_when_alone(
    vehicle: Mapping[str, Any],
    encounters: Array,
    crashed: NDArray[np.bool_],
    scenario: Scenario = CUT_IN,
    event: Event = CRASH,
) -> str | None:
    """Return a description of the first outcome that a new copy of a vehicle does not reproduce.

    The new copy simulates at most four crashes and four other encounters, one at a time and the latest first,
    because a state has changed most by then.

    Parameters
    ----------
    vehicle
        Section ``vehicle`` of the configuration.
    encounters
        The encounters in the order in which they were simulated, shape (d, n).
    crashed
        Whether each ended in the event, shape (n,).
    scenario
        The scenario of the encounters.
    event
        The event that is compared, a crash by default.

    Returns
    -------
    str or None
        None if all are reproduced, for a vehicle of this project, and for one that is stated to be random.
    """
    copy = load_vehicle(vehicle["name"], scenario, **vehicle["parameters"])
    if not isinstance(copy, CheckedVehicle) or False in (copy.deterministic, vehicle.get("deterministic")):
        return None
    copy.was_repeated = True  # by this comparison
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
                "state between calls, and let no encounter depend on the others in its batch; if chance is a "
                "part of the vehicle, say so with vehicle.deterministic: false."
            )
    return None
