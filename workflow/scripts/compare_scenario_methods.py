"""Estimate the crash probability in a scenario by every method that uses normal scores only."""

from functools import partial

from accelerated_evaluation.answer.ways.compared_methods import compare_methods
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.named import NamedVehicle
from accelerated_evaluation.vehicles.protocol import event_named

if __name__ == "__main__":
    with job(snakemake.log[0]):
        params = snakemake.params
        scenario = SCENARIOS[params.scenario]
        named = NamedVehicle.of(params.vehicle, params.simulations, scenario, workers=snakemake.threads)
        with named.loaded() as vehicle:
            table = compare_methods(
                scenario,
                {"heaviest": read_law(snakemake.input.law)},
                vehicle,
                event_named(params.event, scenario),
                params.methods,
                params.settings,
                partial(child_generator, params.seed, "scenario"),
                {"study": params.study},
            )
        write_csv(snakemake.output.estimates, table)
