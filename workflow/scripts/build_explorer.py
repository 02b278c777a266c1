"""Make the explorer: a page on which a reader can change the vehicle, the law and the event."""

from functools import partial
from pathlib import Path

import pandas as pd
from accelerated_evaluation.answer.explored import DrawnLaws
from accelerated_evaluation.answer.family_file import read_family
from accelerated_evaluation.answer.study import ANSWER_STREAM
from accelerated_evaluation.answer.weighted_family import WeightedLaws
from accelerated_evaluation.base.files import atomic_path, read_json
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.maps import read_crash_map
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.support import Support
from accelerated_evaluation.publishing.explorer.page import Explored, write_page
from accelerated_evaluation.records.encounter_table import read_encounters
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params, config = snakemake.input, snakemake.params, snakemake.params.config
        stream = partial(child_generator, config["seed"])
        records = DistinctRecords.of(read_encounters(files.encounters), Support.of(params.support))
        family, draws = read_family(files.family, records), config["answer"]["draws"]
        weighted = WeightedLaws.drawn(family, stream("laws", "weigh"), draws)
        explored = Explored(
            config=config,
            weighted=weighted,
            drawn=DrawnLaws.of(weighted, stream("laws", *ANSWER_STREAM), stream("explorer", "draws")),
            exposure=read_json(files.exposure),
            answer=pd.read_csv(files.answer),
            vehicles=pd.read_csv(files.vehicles),
            crash_map=next(map(read_crash_map, files.map), None),
            runs=next(map(pd.read_csv, files.runs), None),
        )
        with atomic_path(snakemake.output.page) as temporary:
            write_page(explored, Path(files.templates[0]).parent, temporary, stream("explorer"))
