"""Compare methods in a scenario, and compare a vehicle with published verdicts."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws import Law
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.methods.study import study_method
from accelerated_evaluation.methods.surrogate import read_predecessor
from accelerated_evaluation.scenarios.protocol import ENDED, Scenario
from accelerated_evaluation.vehicles.events import event_named
from accelerated_evaluation.vehicles.protocol import Vehicle

METHODS_OF_SCORES = ("crude", "normal_mixture", "surrogate")  # methods that only need normal scores


def compare_methods(
    scenario: Scenario,
    laws: Mapping[str, Law],
    vehicle: Vehicle,
    config: Mapping[str, Any],
    methods: Sequence[str] = METHODS_OF_SCORES,
    predecessor: str | os.PathLike | None = None,
) -> dict[str, pd.DataFrame]:
    """Estimate the probability of an event under single laws by several methods.

    The result has ``estimates``, with a row for each law, method and replicate, and ``runs``, with a row for
    each simulation of the surrogate-guided method. A table of runs of a similar vehicle under the same law is
    its predecessor.
    """
    event = event_named(config["scenario"]["event"], scenario)
    parts: dict[str, list[pd.DataFrame]] = {"estimates": [], "runs": []}
    for law_name, law in laws.items():
        problem = Problem(scenario, law, vehicle, event)
        for name in methods:
            method = METHODS[name].configured(config)
            if predecessor is not None:
                method = replace(method, predecessor=read_predecessor(predecessor, problem))
            count = method.replicates(config) or 1
            stream = config["seed"], "scenario", name, law_name
            generators = [child_generator(*stream, replicate) for replicate in range(count)]
            labels = {"study": config["study"], "law": law_name, "method": name}
            made = study_method(method, problem, method.stopping(config), generators, labels)
            for table, rows in made.items():
                parts[table].append(rows)
    made = {name: pd.concat(rows, ignore_index=True) for name, rows in parts.items() if rows}
    return made | {"estimates": made["estimates"].assign(event=scenario.event_in_words(event))}


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
