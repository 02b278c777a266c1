"""Estimate the crash probability in a scenario by every method that uses normal scores only."""

from accelerated_evaluation.answer.compared_methods import compare_methods
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.external.slow import loaded_for

if __name__ == "__main__":
    with job(snakemake.log[0]):
        params = snakemake.params
        scenario = SCENARIOS[params.config["scenario"]["name"]]
        laws = {"heaviest": read_law(snakemake.input.law)}
        with loaded_for(
            params.vehicle, params.simulations | {"workers": snakemake.threads}, scenario
        ) as vehicle:
            tables = compare_methods(scenario, laws, vehicle, params.config)
        for name, path in snakemake.output.items():
            write_csv(path, tables[name])
