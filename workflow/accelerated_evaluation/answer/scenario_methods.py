"""The methods compared on a scenario, and the vehicle compared with published verdicts."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.joint import JointLaw
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.study import study_method
from accelerated_evaluation.methods.surrogate import FREQUENT_EVENTS
from accelerated_evaluation.methods.surrogate.predecessor import read_predecessor
from accelerated_evaluation.problem import ScenarioProblem
from accelerated_evaluation.scenarios.protocol import ENDED, Scenario
from accelerated_evaluation.vehicles.protocol import Vehicle

METHODS_OF_SCORES = ("crude", "normal_mixture", "surrogate")  # which need nothing but normal scores


def compare_methods(
    scenario: Scenario,
    laws: Mapping[str, JointLaw],
    vehicle: Vehicle,
    config: Mapping[str, Any],
    methods: Sequence[str] = METHODS_OF_SCORES,
    predecessor: str | os.PathLike | None = None,
) -> dict[str, pd.DataFrame]:
    """Estimate the probability of the crash under single laws by every method that needs only normal scores.

    Parameters
    ----------
    scenario, vehicle
        The scenario and the vehicle.
    laws
        The laws by name.
    config
        A complete configuration: its seed, and the settings of the methods.
    methods
        Names of the methods.
    predecessor
        Table of the runs of a similar vehicle under the same law, from which the surrogate begins.

    Returns
    -------
    dict
        ``estimates``, a row for each law, method and replicate, and ``runs`` of the surrogate.
    """
    parts: dict[str, list[pd.DataFrame]] = {"estimates": [], "runs": []}
    for law_name, law in laws.items():
        problem = ScenarioProblem(scenario, law, vehicle, scenario.events[0])
        for name in methods:
            method = METHODS[name].configured(config)
            if name == "surrogate":
                method = replace(method, **FREQUENT_EVENTS)
            if predecessor is not None:
                method = replace(method, predecessor=read_predecessor(predecessor, problem))
            count = method.replicates(config) or 1
            stream = config["seed"], "scenario", name, law_name
            generators = [child_generator(*stream, replicate) for replicate in range(count)]
            labels = {"study": config["study"], "law": law_name, "method": name}
            made = study_method(method, problem, method.stopping(config), generators, labels)
            for table, rows in made.items():
                parts[table].append(rows)
    return {name: pd.concat(rows, ignore_index=True) for name, rows in parts.items() if rows}


def read_verdicts(scenario: Scenario, paths: Sequence[str]) -> pd.DataFrame:
    """Read published verdicts; the table is empty if there is no file."""
    columns = [*scenario.names, "crash", "fragile"]
    parts = [pd.read_csv(path, usecols=columns) for path in paths]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=columns, dtype=float)


def agreement(scenario: Scenario, vehicle: Vehicle, verdicts: pd.DataFrame) -> pd.DataFrame:
    """Compare a vehicle with published verdicts.

    Parameters
    ----------
    scenario, vehicle
        The scenario and the vehicle.
    verdicts
        Columns of the variables, ``crash`` (0 or 1), and ``fragile`` (1 where rounding decides).

    Returns
    -------
    pandas.DataFrame
        A row for the firm verdicts and one for the fragile ones: ``verdicts``, ``agree``, ``we_crash`` (we
        crash, the verdict does not), ``we_are_safe``, and ``not_ended``.
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
