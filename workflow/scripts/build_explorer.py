"""Make the explorer: a page on which a reader can change the vehicle, the law and the event."""

from functools import partial
from pathlib import Path

import pandas as pd
from accelerated_evaluation.answer.candidates.fitted_records import stored_records
from accelerated_evaluation.base.files import atomic_path, read_json
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.maps import read_crash_map
from accelerated_evaluation.publishing.explorer import EXPLORED
from accelerated_evaluation.publishing.explorer.page import Explored, write_page
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params, config = snakemake.input, snakemake.params, snakemake.params.config
        stream, exposure = partial(child_generator, config["seed"]), read_json(files.exposure)
        scenario = SCENARIOS[config["scenario"]["name"]]
        records = stored_records(scenario, files.encounters, params.support, exposure)
        explored = Explored(
            name=config["study"],
            scenario=scenario,
            tested=config["vehicle"],
            impact_speeds=config["answer"]["events"].get("impact_speed", []),
            law=EXPLORED[scenario.name](records, config["answer"]["draws"], stream, files.law),
            x=records.x,
            exposure=exposure,
            answer=pd.read_csv(files.answer),
            vehicles=pd.read_csv(files.vehicles),
            crash_map=next(map(read_crash_map, files.map), None),
            runs=next(map(pd.read_csv, files.runs), None),
        )
        with atomic_path(snakemake.output.page) as temporary:
            write_page(explored, Path(files.templates[0]).parent, temporary, stream("explorer"))
