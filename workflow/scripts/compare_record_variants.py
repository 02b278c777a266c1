"""Compute the crash probability again for other treatments of the records, and for other choices of laws."""

from functools import partial

import pandas as pd
from accelerated_evaluation.answer.by_map import thinned_lines
from accelerated_evaluation.answer.choices import choice_table
from accelerated_evaluation.answer.far_records import far_records_table
from accelerated_evaluation.answer.fitted_records import stored_records
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

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params = snakemake.input, snakemake.params
        records = stored_records(CUT_IN, files.encounters, params.support)
        stream, support = partial(child_generator, params.seed, "laws"), records.data.support
        study = LawStudy.of_smooth(records, params.draws, stream, files.family)
        lines = CrashLines.of(read_crash_map(files.map), records.data.lead_speed, support=support)
        cut_ins = (records.table[name].to_numpy() for name in ("lead_speed", "range", "closing_speed"))
        with NamedVehicle.of(
            params.vehicle, params.simulations, workers=snakemake.threads
        ).loaded() as vehicle:
            crashed = vehicle.simulate(*cut_ins).crash
            margins = record_margins(Problem(CUT_IN, vehicle), records.x)
            lines = thinned_lines(lines, vehicle, study.draws(stream("draws")), stream("answer"))
        variants = record_variants(records.table, crashed, params.outlier_rows, support)
        write_csv(snakemake.output.data_quality, quality_table(variants, study, lines, stream))
        write_csv(snakemake.output.far_records, far_records_table(study))
        near_misses = near_miss_answer(margins, params.draws, stream("near-miss answer"))
        write_csv(snakemake.output.near_miss_answer, near_misses)
        write_csv(snakemake.output.margins, margin_curve(margins, params.draws, stream("near-miss answer")))
        choices = pd.concat([choice_table(study, lines, stream), as_choice(near_misses)])
        write_csv(snakemake.output.choices, choices)
