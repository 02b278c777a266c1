"""Tables of other treatments of the records, and of other choices, from the same draws and lines of a map."""

from collections.abc import Mapping

import pandas as pd

from accelerated_evaluation.answer.candidates.far_records import far_records_table
from accelerated_evaluation.answer.candidates.fitted_records import FittedRecords
from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.ways.by_map import thinned_lines
from accelerated_evaluation.answer.ways.choices import choice_table
from accelerated_evaluation.answer.ways.host_limit import as_choices, host_limit_table
from accelerated_evaluation.answer.ways.near_miss_answer import (
    as_choice,
    margin_curve,
    near_miss_answer,
    record_margins,
)
from accelerated_evaluation.answer.ways.variants import Streams, quality_table, record_variants
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.vehicles.protocol import CRASH, Vehicle

EVENTS = ("crash", "impact_speed")  # quantities whose probability is given with a limit to the host's speed


def other_choices(
    records: FittedRecords,
    study: LawStudy,
    crash_map: CrashMap,
    vehicle: Vehicle,
    size: int,
    outlier_rows: list[int],
    streams: Streams,
) -> Mapping[str, pd.DataFrame]:
    """Return the tables by name: `quality_table`, far records, near misses, limits of the host and choices.

    ``size`` is the number of draws of the answer from near misses.
    """
    distinct = records.distinct
    lead_speed, support = distinct.lead_speed, distinct.support
    draws = study.draws(streams("draws"))
    of_events = {
        event: thinned_lines(
            CrashLines.of(crash_map, lead_speed, event, support), vehicle, draws, streams("answer")
        )
        for event in crash_map.events
        if event.quantity in EVENTS
    }
    lines, names = of_events[CRASH], {event: CUT_IN.event_in_words(event) for event in of_events}
    crashed = vehicle.simulate(*records.table[list(CUT_IN.names)].to_numpy().T).crash
    variants = record_variants(records.table, crashed, outlier_rows, support)
    margins = record_margins(Problem(CUT_IN, vehicle), records.x)
    near_misses = near_miss_answer(margins, size, streams("near-miss answer"))
    by_name = {names[event]: each for event, each in of_events.items()}
    hosts = host_limit_table(by_name, draws, lead_speed, distinct.closing_speed)
    choices = [choice_table(study, lines, streams), as_choices(hosts, names[CRASH]), as_choice(near_misses)]
    return {
        "data_quality": quality_table(variants, study, lines, streams),
        "far_records": far_records_table(study),
        "near_miss_answer": near_misses,
        "margins": margin_curve(margins, size, streams("near-miss answer")),
        "host_limit": hosts,
        "choices": pd.concat(choices),
    }
