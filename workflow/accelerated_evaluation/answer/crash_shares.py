"""Which encounters the crashes come from: their shares by the size of one variable.

The authors' car creeps behind a target that hardly moves, and rounding decides whether it touches the target.
A law fitted to speeds near 0 has such encounters, so that a part of its crash probability is an artefact. The
table of this module says how large that part is.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from accelerated_evaluation.laws.joint.protocol import JointLaw
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.protocol import Vehicle


def crash_shares(
    scenario: Scenario,
    law: JointLaw,
    vehicle: Vehicle,
    variable: str,
    edges: Sequence[float],
    generator: np.random.Generator,
    *,
    simulations: int = 200_000,
) -> pd.DataFrame:
    """Divide encounters and crashes by the absolute value of a variable, by crude Monte Carlo.

    Parameters
    ----------
    scenario, law, vehicle
        The scenario, whose outcomes have an impact speed, a law of its encounters, and a fast vehicle.
    variable, edges
        The variable, and the values that separate the intervals, in ascending order.
    generator
        Source of randomness.
    simulations
        Number of encounters that are drawn and simulated.

    Returns
    -------
    pandas.DataFrame
        A row for each interval: ``at_least`` and ``below`` (the last is infinite), ``encounters`` and
        ``crashes`` (shares of all encounters and of all crashes), ``crash_probability`` within the interval,
        ``impact_speed`` [m/s], the median of its crashes, and ``probability_above``, the crash probability of
        the encounters at or above ``at_least``, with its ``standard_error``.
    """
    x = law.sample(simulations, generator)
    outcomes = vehicle.simulate(*scenario.to_inputs(x).T)
    crash = outcomes.crash
    size = np.abs(x[:, scenario.names.index(variable)])
    limits = np.array([0.0, *edges, np.inf])
    groups = np.digitize(size, limits[1:-1])
    drawn = np.bincount(groups, minlength=len(limits) - 1)
    crashed = np.bincount(groups, crash, minlength=len(limits) - 1)
    drawn_above, crashed_above = (np.cumsum(counts[::-1])[::-1] for counts in (drawn, crashed))
    impact = pd.Series(outcomes.impact_speed[crash]).groupby(groups[crash]).median()
    with np.errstate(divide="ignore", invalid="ignore"):  # intervals without an encounter or a crash
        above = crashed_above / drawn_above
        return pd.DataFrame(
            {
                "at_least": limits[:-1],
                "below": limits[1:],
                "encounters": drawn / drawn.sum(),
                "crashes": crashed / crashed.sum(),
                "crash_probability": crashed / drawn,
                "impact_speed": impact.reindex(range(len(drawn))).to_numpy(float),
                "probability_above": above,
                "standard_error": np.sqrt(above * (1 - above) / drawn_above),
            }
        )
