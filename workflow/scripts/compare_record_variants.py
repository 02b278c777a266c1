"""Compute the crash probability again for other treatments of the records, and for other choices of laws."""

from accelerated_evaluation.answer.choices import choice_table
from accelerated_evaluation.answer.family_file import read_family
from accelerated_evaluation.answer.summary import quality_table, record_variants
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
        encounters, support = read_encounters(files.encounters), Support.of(params.support)
        records = DistinctRecords.of(encounters, support)
        weigh, generator = (child_generator(params.seed, "laws", name) for name in ("weigh", "data_quality"))
        weighted = WeightedLaws.drawn(read_family(files.family, records), weigh, params.answer["draws"])
        lines = CrashLines.of(read_crash_map(files.map), records.lead_speed, support=support)
        thinned = weighted.thinned(lines, weigh)
        cut_ins = (encounters[name].to_numpy() for name in ("lead_speed", "range", "closing_speed"))
        with loaded_for(params.vehicle, params.simulations | {"workers": snakemake.threads}) as vehicle:
            crashed = vehicle.simulate(*cut_ins).crash
        variants = record_variants(encounters, crashed, params.outlier_rows, support)
        table = quality_table(variants, weighted, thinned, params.answer["quality_draws"], generator)
        write_csv(snakemake.output.data_quality, table)
        choices = child_generator(params.seed, "laws", "choices")
        table = choice_table(weighted, thinned, params.answer["quality_draws"], choices)
        write_csv(snakemake.output.choices, table)
