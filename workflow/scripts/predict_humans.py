"""Predict the crashes and near-crashes of human drivers, and compare them with counted ones."""

import pandas as pd
from accelerated_evaluation.answer.counted_crashes import count_events, cut_in_rate, read_events
from accelerated_evaluation.answer.family_file import read_family
from accelerated_evaluation.answer.human_prediction import HumanPrediction
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.maps import Grid
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.support import Support
from accelerated_evaluation.records.encounter_table import read_encounters
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params = snakemake.input, snakemake.params
        records = DistinctRecords.of(read_encounters(files.encounters), Support.of(params.support))
        scored = read_family(files.family, records)
        per_km = cut_in_rate(pd.read_csv(files.exposure))
        of_maps = child_generator(params.seed, "crash_map", "full")
        generator = child_generator(params.seed, "humans")
        prediction = HumanPrediction(scored, Grid(**params.grid), per_km, params.draws, of_maps, generator)
        write_csv(snakemake.output.predicted, prediction.table(count_events(read_events(files.events))))
