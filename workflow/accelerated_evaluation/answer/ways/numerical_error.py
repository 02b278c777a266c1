"""How much the steps of a simulation change the crash probability of a vehicle.

Crashes and near crashes are drawn from a law, and the vehicle is simulated in the same encounters with other
steps. The ratio of the numbers of crashes is that of the crash probabilities under this law.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd

from accelerated_evaluation.crash_map.lines import CrashLines, crash_places
from accelerated_evaluation.laws.smooth.mean import MeanLaw
from accelerated_evaluation.vehicles.protocol import Vehicle

SIZE = 100_000  # number of encounters
SLOWER = 0.7  # crashes are sought from this share of the smallest closing speed of a crash on
# Steps of the motion and of the decisions of the controller [s], by name.
STEPS = {
    "motion every 0.02 s, decisions every 0.1 s": (0.02, 0.1),
    "motion and decisions every 0.02 s": (0.02, 0.02),
}
COLUMNS = ["vehicle", "steps", "ratio", "standard_error", "crashes", "more", "fewer"]


def numerical_errors(
    vehicles: Mapping[str, Vehicle], lines: CrashLines, law: MeanLaw, generator: np.random.Generator
) -> pd.DataFrame:
    """Tabulate crash probabilities with other steps, as ratios to those with the vehicle's own steps.

    Parameters
    ----------
    vehicles
        Vehicles by name. Those without a method ``at_steps``, which changes their steps, have no rows.
    lines
        Crash map of a vehicle, from which the region of crashes and near crashes is made.
    law
        Law of cut-ins from which the encounters are drawn.
    generator
        Source of randomness.

    Returns
    -------
    pandas.DataFrame
        One row for each vehicle and choice of ``steps``: ``ratio`` of the crash probabilities with its
        ``standard_error``, the number of ``crashes`` with the vehicle's own steps, and how many of the
        encounters crash only with the other steps (``more``) and only with its own (``fewer``).
    """
    refinable = {name: each for name, each in vehicles.items() if hasattr(each, "at_steps")}
    if not refinable or not lines.row.size:
        return pd.DataFrame(columns=COLUMNS)
    region = _enlarged(lines)
    masses = region.masses(law)[0]
    x = crash_places(region, masses, law.typical, SIZE, generator)
    rows = []
    for name, vehicle in refinable.items():
        own = vehicle.simulate(*x).crash
        for steps, (time_step, decision_step) in STEPS.items():
            other = vehicle.at_steps(time_step, decision_step).simulate(*x).crash
            ratio = other.sum() / own.sum() if own.any() else np.nan
            error = np.sqrt(np.sum((other - ratio * own) ** 2)) / own.sum() if own.any() else np.nan
            counts = int(own.sum()), int((other & ~own).sum()), int((own & ~other).sum())
            rows.append((name, steps, ratio, error, *counts))
    return pd.DataFrame(rows, columns=COLUMNS)


def _enlarged(lines: CrashLines) -> CrashLines:
    """Return lines with one interval each, from below the slowest crash on."""
    rows, first = np.unique(lines.row, return_inverse=True)
    start = np.full(rows.size, np.inf)
    np.minimum.at(start, first, lines.start)
    return replace(lines, row=rows, start=SLOWER * start, end=np.full(rows.size, np.inf))
