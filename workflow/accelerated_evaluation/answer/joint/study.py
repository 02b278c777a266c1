"""The whole answer for a scenario, from its records and a vehicle that is fast to simulate."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.joint.posterior import (
    DRAWS,
    SIMULATIONS,
    DrawnLaws,
    Within,
    answer_tables,
    simulated_posterior,
    surrogate_posterior,
)
from accelerated_evaluation.answer.joint.scores import ClusteredRecords, Respond, score_laws
from accelerated_evaluation.answer.reweighting import SampledPosterior

WEIGHT_DRAWS = 1000  # of the weights in the table of laws


def joint_answer(
    records: ClusteredRecords,
    respond: Respond,
    generator: np.random.Generator,
    bounds: Mapping[str, Within | None] = {"all": None},
    draws: int = DRAWS,
    simulations: int = SIMULATIONS,
) -> dict[str, pd.DataFrame]:
    """Fit and weight joint laws, draw from their posterior, and find the probability of the event.

    Parameters
    ----------
    records
        The records, in clusters.
    respond
        Runs the vehicle.
    generator
        Source of all randomness.
    bounds
        Bounds of the laws by name, see `simulated_posterior`; None for no bound. All bounds share the draws
        of the law. The first is also answered by few runs of the sampler with a surrogate.
    draws, simulations
        Numbers of draws of the law, and of runs.

    Returns
    -------
    dict
        ``laws``, see `ScoredLaws.table`, with the ``probability`` under the fit of each law to all records.
        ``answer``, ``budget`` and ``draws``, see `answer_tables`, with the further columns ``bound``,
        ``method`` (``crude`` or ``surrogate``), ``simulations`` and ``converged``; see
        `surrogate_posterior` for what it means that few runs have not converged.
    """
    scored = score_laws(records, respond, generator)
    laws = scored.table(scored.weights(WEIGHT_DRAWS, generator))
    fits = DrawnLaws(scored.laws, np.arange(len(laws)), laws["law"].tolist())
    laws["probability"] = simulated_posterior(fits, respond, generator, simulations).probabilities
    drawn = DrawnLaws.of(scored, generator, draws)
    found: list[tuple[dict[str, str | int | bool], SampledPosterior]] = []
    for name, within in bounds.items():
        posterior = simulated_posterior(drawn, respond, generator, simulations, within)
        own = {"bound": name, "method": "crude", "simulations": simulations, "converged": True}
        found.append((own, posterior))
    few, sampler, converged = surrogate_posterior(drawn, respond, generator)
    if few is not None:
        own = {"method": "surrogate", "simulations": sampler.simulations, "converged": converged}
        found.insert(1, (found[0][0] | own, few))
    tables: dict[str, list[pd.DataFrame]] = {"answer": [], "budget": [], "draws": []}
    for own, posterior in found:
        for name, table in answer_tables(posterior, drawn).items():
            tables[name].append(table.assign(**own))
    return {"laws": laws} | {name: pd.concat(parts, ignore_index=True) for name, parts in tables.items()}
