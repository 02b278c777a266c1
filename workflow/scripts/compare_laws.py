"""Score each law of the family, and alternative laws, on held-out records near the crash set."""

from accelerated_evaluation.answer.family_file import read_family
from accelerated_evaluation.answer.law_table import compare_laws
from accelerated_evaluation.answer.weighted_family import WeightedLaws
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.maps import read_crash_map
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.support import Support
from accelerated_evaluation.records.encounter_table import read_encounters
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.external.slow import loaded_for

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params = snakemake.input, snakemake.params
        records = DistinctRecords.of(read_encounters(files.encounters), Support.of(params.support))
        weighted = WeightedLaws.drawn(
            read_family(files.family, records), child_generator(params.seed, "laws", "weigh"), params.draws
        )
        lines = CrashLines.of(read_crash_map(files.map), records.lead_speed, support=records.support)
        with loaded_for(params.vehicle, params.simulations | {"workers": snakemake.threads}) as vehicle:
            write_csv(snakemake.output.laws, compare_laws(weighted, vehicle, lines))
