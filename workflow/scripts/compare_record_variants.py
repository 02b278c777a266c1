"""Compute the crash probability again for other treatments of the records, and for other choices of laws."""

from dataclasses import replace
from functools import partial

from accelerated_evaluation.answer.candidates.fitted_records import stored_records
from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.settings import limits_of
from accelerated_evaluation.answer.ways.other_choices import other_choices
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.maps import read_crash_map
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.named import NamedVehicle

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params = snakemake.input, snakemake.params
        records = stored_records(CUT_IN, files.encounters, params.support)
        stream = partial(child_generator, params.seed, "laws")
        study = LawStudy.of_smooth(records, params.draws, stream, files.family)
        study = replace(study, limits=limits_of(CUT_IN, params))
        crash_map = read_crash_map(files.map)
        named = NamedVehicle.of(params.vehicle, params.simulations, CUT_IN, workers=snakemake.threads)
        with named.loaded() as vehicle:
            own = params.draws, params.outlier_rows
            tables = other_choices(records, study, crash_map, vehicle, *own, stream)
        for name, table in tables.items():
            write_csv(snakemake.output[name], table)
