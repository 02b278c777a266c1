"""Which encounters the crashes come from: their shares by the size of one variable.

The authors' car creeps behind a target that hardly moves, and rounding decides whether it touches the target.
A law fitted to speeds near 0 has such encounters, so that a part of its crash probability is an artefact. The
table of this module says how large that part is.
"""

import numpy as np
import pandas as pd

from accelerated_evaluation.laws.joint.protocol import JointLaw
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.protocol import Vehicle

COLUMNS = (
    "variable",
    "at_least",
    "below",
    "encounters",
    "crashes",
    "crash_probability",
    "impact_speed",
    "probability_above",
    "standard_error",
)


def crash_shares(
    scenario: Scenario,
    law: JointLaw,
    vehicle: Vehicle,
    generator: np.random.Generator,
    *,
    simulations: int = 200_000,
) -> pd.DataFrame:
    """Divide encounters and crashes by the size of a variable, by crude Monte Carlo.

    The scenario names the variable and the values between the intervals; a size is an absolute value.

    Parameters
    ----------
    scenario, law, vehicle
        The scenario, whose outcomes have an impact speed, a law of its encounters, and a fast vehicle.
    generator
        Source of randomness.
    simulations
        Number of encounters that are drawn and simulated.

    Returns
    -------
    pandas.DataFrame
        A row for each interval, none if the scenario names no variable: ``variable``, ``at_least`` and
        ``below`` (the last is infinite), ``encounters`` and ``crashes`` (shares of all encounters and of all
        crashes), ``crash_probability`` within the interval, ``impact_speed`` [m/s], the median of its
        crashes, and ``probability_above``, the crash probability of the encounters at or above ``at_least``,
        with its ``standard_error``.
    """
    if scenario.divided_by is None:
        return pd.DataFrame(columns=list(COLUMNS))
    variable, edges = scenario.divided_by
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
        error = np.sqrt(above * (1 - above) / drawn_above)
        shares = (drawn / drawn.sum(), crashed / crashed.sum(), crashed / drawn)
    speeds = impact.reindex(range(len(drawn))).to_numpy(float)
    columns = (variable, limits[:-1], limits[1:], *shares, speeds, above, error)
    return pd.DataFrame(dict(zip(COLUMNS, columns, strict=True)))
