"""The tables of a study's answer, for all ways and scenarios."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from scipy.special import ndtri

from accelerated_evaluation.answer.answer import Answer
from accelerated_evaluation.answer.by_few_runs import crashes_table
from accelerated_evaluation.answer.comparison import draws_table, is_resolved, vehicle_table
from accelerated_evaluation.answer.estimate_tables import exposure_of
from accelerated_evaluation.answer.fitted_records import FittedRecords
from accelerated_evaluation.answer.injuries.impacts import mean_risks, tabulated_risks
from accelerated_evaluation.answer.injuries.tables import injury_tables
from accelerated_evaluation.answer.posterior import budget

UNDER_TEST = "under test"


def study_tables(
    answers: Mapping[str, Answer], records: FittedRecords, half_width: float
) -> dict[str, pd.DataFrame]:
    """Return the tables of the answers of a study, of which the first is that of the vehicle under test.

    They are ``answer``, ``answer_budget``, ``answer_draws``, ``exposure``, ``vehicles`` and ``crashes``, and
    the tables of injuries if the scenario has risks of injury.

    Parameters
    ----------
    answers
        Answer for each vehicle, by its name.
    records
        The records.
    half_width
        Relative half-width of the 80 % interval of an estimate of the paper, which appears in the budget of
        an answer that was not sampled.
    """
    own, scenario = answers[UNDER_TEST], answers[UNDER_TEST].problem.scenario
    posteriors = {scenario.event_in_words(event): each for event, each in own.posteriors.items()}
    sampling = half_width / ndtri(0.9)
    tables = {
        "answer": own.table(records.per_km),
        "answer_budget": own.budget() if own.sampled else budget(own.posterior, sampling),
        "answer_draws": draws_table(own),
        "exposure": exposure_of(posteriors, records),
        "vehicles": vehicle_table(answers, scenario.references),
        "crashes": crashes_table(own),
    }
    if scenario.has_injuries:
        tables |= _injuries(answers, records, sampling)
    return tables


def _injuries(
    answers: Mapping[str, Answer], records: FittedRecords, sampling: float
) -> dict[str, pd.DataFrame]:
    risks, found = tabulated_risks(), {}
    for name, answer in answers.items():
        if answer.crashes is not None and is_resolved(answer):
            expected = answer.crashes.weights @ mean_risks(answer.crashes.impact_speed, risks).T
            # The weights of simulated crashes add up to an estimate without control variates.
            scale = answer.posterior.probabilities / answer.crashes.weights.sum(axis=1)
            found[name] = answer.posterior, expected * np.nan_to_num(scale, nan=1.0)[:, None]
    return injury_tables(found, UNDER_TEST, list(risks), records.size, records.exposure, sampling)
