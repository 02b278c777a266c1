"""Compute the published numbers a second time, by plain importance sampling under the same draws."""

from functools import partial

import pandas as pd
from accelerated_evaluation.answer.candidates.fitted_records import stored_records
from accelerated_evaluation.answer.second_ways import StudyNumbers, generator_of, parts_by_name, second_ways
from accelerated_evaluation.answer.study_tables import UNDER_TEST, fast_way
from accelerated_evaluation.answer.ways.answer import evaluate
from accelerated_evaluation.base.files import read_arrays, read_json, write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.draws import as_draws
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.named import all_loaded
from accelerated_evaluation.vehicles.protocol import events_of

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params = snakemake.input, snakemake.params
        exposure = read_json(files.records_exposure)
        records = stored_records(CUT_IN, files.encounters, params.support, exposure)
        draws, paper = as_draws(read_law(files.draws, records.table)), read_law(files.model, records.table)
        events, mapped = (
            [CUT_IN.events[0], *events_of(CUT_IN, section)] for section in (params.events, params.mapped)
        )
        tables = {name: pd.read_csv(path) for name, path in files.items() if name in params.tables}
        generators = partial(generator_of, params.seed), child_generator(params.seed, "second ways")
        with all_loaded(params.vehicles, params.simulations, CUT_IN, workers=snakemake.threads) as vehicles:
            problem = Problem(CUT_IN, vehicles[UNDER_TEST], CUT_IN.events[0], law=draws.proposal)
            way, generator = fast_way(records, 0, *files.map), generator_of(params.seed, UNDER_TEST)
            own = evaluate(problem, draws, way, generator=generator)
            of_maps = parts_by_name(UNDER_TEST, own) | read_arrays(files.parts)
            motions = tables["lead_motion"], tables["lead_motion_europe"]
            given = vehicles, CUT_IN, records, draws, events, *generators, paper, mapped, motions, of_maps
            write_csv(snakemake.output.table, second_ways(StudyNumbers(*given), tables))
