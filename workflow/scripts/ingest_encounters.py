"""Read the records of the study, filter and segment lane changes, and account for every row."""

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import write_csv, write_json
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.base.tables import write_parquet
from accelerated_evaluation.records.ingest import Account, ingest
from accelerated_evaluation.records.segments import require_rows, write_encounters
from accelerated_evaluation.records.settings import CutInSettings
from accelerated_evaluation.records.sources import describe, read_source
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.record_table import read_scenario_records, records_account
from accelerated_evaluation.study.jobs import job


def cut_ins(settings: CutInSettings, seed: int, outputs: dict[str, str], kept_account: str) -> None:
    """Write the encounter table and its account, which is kept as a log if no table can be made."""
    raw = read_source(settings.data, child_generator(seed, "sample"))
    account = Account.of(raw)
    try:
        encounters = ingest(raw, settings, account)
        require_rows(encounters)
    except InputError:
        write_csv(kept_account, account.table())
        raise
    write_csv(outputs["account"], account.table())
    write_json(outputs["exposure"], raw.attrs["exposure"])
    write_encounters(outputs["encounters"], encounters, describe(settings.data))


if __name__ == "__main__":
    with job(snakemake.log.messages):
        config, outputs = dict(snakemake.params.items()), dict(snakemake.output.items())
        scenario = SCENARIOS[config["scenario"]["name"]]
        if scenario.has_sources:
            cut_ins(CutInSettings.of(config), config["seed"], outputs, snakemake.log.account)
        else:
            records = read_scenario_records(scenario, config["scenario"]["records"])
            write_csv(outputs["account"], records_account(scenario, records))
            write_json(outputs["exposure"], dict.fromkeys(("kilometres", "hours")))
            write_parquet(outputs["encounters"], records)
