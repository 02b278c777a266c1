"""Weight the laws of the fitted family; write the answer, its tables, and the law with the largest weight."""

from accelerated_evaluation.answer.family_file import read_family
from accelerated_evaluation.answer.study import ANSWER_STREAM, LawStudy
from accelerated_evaluation.base.files import read_json, write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.maps import read_crash_map
from accelerated_evaluation.laws.files import write_law
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.support import Support
from accelerated_evaluation.records.encounter_table import read_encounters
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.external.slow import all_loaded

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params, outputs = snakemake.input, snakemake.params, dict(snakemake.output.items())
        law = outputs.pop("law")
        encounters = read_encounters(files.encounters)
        scored = read_family(files.family, DistinctRecords.of(encounters, Support.of(params.support)))
        maps = dict(zip(params.vehicles, map(read_crash_map, files.maps), strict=True))
        weigh, resolve = (child_generator(params.seed, "laws", stage) for stage in ("weigh", "resolve"))
        with all_loaded(params.vehicles, params.simulations | {"workers": snakemake.threads}) as vehicles:
            study = LawStudy.of(encounters, vehicles, maps, scored, params.draws, weigh)
            study.resolve(maps, resolve)
            generator = child_generator(params.seed, "laws", *ANSWER_STREAM)
            tables = study.answers(read_json(files.exposure), params.half_width, generator)
        write_law(law, study.representative(), encounters)
        for name, path in outputs.items():
            write_csv(path, tables[name])
