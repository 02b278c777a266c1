"""Score each law of the family, and the paper's law, on held-out records near the crash set."""

from functools import partial

from accelerated_evaluation.answer.candidates.fitted_records import stored_records
from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.candidates.law_table import compare_laws
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.maps import read_crash_map
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.named import NamedVehicle

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params = snakemake.input, snakemake.params
        records = stored_records(CUT_IN, files.encounters, params.support)
        stream = partial(child_generator, params.seed, "laws")
        study = LawStudy.of(records, params.draws, stream, files.family, params.closing_speed_max)
        lines = CrashLines.of(
            read_crash_map(files.map), records.data.lead_speed, support=records.data.support
        )
        with NamedVehicle.of(
            params.vehicle, params.simulations, CUT_IN, workers=snakemake.threads
        ).loaded() as vehicle:
            write_csv(snakemake.output.laws, compare_laws(study, vehicle, lines, stream("score")))
