"""Weight the laws, draw from them, and compute the answer for the vehicle under test, with its tables."""

from dataclasses import replace
from functools import partial

from accelerated_evaluation.answer.candidates.fitted_records import stored_records
from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.settings import limits_of
from accelerated_evaluation.answer.study_tables import answer_tables, fast_way
from accelerated_evaluation.answer.ways.by_few_runs import FewRuns
from accelerated_evaluation.base.files import read_json, write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.files import write_law
from accelerated_evaluation.methods import Stopping
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.records.verdict import Verdict, read_report
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.named import NamedVehicle
from accelerated_evaluation.vehicles.protocol import events_of

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params, outputs = snakemake.input, snakemake.params, dict(snakemake.output.items())
        settings, stream = params.settings, partial(child_generator, params.settings["seed"], "laws")
        scenario, fastest = SCENARIOS[settings["scenario"]["name"]], params.closing_speed_max
        records = stored_records(scenario, files.encounters, params.support, read_json(files.exposure))
        study = LawStudy.of(records, params.draws, stream, next(iter(files.family), None), fastest)
        study = replace(study, limits=limits_of(scenario, settings))
        draws, half_width = study.draws(stream("draws")), params.stopping["beta"]
        fast = fast_way(records, settings["scenario"]["simulations"], *files.map)
        own = NamedVehicle.of(settings["vehicle"], params.simulations, scenario).pending(params.batch_size)
        way = FewRuns(Stopping(**params.stopping), params.batch_size, own) if params.slow else fast
        events, verdict = events_of(scenario, params.events), Verdict.of(read_report(files.report))
        named = NamedVehicle.of(settings["vehicle"], params.simulations, scenario, workers=snakemake.threads)
        with named.loaded(sets_aside=True) as vehicle:
            problem = Problem(scenario, vehicle, scenario.events[0], law=draws.proposal)
            tables = answer_tables(problem, study, draws, records, way, events, half_width, stream)
        for name, law in (("law", study.law()), ("draws", draws.law)):
            write_law(outputs.pop(name), law, records.table, verdict)
        for name, path in outputs.items():
            write_csv(path, tables[name])
