"""Weight the laws, draw from them, and compute the answer for the vehicle under test, with its tables."""

from functools import partial

from accelerated_evaluation.answer.by_few_runs import FewRuns
from accelerated_evaluation.answer.fitted_records import stored_records
from accelerated_evaluation.answer.law_study import LawStudy
from accelerated_evaluation.answer.study_tables import answer_tables, fast_way
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
        draws = study.draws(stream("draws"))
        fast = fast_way(records, settings["scenario"]["simulations"], *files.map)
        way = FewRuns(Stopping(**params.stopping), params.batch_size) if params.slow else fast
        events, half_width = events_of(scenario, params.events), params.stopping["beta"]
        named = NamedVehicle.of(settings["vehicle"], params.simulations, scenario, workers=snakemake.threads)
        with named.loaded() as vehicle:
            problem = Problem(scenario, vehicle, scenario.events[0], law=draws.proposal)
            tables = answer_tables(problem, study, draws, records, way, events, half_width, stream)
        verdict = Verdict.of(read_report(files.report))
        write_law(outputs.pop("law"), study.law(), records.table, verdict)
        write_law(outputs.pop("draws"), draws.law, records.table, verdict)
        for name, path in outputs.items():
            write_csv(path, tables[name])
