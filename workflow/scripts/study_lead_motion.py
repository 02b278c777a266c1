"""Estimate the crash probabilities of the vehicles with a lead vehicle that changes its speed."""

from functools import partial

from accelerated_evaluation.answer.fitted_records import stored_records
from accelerated_evaluation.answer.law_study import LawStudy
from accelerated_evaluation.answer.lead_motion import motion_table
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.maps import read_crash_map
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.records.ingest import opening_cut_ins
from accelerated_evaluation.records.sources import read_source
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.external.slow import all_loaded

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params = snakemake.input, snakemake.params
        records = stored_records(CUT_IN, files.encounters, params.support)
        raw = read_source(params.data, child_generator(params.seed, "sample"))
        opening = DistinctRecords.of(opening_cut_ins(raw, dict(params.items())), records.data.support)
        stream, generator = (
            partial(child_generator, params.seed, "laws"),
            child_generator(params.seed, "lead motion"),
        )
        study = LawStudy.of(records, params.draws, stream, files.family).smooth_only()
        maps = dict(zip(params.vehicles, map(read_crash_map, files.maps), strict=True))
        with all_loaded(params.vehicles, params.simulations | {"workers": 1}) as vehicles:
            table = motion_table(vehicles, maps, study, opening, generator)
        names = table["vehicle"].replace("under_test", "under test")
        write_csv(snakemake.output.moving, table.assign(vehicle=names))
