"""The tables of a study's answer, for all scenarios and for all ways in which an answer is computed."""

import os
from collections.abc import Iterable, Mapping, Sequence

import pandas as pd
from scipy.special import ndtri

from accelerated_evaluation.answer.candidates.fitted_records import FittedRecords
from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.consequences.all_cut_ins import every_encounter
from accelerated_evaluation.answer.consequences.counted_crashes import contradictions
from accelerated_evaluation.answer.consequences.criterion import Basis, Criterion
from accelerated_evaluation.answer.consequences.deciding import criteria_tables
from accelerated_evaluation.answer.consequences.injuries.curves import LEVELS
from accelerated_evaluation.answer.consequences.injuries.tables import (
    RISKS,
    Injured,
    Key,
    injury_tables,
    mean_risks,
    tabulated_risks,
)
from accelerated_evaluation.answer.estimate_tables import estimate_tables, exposure_of
from accelerated_evaluation.answer.map_tables import calibration_table, fold_calibration, map_tables
from accelerated_evaluation.answer.ways.answer import Answer, Replayed, evaluate
from accelerated_evaluation.answer.ways.by_few_runs import FewRuns
from accelerated_evaluation.answer.ways.by_map import Map
from accelerated_evaluation.answer.ways.by_simulations import Simulations
from accelerated_evaluation.answer.ways.comparison import (
    compared_table,
    draws_table,
    is_resolved,
    posterior_of,
    vehicle_row,
    vehicle_table,
)
from accelerated_evaluation.answer.ways.crash_shares import crash_shares
from accelerated_evaluation.answer.ways.evidence import checked_answers
from accelerated_evaluation.answer.ways.extrapolation import drawn_crashes, extrapolation
from accelerated_evaluation.answer.ways.posterior import Posterior
from accelerated_evaluation.answer.ways.variants import Streams
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.crash_map.maps import read_crash_map
from accelerated_evaluation.laws.draws import Draws
from accelerated_evaluation.laws.limited import LimitedDraws, Where
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.scenarios.protocol import Scenario

UNDER_TEST = "under test"
WHOLE = "all encounters"  # name of the answer without a restriction
SEPARATOR = " | "  # between the parts of the name of a risk of injury

Tables = dict[str, pd.DataFrame]


def answer_tables(
    problem: Problem,
    study: LawStudy,
    draws: Draws,
    records: FittedRecords,
    way: Map | Simulations | FewRuns,
    events: Sequence[Event],
    half_width: float,
    streams: Streams,
) -> Tables:
    """Compute the answer of the vehicle under test, and return all its tables by name.

    ``half_width`` is the relative half-width of the 80 % interval of an estimate of the paper, which appears
    in the budget of an answer that was not sampled.
    """
    if isinstance(way, FewRuns):
        (own,), evidence = checked_answers(problem, draws, records, way, events, streams)
        made = estimate_tables([own], records)
        tables = own_tables(own, records, half_width)
        kept = ("answer", "estimate", "runs", "crashes", "extrapolation")
        tables |= {name: made[name].drop(columns="replicate") for name in kept}
        tables = evidence.added_to(tables)
    else:
        own = evaluate(problem, draws, way, events, generator=streams("answer"))
        replayed = (own.replayed or Replayed.of(problem, records.x)).happened
        tables = own_tables(own, records, half_width)
        tables["extrapolation"] = extrapolation(own, records, replayed)
    tables["crash_places"] = drawn_crashes(own, records, streams("crash places"))
    if records.in_clusters:
        tables["joint_laws"] = study.family.table(study.weights)
    elif not isinstance(way, Map):  # the table of a map also has crashes and near misses
        tables["calibration"] = calibration_table(study)
        tables["fold_calibration"] = fold_calibration(study)
    if isinstance(way, Map):
        tables |= map_tables(own, study, way.crash_map, streams)
    if isinstance(way, Simulations):
        tables |= _simulation_tables(own, study, way, events, streams)
    return tables


def fast_way(
    records: FittedRecords, simulations: int, crash_map: str | os.PathLike | None = None
) -> Map | Simulations:
    """Return the way for a fast vehicle: by the file of its crash map, or by so many simulations."""
    return Simulations(simulations) if crash_map is None else Map(read_crash_map(crash_map), records.data)


def own_tables(own: Answer, records: FittedRecords, half_width: float) -> Tables:
    """Return the tables that every answer has; see `answer_tables`."""
    scenario = own.problem.scenario
    posteriors = {scenario.event_in_words(event): each for event, each in own.posteriors.items()}
    tables = {
        "answer": own.table(records.per_km),
        "answer_budget": own.budget(None if own.sampled else half_width / ndtri(0.9)),
        "answer_draws": draws_table(own),
        "exposure": exposure_of(posteriors, records),
        "vehicle": pd.DataFrame([vehicle_row(UNDER_TEST, own)]),
    }
    return tables | ({"risks": risks_table(own)} if scenario.name in RISKS else {})


def risks_table(own: Answer) -> pd.DataFrame:
    """Return the expected risk of injury of an encounter under each draw, one column for each curve."""
    if own.crashes is None or own.posterior is None or not is_resolved(own):
        return pd.DataFrame()
    risks = tabulated_risks()
    expected = own.crash_weights @ mean_risks(own.crashes.impact_speed, risks).T
    return pd.DataFrame(expected, columns=[SEPARATOR.join(key) for key in risks])


def injured_by_level(posterior: Posterior | None, risks: pd.DataFrame | None) -> dict[str, Array]:
    """Return the expected number of injured drivers in an encounter by level, arrays (draws, curves).

    ``risks`` is the table of `risks_table`; without risks there are no levels.
    """
    if posterior is None or risks is None or not len(risks):
        return {}
    keys, expected = list(tabulated_risks()), risks.to_numpy(float)
    return {level: Injured.of(posterior, expected, keys, level).numbers for level in LEVELS}


def comparison_tables(
    own: Mapping[str, pd.DataFrame],
    others: Iterable[tuple[str, Answer]],
    records: FittedRecords,
    references: Mapping[str, str],
    half_width: float,
) -> Tables:
    """Compare the vehicle under test with others under the same draws of the law.

    The tables ``answer_draws``, ``vehicle`` and, if there are risks of injury, ``risks`` of `answer_tables`
    represent the vehicle under test. The tables ``vehicles``, ``vehicle_draws`` and ``compared`` are
    returned, and those of injuries. The answers of the others, each with its name, are used one after the
    other, because the weights of the crashes of one need several hundred MB.
    """
    rows, posteriors = [own["vehicle"]], {UNDER_TEST: posterior_of(own["answer_draws"])}
    risks = {UNDER_TEST: own["risks"]} if "risks" in own else {}
    drawn = [own["answer_draws"].assign(vehicle=UNDER_TEST)]
    for name, each in others:
        rows.append(pd.DataFrame([vehicle_row(name, each)]))
        posteriors[name] = each.posterior if is_resolved(each) else None
        if posteriors[name] is not None:
            drawn.append(draws_table(each).assign(vehicle=name))
        if risks:
            risks[name] = risks_table(each)
        del each  # before the next answer is computed
    contradicted = contradictions(posteriors, records)
    tables = {
        "vehicles": vehicle_table(pd.concat(rows), posteriors, references, contradicted),
        "vehicle_draws": pd.concat([table for table in drawn if len(table)] or drawn, ignore_index=True),
        "compared": compared_table(posteriors, contradicted),
    }
    if not risks:
        return tables
    known = {
        name: (posteriors[name], table.to_numpy(float))
        for name, table in risks.items()
        if len(table) and posteriors[name] is not None
    }
    keys: list[Key] = list(tabulated_risks())
    return tables | injury_tables(
        known, UNDER_TEST, keys, records.size, records.exposure, half_width / ndtri(0.9)
    )


def study_criteria(
    criteria: Sequence[Criterion],
    scenario: Scenario,
    records: FittedRecords,
    made: Mapping[str, pd.DataFrame],
) -> Tables:
    """Return the tables ``criteria`` and ``deciding`` of the vehicle under test (`criteria_tables`).

    ``made`` are tables of the study: ``vehicle_draws`` and ``extrapolation``, and those of
    ``risks``, ``choices`` and ``all_cut_ins`` that the study has.
    """
    posteriors = {str(name): posterior_of(rows) for name, rows in made["vehicle_draws"].groupby("vehicle")}
    own, basis = posteriors.get(UNDER_TEST), Basis.of(made["extrapolation"], scenario.scope)
    every = every_encounter(made["all_cut_ins"], UNDER_TEST) if "all_cut_ins" in made else None
    return criteria_tables(
        criteria,
        own,
        basis,
        records.size,
        records.exposure,
        posteriors,
        injured_by_level(own, made.get("risks")),
        None if every is None else (every, basis.of_every(scenario.noun)),
        made.get("choices"),
    )


def _simulation_tables(
    own: Answer, study: LawStudy, way: Simulations, events: Sequence[Event], streams: Streams
) -> Tables:
    """Return the answers for parts of the encounters, and shares of crashes by one variable."""
    problem, scenario = own.problem, own.problem.scenario
    answers = [own.table().assign(encounters=WHOLE)]
    for name, holds in scenario.restrictions.items():
        generator = streams(name)
        draws = LimitedDraws.given(own.draws, Where(holds), generator)
        part = evaluate(problem, draws, way, events, generator=generator)
        answers.append(part.table().assign(encounters=name))
    return {
        "answer": pd.concat(answers, ignore_index=True),
        "crash_shares": crash_shares(scenario, study.law(), problem.vehicle, streams("crash shares")),
        "impact_speeds": impact_speeds_table(own),
    }


def impact_speeds_table(own: Answer) -> pd.DataFrame:
    """Return mean and quantiles of impact speeds (`Answer.impact_speeds`), no row without any crash."""
    try:
        return own.impact_speeds()
    except InputError:
        return pd.DataFrame(columns=["of", "impact_speed_m_s", "low95", "high95"])
