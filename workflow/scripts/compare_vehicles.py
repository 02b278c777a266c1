"""Compare the vehicle under test with others under the same draws of the law."""

from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np
import pandas as pd
from accelerated_evaluation.answer.candidates.fitted_records import stored_records
from accelerated_evaluation.answer.consequences.injuries.tables import RISKS
from accelerated_evaluation.answer.second_ways import parts_of_map
from accelerated_evaluation.answer.study_tables import comparison_tables, fast_way
from accelerated_evaluation.answer.ways.answer import Answer, evaluate
from accelerated_evaluation.answer.ways.by_map import MapCrashes
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.files import atomic_path, read_json, write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.draws import as_draws
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.named import all_loaded
from accelerated_evaluation.vehicles.protocol import Vehicle

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params = snakemake.input, snakemake.params
        scenario, stream = SCENARIOS[params.scenario["name"]], partial(child_generator, params.seed, "laws")
        records = stored_records(scenario, files.encounters, params.support, read_json(files.exposure))
        draws = as_draws(read_law(files.draws, records.table))
        maps, outputs = (
            dict(zip(params.vehicles, files.maps, strict=bool(files.maps))),
            dict(snakemake.output.items()),
        )
        parts: dict[str, Array] = {}

        def answers(vehicles: Mapping[str, Vehicle]) -> Iterator[tuple[str, Answer]]:
            """Compute the answers one after the other, because each needs much memory."""
            for name, vehicle in vehicles.items():
                way = fast_way(records, params.scenario["simulations"], maps.get(name))
                problem = Problem(scenario, vehicle, scenario.events[0], law=draws.proposal)
                answer = evaluate(problem, draws, way, generator=stream("references", name))
                if isinstance(answer.crashes, MapCrashes):
                    parts[name] = parts_of_map(answer.crashes, RISKS[scenario.name]())
                yield name, answer

        own = {name: pd.read_csv(path) for name, path in files.items() if name in params.own}
        with all_loaded(params.vehicles, params.simulations, scenario, workers=snakemake.threads) as vehicles:
            shared = records, scenario.references, params.half_width
            tables = comparison_tables(own, answers(vehicles), *shared)
        if "parts" in outputs:
            with atomic_path(outputs.pop("parts")) as temporary, temporary.open("wb") as file:
                np.savez(file, **parts)
        for name, path in outputs.items():
            write_csv(path, tables[name])
