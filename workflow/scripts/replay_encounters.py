"""Simulate likely crashes, critical records and tests of regulations; find which crashes are preventable."""

import numpy as np
import pandas as pd
from accelerated_evaluation.answer.consequences.preventable import preventable
from accelerated_evaluation.answer.ways.likeliest_crashes import nearest_records, traces_of, ways_to_crash
from accelerated_evaluation.answer.ways.numerical_error import numerical_errors
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.maps import read_crash_map
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.records.segments import read_encounters
from accelerated_evaluation.scenarios.cut_in import CUT_IN, EU_2022_1426
from accelerated_evaluation.scenarios.prescribed import prescribed_table
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.named import all_loaded

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params, outputs = snakemake.input, snakemake.params, snakemake.output
        encounters = read_encounters(files.encounters)
        law = read_law(files.law, encounters)
        records = DistinctRecords.of(encounters, law.support)
        lines = CrashLines.of(read_crash_map(files.map), records.lead_speed, support=law.support)
        generator = child_generator(params.seed, "happened")
        with all_loaded(params.vehicles, params.simulations, CUT_IN, workers=snakemake.threads) as vehicles:
            vehicle = vehicles[params.tested]
            shown = [ways_to_crash(lines, law, vehicle, generator), nearest_records(records, vehicle)]
            happened = pd.concat([table for table in shown if len(table)], ignore_index=True)
            write_csv(outputs.encounters, happened)
            write_csv(outputs.traces, traces_of(happened, vehicle))
            write_csv(outputs.preventable, preventable(vehicles, law, records.lead_speed))
            tests = EU_2022_1426
            x = np.concatenate([test.encounters for test in tests])
            crashes = {name: each.simulate(*x.T).crash for name, each in vehicles.items()}
            write_csv(outputs.prescribed, prescribed_table(tests, crashes))
            write_csv(outputs.numerical, numerical_errors(vehicles, lines, law, generator))
