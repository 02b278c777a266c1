"""Compare a vehicle with the published verdicts of its scenario."""

from accelerated_evaluation.answer.ways.published_verdicts import agreement, read_verdicts
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.named import NamedVehicle

if __name__ == "__main__":
    with job(snakemake.log[0]):
        params = snakemake.params
        scenario = SCENARIOS[params.scenario]
        verdicts = read_verdicts(scenario, snakemake.input.verdicts)
        named = NamedVehicle.of(params.vehicle, params.simulations, scenario, workers=snakemake.threads)
        with named.loaded() as vehicle:
            write_csv(snakemake.output.agreement, agreement(scenario, vehicle, verdicts))
