"""Compute the crash probability again for other treatments of the records, and for other choices of laws."""

from functools import partial

import pandas as pd
from accelerated_evaluation.answer.by_map import thinned_lines
from accelerated_evaluation.answer.choices import choice_table
from accelerated_evaluation.answer.far_records import far_records_table
from accelerated_evaluation.answer.fitted_records import stored_records
from accelerated_evaluation.answer.host_limit import as_choices, host_limit_table
from accelerated_evaluation.answer.law_study import LawStudy
from accelerated_evaluation.answer.near_miss_answer import (
    as_choice,
    margin_curve,
    near_miss_answer,
    record_margins,
)
from accelerated_evaluation.answer.variants import quality_table, record_variants
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.maps import read_crash_map
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.named import NamedVehicle
from accelerated_evaluation.vehicles.protocol import CRASH

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params = snakemake.input, snakemake.params
        records = stored_records(CUT_IN, files.encounters, params.support)
        stream, support = partial(child_generator, params.seed, "laws"), records.data.support
        study = LawStudy.of_smooth(records, params.draws, stream, files.family)
        crash_map, lead_speed = read_crash_map(files.map), records.data.lead_speed
        of_events = {
            event: CrashLines.of(crash_map, lead_speed, event, support)
            for event in crash_map.events
            if event.quantity in ("crash", "impact_speed")
        }
        cut_ins = (records.table[name].to_numpy() for name in ("lead_speed", "range", "closing_speed"))
        with NamedVehicle.of(
            params.vehicle, params.simulations, workers=snakemake.threads
        ).loaded() as vehicle:
            crashed = vehicle.simulate(*cut_ins).crash
            margins = record_margins(Problem(CUT_IN, vehicle), records.x)
            draws = study.draws(stream("draws"))
            of_events = {
                event: thinned_lines(each, vehicle, draws, stream("answer"))
                for event, each in of_events.items()
            }
        lines = of_events[CRASH]
        variants = record_variants(records.table, crashed, params.outlier_rows, support)
        write_csv(snakemake.output.data_quality, quality_table(variants, study, lines, stream))
        write_csv(snakemake.output.far_records, far_records_table(study))
        near_misses = near_miss_answer(margins, params.draws, stream("near-miss answer"))
        write_csv(snakemake.output.near_miss_answer, near_misses)
        write_csv(snakemake.output.margins, margin_curve(margins, params.draws, stream("near-miss answer")))
        hosts = host_limit_table(
            {CUT_IN.event_in_words(event): each for event, each in of_events.items()},
            draws,
            lead_speed,
            records.data.closing_speed,
        )
        write_csv(snakemake.output.host_limit, hosts)
        limited = as_choices(hosts, CUT_IN.event_in_words(CRASH))
        choices = pd.concat([choice_table(study, lines, stream), limited, as_choice(near_misses)])
        write_csv(snakemake.output.choices, choices)
