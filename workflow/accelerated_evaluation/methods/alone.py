"""The surrogate-guided estimate alone, without the rest of the study: for vehicles that are slow."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import pandas as pd
from tqdm import tqdm

from accelerated_evaluation.encounters.filters import Account
from accelerated_evaluation.encounters.ingest import ingest
from accelerated_evaluation.encounters.segments import require_rows
from accelerated_evaluation.encounters.sources import describe, read_source
from accelerated_evaluation.laws import Law
from accelerated_evaluation.laws.paper import fit_paper_laws
from accelerated_evaluation.methods import METHODS, Estimate
from accelerated_evaluation.methods.study import ALL, study_method
from accelerated_evaluation.problem import Problem
from accelerated_evaluation.randomness import child_generator
from accelerated_evaluation.vehicles.slow import SlowVehicle, loaded_for

METHOD = "surrogate"


@dataclass(frozen=True)
class Alone:
    """What the estimate alone gives.

    Attributes
    ----------
    tables
        ``estimate``, one row a replicate; ``runs``, one row a simulation; ``account`` of the records. The
        first two are what the whole study has under ``estimates`` for this method and all segments.
    law
        The law that the estimates are under.
    vehicle
        The slow vehicle, which has counted its simulations; None where the vehicle is none.
    """

    tables: Mapping[str, pd.DataFrame]
    law: Law
    vehicle: SlowVehicle | None


def estimate_alone(config: Mapping[str, Any], replicates: int = 1) -> Alone:
    """Fit the law under study to the records, and estimate the crash probability by the surrogate.

    Parameters
    ----------
    config
        A complete, valid configuration. The law is the one that ``models.inverse_range.variant`` names.
    replicates
        Independent repetitions; the first ones of those that the whole study makes.

    Raises
    ------
    InputError
        If the records or the vehicle cannot be used. What was simulated before is kept in the store.
    """
    with loaded_for(config["vehicle"], config["simulations"]) as vehicle:  # first, as it is soonest refused
        law, account = fitted_law(config)
        method = METHODS[METHOD].configured(config)
        with tqdm(desc="simulations", unit="", disable=None) as bar:
            tables = study_method(
                replace(method, on_batch=lambda estimate: _show(bar, estimate)),
                Problem(law, vehicle),
                method.stopping(config),
                [child_generator(config["seed"], *method.stream(ALL, k)) for k in range(replicates)],
                {"study": config["study"], "scope": ALL, "method": METHOD},
            )
    named = {"estimate": tables["estimates"], "runs": tables["runs"], "account": account.table()}
    return Alone(named, law, vehicle if isinstance(vehicle, SlowVehicle) else None)


def fitted_law(config: Mapping[str, Any]) -> tuple[Law, Account]:
    """Read and filter the records of a configuration, and fit the law under study to them.

    Returns
    -------
    law : Law
        As the rules ``ingest_encounters`` and ``fit_models`` of the study make it.
    account : Account
        What became of every record.
    """
    raw = read_source(config["data"], child_generator(config["seed"], "sample"))
    account = Account.of(raw)
    encounters = ingest(raw, config, account)
    require_rows(encounters)
    models = config["models"]
    laws = fit_paper_laws(
        encounters,
        models,
        config["filters"]["range_max"],
        describe(config["data"]),
        models["closing_speed_max"],
    )
    return laws[models["inverse_range"]["variant"]], account


def _show(bar: tqdm, estimate: Estimate) -> None:
    """Show how far an estimate is."""
    bar.n = estimate.simulations
    bar.set_postfix_str(f"{estimate.events} crashes, {estimate.low:.2g} to {estimate.high:.2g}")
