"""The hosts that drive on the motorway, and the cut-ins that they are given.

A host takes the place of the car behind at the moment of the cut-in, and drives behind the recorded course of
the other car. The other car does not react to it, so this is the same as driving in the running world.
"""

import numpy as np
import pandas as pd
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.support import SUPPORT
from accelerated_evaluation.vehicles import load_vehicle
from accelerated_evaluation.vehicles.protocol import MovingVehicle
from traffic import NAMES

# The last host is poor on purpose: it brakes late and weakly, and has no emergency braking.
HOSTS: dict[str, tuple[str, dict[str, float]]] = {
    "acc_aeb": ("acc_aeb", {}),
    "acc_only": ("acc_only", {}),
    "human": ("human", {}),
    "cc_human": ("cc_human", {}),
    "poor": ("acc_only", {"acc_limit": 2.0, "headway": 1.0}),
}


def hosts(generator: np.random.Generator) -> dict[str, MovingVehicle]:
    """Return the hosts by name; the drivers of ``human`` are drawn with a seed from the generator."""
    seeds = {"human": {"seed": int(generator.integers(2**31))}}
    return {
        host: load_vehicle(name, **parameters, **seeds.get(name, {}))
        for host, (name, parameters) in HOSTS.items()
    }


def encounters_of(cut_ins: pd.DataFrame) -> Array:
    """Return lead speed [m/s], range [m] and closing speed [m/s], shape (3, n)."""
    return cut_ins[list(NAMES)].to_numpy(dtype=float).T


def kept(cut_ins: pd.DataFrame) -> pd.DataFrame:
    """Return the cut-ins that the filters of the study keep: the gap closes, within the limits."""
    return cut_ins[
        (cut_ins["closing_speed"] > 0)
        & (cut_ins["range"] < SUPPORT.range_max)
        & cut_ins["lead_speed"].between(*SUPPORT.lead_speeds, "left")
    ]
