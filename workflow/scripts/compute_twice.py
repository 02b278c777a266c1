"""Compute the published numbers a second time, by plain importance sampling under the same draws."""

import numpy as np
import pandas as pd
from accelerated_evaluation.answer.candidates.fitted_records import stored_records
from accelerated_evaluation.answer.second_ways import BRAKING, StudyNumbers, second_ways
from accelerated_evaluation.answer.study_tables import UNDER_TEST, fast_way
from accelerated_evaluation.answer.ways.answer import evaluate
from accelerated_evaluation.base.files import read_json, write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.draws import as_draws
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.named import all_loaded
from accelerated_evaluation.vehicles.protocol import CRASH, RandomVehicle, events_of

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params = snakemake.input, snakemake.params
        exposure = read_json(files.records_exposure)
        records = stored_records(CUT_IN, files.encounters, params.support, exposure)
        draws, paper = (read_law(path, records.table) for path in (files.draws, files.model))
        events, mapped = (
            [CUT_IN.events[0], *events_of(CUT_IN, section)] for section in (params.events, params.mapped)
        )

        def populations(name: str) -> np.random.Generator:
            """Return the generator with which the study weights random vehicles."""
            path = {UNDER_TEST: ["laws", "answer"], BRAKING: ["humans"]}.get(
                name, ["laws", "references", name]
            )
            return child_generator(params.seed, *path)

        tables = {name: pd.read_csv(path) for name, path in files.items() if name in params.tables}
        generator = child_generator(params.seed, "second ways")
        with all_loaded(params.vehicles, params.simulations, workers=snakemake.threads) as vehicles:
            answers = {
                name: evaluate(
                    Problem(CUT_IN, vehicles[name], CRASH, law=as_draws(draws).proposal),
                    as_draws(draws),
                    fast_way(records, 0, path),
                    generator=populations(name),
                )
                for name, path in zip(params.of_maps, files.maps, strict=True)
                if isinstance(vehicles[name], RandomVehicle)
            }
            given = vehicles, CUT_IN, records, as_draws(draws), events, populations, generator, paper, mapped
            motions = tables["lead_motion"], tables["lead_motion_europe"]
            numbers = StudyNumbers(*given, motions, answers)
            write_csv(snakemake.output.table, second_ways(numbers, tables))
