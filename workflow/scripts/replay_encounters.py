"""Show what happens: the likeliest crashes, the nearest records, their traces; and what can be prevented."""

import pandas as pd
from accelerated_evaluation.encounters.contract import read_encounters
from accelerated_evaluation.files import write_csv
from accelerated_evaluation.fitting.family import Events
from accelerated_evaluation.jobs import job
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.randomness import child_generator
from accelerated_evaluation.truth.crash_map import read_crash_map
from accelerated_evaluation.truth.happened import nearest_records, traces_of, ways_to_crash
from accelerated_evaluation.truth.lines import Lines
from accelerated_evaluation.truth.preventable import preventable
from accelerated_evaluation.vehicles.slow import all_loaded

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params, outputs = snakemake.input, snakemake.params, snakemake.output
        encounters = read_encounters(files.encounters)
        law = read_law(files.law, encounters)
        events = Events.of(encounters, law.support)
        lines = Lines.of(read_crash_map(files.map), events.lead_speed, support=law.support)
        generator = child_generator(params.seed, "happened")
        simulations = params.simulations | {"workers": snakemake.threads}
        with all_loaded(params.vehicles, simulations) as vehicles:
            vehicle = vehicles[params.tested]
            shown = [ways_to_crash(lines, law, vehicle, generator), nearest_records(events, vehicle)]
            happened = pd.concat([table for table in shown if len(table)], ignore_index=True)
            write_csv(outputs.encounters, happened)
            write_csv(outputs.traces, traces_of(happened, vehicle))
            write_csv(outputs.preventable, preventable(vehicles, law, events.lead_speed))
