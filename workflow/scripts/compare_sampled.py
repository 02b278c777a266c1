"""Compare a slow vehicle with references that have a crash map, and the laws with the records."""

from functools import partial

import pandas as pd
from accelerated_evaluation.answer.averaged import posterior_of
from accelerated_evaluation.answer.calibration_table import calibration_table
from accelerated_evaluation.answer.family_file import read_family
from accelerated_evaluation.answer.references import Reference, compared_with, vehicles_with
from accelerated_evaluation.answer.weighted_family import WeightedLaws
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.maps import read_crash_map
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.support import Support
from accelerated_evaluation.records.encounter_table import read_encounters
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.external.slow import all_loaded

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params, outputs = snakemake.input, snakemake.params, snakemake.output
        encounters = read_encounters(files.encounters)
        records = DistinctRecords.of(encounters, Support.of(params.support))
        stream = partial(child_generator, params.seed, "laws")
        weighted = WeightedLaws.drawn(read_family(files.family, records), stream("weigh"), params.draws)
        draws, known = read_law(files.law, encounters).draws, pd.read_csv(files.draws)
        own = posterior_of(known) if len(known) else None
        with all_loaded(params.vehicles, params.simulations | {"workers": 1}) as vehicles:
            references = {
                name: Reference.of(
                    vehicles[name], read_crash_map(path), records, draws, stream("references", name)
                )
                for name, path in zip(vehicles, files.get("maps", []), strict=True)
            }
        write_csv(outputs.vehicles, vehicles_with(own, references, records.size))
        write_csv(outputs.compared, compared_with(own, references))
        write_csv(outputs.calibration, calibration_table(weighted))
