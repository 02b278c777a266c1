"""Account for the records of a scenario, weight its laws, and write the crash probability with its tables."""

from accelerated_evaluation.answer.crash_shares import crash_shares
from accelerated_evaluation.answer.scenario import ScenarioStudy, records_account
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.joint.files import write_joint_law
from accelerated_evaluation.records.report import read_report
from accelerated_evaluation.records.verdict import Verdict
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.record_table import read_scenario_records
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.external.slow import loaded_for
from accelerated_evaluation.vehicles.loading import load_vehicle

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params, settings = snakemake.input, snakemake.params, snakemake.params.scenario
        outputs = dict(snakemake.output.items())
        scenario = SCENARIOS[settings["name"]]
        records = read_scenario_records(scenario, files.records[0])
        known = load_vehicle(scenario.default_vehicle, scenario)
        study = ScenarioStudy.of(scenario, records, known, params.seed, settings["draws"])
        with loaded_for(
            params.vehicle, params.simulations | {"workers": snakemake.threads}, scenario
        ) as vehicle:
            tables = study.answers(vehicle, params.seed, settings["simulations"])
        generator = child_generator(params.seed, "scenario", "crash shares")
        tables["crash_shares"] = crash_shares(scenario, study.heaviest, known, generator)
        verdict = Verdict.of(read_report(files.report))
        described = f"records of the scenario {scenario.name}"
        write_joint_law(outputs.pop("law"), study.heaviest, described, verdict)
        tables |= {"encounters": records, "account": records_account(scenario, records), "laws": study.table}
        for name, path in outputs.items():
            write_csv(path, tables[name])
