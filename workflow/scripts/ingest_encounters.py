"""Read the lane changes of the configured source, filter and segment them, and account for every row."""

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import write_csv, write_json
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.records.encounter_table import write_encounters
from accelerated_evaluation.records.filters import Account
from accelerated_evaluation.records.ingest import ingest
from accelerated_evaluation.records.segments import require_rows
from accelerated_evaluation.records.sources import describe, read_source
from accelerated_evaluation.study.jobs import job


def main(config: dict, outputs: dict[str, str], kept_account: str) -> None:
    """Write the encounter table and its account; if no table can be made, the account is kept as a log."""
    raw = read_source(config["data"], child_generator(config["seed"], "sample"))
    account = Account.of(raw)
    try:
        encounters = ingest(raw, config, account)
        require_rows(encounters)
    except InputError:
        write_csv(kept_account, account.table())
        raise
    write_csv(outputs["account"], account.table())
    write_json(outputs["exposure"], raw.attrs["exposure"])
    write_encounters(outputs["encounters"], encounters, describe(config["data"]))


if __name__ == "__main__":
    with job(snakemake.log.messages):
        main(dict(snakemake.params.items()), dict(snakemake.output.items()), snakemake.log.account)
