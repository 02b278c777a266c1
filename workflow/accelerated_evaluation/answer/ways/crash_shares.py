"""The crash probability by the size of one variable, by crude Monte Carlo."""

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.ways.posterior import FEWEST
from accelerated_evaluation.laws import Law
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
    law: Law,
    vehicle: Vehicle,
    generator: np.random.Generator,
    *,
    simulations: int = 200_000,
) -> pd.DataFrame:
    """Return the crash probability in intervals of the absolute value of one variable, by crude Monte Carlo.

    The scenario specifies the variable and the edges of the intervals (`Scenario.divided_by`). The outcomes
    must contain an impact speed. A row has the ends of the interval, the last of which is infinite; the
    shares of all ``encounters`` and of all ``crashes`` in the interval; the ``crash_probability`` of an
    encounter in it; the median ``impact_speed`` [m/s] of its crashes; and ``probability_above``, the crash
    probability of an encounter with a value of at least ``at_least``, with its ``standard_error``. There are
    no rows if the scenario specifies no variable. A number that rests on fewer than `FEWEST` crashes is NaN.
    """
    if scenario.divided_by is None:
        return pd.DataFrame(columns=list(COLUMNS))
    variable, edges = scenario.divided_by
    x = law.draw(simulations, generator)
    outcomes = vehicle.simulate(*x.T)
    crash = outcomes.crash
    size = np.abs(x[:, scenario.names.index(variable)])
    limits = np.array([0.0, *edges, np.inf])
    groups = np.digitize(size, limits[1:-1])
    drawn = np.bincount(groups, minlength=len(limits) - 1)
    crashed = np.bincount(groups, crash, minlength=len(limits) - 1)
    drawn_above, crashed_above = (np.cumsum(counts[::-1])[::-1] for counts in (drawn, crashed))
    impact = pd.Series(outcomes.impact_speed[crash]).groupby(groups[crash]).median()
    with np.errstate(divide="ignore", invalid="ignore"):  # if an interval has no encounters or no crashes
        above = crashed_above / drawn_above
        error = np.sqrt(above * (1 - above) / drawn_above)
        own = np.where(crashed >= FEWEST, crashed / drawn, np.nan)
        shares = (drawn / drawn.sum(), crashed / (crashed.sum() if crashed.sum() >= FEWEST else np.nan), own)
    speeds = np.where(crashed >= FEWEST, impact.reindex(range(len(drawn))).to_numpy(float), np.nan)
    above, error = np.where(crashed_above >= FEWEST, [above, error], np.nan)
    columns = (variable, limits[:-1], limits[1:], *shares, speeds, above, error)
    return pd.DataFrame(dict(zip(COLUMNS, columns, strict=True)))
