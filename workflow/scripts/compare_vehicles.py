"""Compare the vehicle under test with others under the same draws of the law."""

from collections.abc import Iterator
from functools import partial

import pandas as pd
from accelerated_evaluation.answer.candidates.fitted_records import stored_records
from accelerated_evaluation.answer.second_ways import with_parts_stored
from accelerated_evaluation.answer.study_tables import comparison_tables, fast_way
from accelerated_evaluation.answer.ways.answer import Answer, evaluate
from accelerated_evaluation.base.files import read_json, write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.draws import as_draws
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.named import all_loaded

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params, outputs = snakemake.input, snakemake.params, dict(snakemake.output.items())
        scenario, stream = SCENARIOS[params.scenario["name"]], partial(child_generator, params.seed, "laws")
        records = stored_records(scenario, files.encounters, params.support, read_json(files.exposure))
        draws = as_draws(read_law(files.draws, records.table))
        maps = dict(zip(params.vehicles, files.maps, strict=bool(files.maps)))
        own = {name: pd.read_csv(path) for name, path in files.items() if name in params.own}
        with all_loaded(params.vehicles, params.simulations, scenario, workers=snakemake.threads) as vehicles:

            def answers() -> Iterator[tuple[str, Answer]]:
                """Compute the answers one after the other, because each needs much memory."""
                for name, vehicle in vehicles.items():
                    way = fast_way(records, params.scenario["simulations"], maps.get(name))
                    problem = Problem(scenario, vehicle, scenario.events[0], law=draws.proposal)
                    yield name, evaluate(problem, draws, way, generator=stream("references", name))

            others = with_parts_stored(answers(), outputs.pop("parts", None))
            tables = comparison_tables(own, others, records, scenario.references, params.half_width)
        for name, path in outputs.items():
            write_csv(path, tables[name])
