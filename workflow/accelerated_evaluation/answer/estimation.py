"""The surrogate-guided estimate without the rest of the study, for vehicles that are slow to simulate."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import pandas as pd
from tqdm import tqdm

from accelerated_evaluation.answer.chosen_law import ANSWER, choose_law, require_law
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws import Law
from accelerated_evaluation.methods import METHODS, Estimate
from accelerated_evaluation.methods.study import ALL, study_method
from accelerated_evaluation.methods.surrogate.predecessor import read_predecessor
from accelerated_evaluation.problem import Problem
from accelerated_evaluation.records.filters import Account
from accelerated_evaluation.records.ingest import ingest
from accelerated_evaluation.records.segments import require_rows
from accelerated_evaluation.records.sources import read_source
from accelerated_evaluation.records.verdict import Verdict, verdict_on
from accelerated_evaluation.vehicles.external.slow import SlowVehicle, loaded_for

METHOD = "surrogate"


@dataclass(frozen=True)
class Alone:
    """The results of the estimate without the rest of the study.

    Attributes
    ----------
    tables
        ``estimate``, one row per replicate, with the ``law``; ``runs``, one row per simulation; ``account``
        of the records. Under the paper's law, the first two equal the rows of this method for all segments in
        the table ``estimates`` of the complete study.
    name
        Name of the law.
    law
        The law of the estimates.
    vehicle
        The slow vehicle, which counts its simulations; None if the vehicle is not slow.
    verdict
        What the checks of the records say.
    encounters
        The encounter table.
    """

    tables: Mapping[str, pd.DataFrame]
    name: str
    law: Law
    vehicle: SlowVehicle | None
    verdict: Verdict
    encounters: pd.DataFrame


def estimate_alone(
    config: Mapping[str, Any],
    replicates: int = 1,
    law: str = ANSWER,
    predecessor: str | os.PathLike | None = None,
) -> Alone:
    """Fit a law to the records, and estimate the crash probability under it with the surrogate.

    Parameters
    ----------
    config
        A complete, valid configuration.
    replicates
        Number of independent replicates; under the paper's law they are the first replicates of the complete
        study.
    law
        The name of the law; see `chosen_law.choose_law`.
    predecessor
        Table of the simulations of a similar vehicle under the same law.

    Raises
    ------
    InputError
        If the records, the law, the predecessor or the vehicle cannot be used. Completed simulations are kept
        in the store.
    """
    require_law(law)
    with loaded_for(config["vehicle"], config["simulations"]) as vehicle:  # first, as it is soonest refused
        raw = read_source(config["data"], child_generator(config["seed"], "sample"))
        verdict = verdict_on(raw, config)
        encounters, account = _ingested(raw, config)
        name, chosen = choose_law(law, encounters, config)
        known = None if predecessor is None else read_predecessor(predecessor, chosen)
        method = replace(METHODS[METHOD].configured(config), predecessor=known)
        with tqdm(desc="simulations", unit="", disable=None) as bar:
            tables = study_method(
                replace(method, on_batch=lambda estimate: _show(bar, estimate)),
                Problem(chosen, vehicle),
                method.stopping(config),
                [child_generator(config["seed"], *method.stream(ALL, k)) for k in range(replicates)],
                {"study": config["study"], "scope": ALL, "method": METHOD},
            )
    estimate = verdict.beside(tables["estimates"].assign(law=name))
    named = {"estimate": estimate, "runs": tables["runs"]}
    slow = vehicle if isinstance(vehicle, SlowVehicle) else None
    return Alone(named | {"account": account.table()}, name, chosen, slow, verdict, encounters)


def read_records(config: Mapping[str, Any]) -> tuple[pd.DataFrame, Account]:
    """Read and filter the records of a configuration.

    Returns
    -------
    encounters : pandas.DataFrame
        The encounter table, as the rule ``ingest_encounters`` of the study makes it.
    account : Account
        The account of all rows.
    """
    return _ingested(read_source(config["data"], child_generator(config["seed"], "sample")), config)


def _ingested(raw: pd.DataFrame, config: Mapping[str, Any]) -> tuple[pd.DataFrame, Account]:
    account = Account.of(raw)
    encounters = ingest(raw, config, account)
    require_rows(encounters)
    return encounters, account


def _show(bar: tqdm, estimate: Estimate) -> None:
    """Show how far an estimate is."""
    bar.n = estimate.simulations
    bar.set_postfix_str(f"{estimate.events} crashes, {estimate.low:.2g} to {estimate.high:.2g}")
