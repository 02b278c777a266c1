"""Tables of the replicates of an estimate, as users and studies keep them."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.candidates.fitted_records import FittedRecords
from accelerated_evaluation.answer.consequences.rates import exposure_table
from accelerated_evaluation.answer.ways.answer import Answer
from accelerated_evaluation.answer.ways.by_few_runs import crashes_table
from accelerated_evaluation.answer.ways.comparison import draws_table
from accelerated_evaluation.answer.ways.extrapolation import extrapolation
from accelerated_evaluation.answer.ways.posterior import PartlyKnown, Posterior

RATE_DRAWS = 1000  # number of equally likely values of a probability from which rates are computed


def estimate_tables(answers: Sequence[Answer], records: FittedRecords) -> dict[str, pd.DataFrame]:
    """Return the tables of replicates of an answer from few runs, each with a column ``replicate``.

    They are ``answer``, ``budget``, ``draws``, ``exposure``, ``crashes``, ``extrapolation``, ``runs``, and
    ``estimate``, the estimate of the sampling alone, with its diagnostics.
    """
    parts = [_tables_of(answer, records) for answer in answers]
    return {
        name: pd.concat(
            [tables[name].assign(replicate=k) for k, tables in enumerate(parts)], ignore_index=True
        )
        for name in parts[0]
    }


def _tables_of(answer: Answer, records: FittedRecords) -> dict[str, pd.DataFrame]:
    estimate, event = answer.notes["estimate"], answer.problem.event
    row = {"law": answer.draws.proposal.description} | estimate.row() | {"converged": answer.converged}
    table = answer.table(records.per_km)
    return {
        "answer": table.assign(simulations=answer.simulations, converged=answer.converged),
        "budget": answer.budget(),
        "draws": draws_table(answer),
        "exposure": exposure_of({answer.problem.scenario.event_in_words(event): answer.posterior}, records),
        "crashes": crashes_table(answer),
        "extrapolation": extrapolation(answer, records),
        "runs": answer.tables["runs"],
        "estimate": pd.DataFrame([row]),
    }


def exposure_of(posteriors: Mapping[str, Posterior | None], records: FittedRecords) -> pd.DataFrame:
    """Return rates per kilometre and hour of events, by their names; see `exposure_table`."""
    levels = (np.arange(RATE_DRAWS) + 0.5) / RATE_DRAWS
    known = {name: own.whole for name, own in posteriors.items() if own is not None}
    member = np.zeros(RATE_DRAWS, int)  # the lowest draws are unknown, if any
    thinned = {
        name: PartlyKnown(np.quantile(own.probabilities, levels), member, levels < np.mean(own.unknown))
        for name, own in known.items()
    }
    return exposure_table(thinned, records.size, records.exposure)
