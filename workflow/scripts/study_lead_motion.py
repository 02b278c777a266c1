"""Estimate crash probabilities with a lead vehicle that changes its speed, and the rate of all cut-ins."""

from functools import partial

import pandas as pd
from accelerated_evaluation.answer.candidates.fitted_records import stored_records
from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.consequences.all_cut_ins import rates_table
from accelerated_evaluation.answer.consequences.lead_motion import motion_tables
from accelerated_evaluation.base.files import read_json, write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.maps import read_crash_map
from accelerated_evaluation.laws.motion.recorded import Recorded
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.records.ingest import opening_cut_ins
from accelerated_evaluation.records.sources import read_source
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.named import all_loaded

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params = snakemake.input, snakemake.params
        records = stored_records(CUT_IN, files.encounters, params.support, read_json(files.exposure))
        raw = read_source(params.data, child_generator(params.seed, "sample"))
        kept = opening_cut_ins(raw, params.data, params.filters)
        opening = DistinctRecords.of(kept, records.data.support)
        stream = partial(child_generator, params.seed, "laws")
        generator = partial(child_generator, params.seed, "lead motion")
        study = LawStudy.of_smooth(records, params.draws, stream, files.family)
        maps = dict(zip(params.vehicles, map(read_crash_map, files.maps), strict=True))
        with all_loaded(params.vehicles, params.simulations, CUT_IN, workers=1) as vehicles:
            motions = motion_tables(vehicles, maps, study, opening, Recorded.read(files.profiles), generator)
        for path, table in zip(
            (snakemake.output.moving, snakemake.output.europe), motions.values(), strict=True
        ):
            write_csv(path, table)
        draws = pd.read_csv(files.draws)
        rates = rates_table(draws, motions, records.size, records.exposure, opening.size, generator("rates"))
        write_csv(snakemake.output.together, rates)
