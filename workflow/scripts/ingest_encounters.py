"""Read the lane changes of the configured source, filter and segment them, and account for every row."""

from accelerated_evaluation.encounters.contract import write_encounters
from accelerated_evaluation.encounters.ingest import ingest, read_source
from accelerated_evaluation.encounters.twin import Twin, read_lead_speed
from accelerated_evaluation.files import write_csv
from accelerated_evaluation.jobs import job
from accelerated_evaluation.laws.lane_change_model import read_model
from accelerated_evaluation.randomness import child_generator


def main(config: dict, seed: int, encounters_path: str, account_path: str) -> None:
    """Write the encounter table and its account."""
    data, twin = config["data"], None
    if data["source"] == "twin":
        model = read_model(data["twin"]["model"])
        lead_speed = read_lead_speed(data["twin"]["lead_speed"])
        twin = Twin(model.inverse_range, model.inverse_ttc, model.events, lead_speed)
    raw = read_source(data, model=twin, generator=child_generator(seed, "twin"))
    encounters, account = ingest(raw, config)
    write_csv(account_path, account)
    write_encounters(encounters_path, encounters, data[data["source"]]["description"])


if __name__ == "__main__":
    with job(snakemake.log[0]):
        sections = {name: snakemake.params[name] for name in ("data", "filters", "segments")}
        main(sections, snakemake.params.seed, snakemake.output.encounters, snakemake.output.account)
