"""Published verdicts on encounters of a scenario, and how many of them a vehicle repeats."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from accelerated_evaluation.scenarios.outcomes import ENDED
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.protocol import Vehicle


def read_verdicts(scenario: Scenario, paths: Sequence[str]) -> pd.DataFrame:
    """Read tables of published verdicts as one table, which is empty without a path.

    It has the variables of the scenario, ``crash`` (0 or 1), and ``fragile`` (1 if rounding decides about the
    crash).
    """
    columns = [*scenario.names, "crash", "fragile"]
    parts = [pd.read_csv(path, usecols=columns) for path in paths]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=columns, dtype=float)


def agreement(scenario: Scenario, vehicle: Vehicle, verdicts: pd.DataFrame) -> pd.DataFrame:
    """Compare the outcomes of a vehicle with published verdicts on the same encounters.

    There is one row for the firm and one for the fragile verdicts, with their number, and the numbers of
    those that ``agree``; of those in which only our vehicle crashes (``we_crash``) or only the published one
    (``we_are_safe``); and of our simulations that ended at their time limit (``not_ended``).
    """
    outcomes = vehicle.simulate(*(verdicts[name].to_numpy(float) for name in scenario.names))
    ended = getattr(outcomes, ENDED, np.ones(len(verdicts), bool))
    published, fragile = verdicts["crash"].to_numpy() > 0, verdicts["fragile"].to_numpy() > 0
    rows = []
    for name, own in (("firm", ~fragile), ("fragile", fragile)):
        ours, theirs = outcomes.crash[own], published[own]
        rows.append(
            {
                "kind": name,
                "verdicts": int(own.sum()),
                "agree": int((ours == theirs).sum()),
                "we_crash": int((ours & ~theirs).sum()),
                "we_are_safe": int((~ours & theirs).sum()),
                "not_ended": int((~ended[own]).sum()),
            }
        )
    return pd.DataFrame(rows)
