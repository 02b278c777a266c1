"""Predict the crashes and near-crashes of human drivers, and compare them with counted ones."""

from functools import partial

import pandas as pd
from accelerated_evaluation.answer.candidates.fitted_records import stored_records
from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.consequences.counted_crashes import count_events, cut_in_rate, read_events
from accelerated_evaluation.answer.consequences.human_prediction import HumanPrediction
from accelerated_evaluation.answer.ways.comparison import posterior_of
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.maps import Grid
from accelerated_evaluation.laws.draws import as_draws
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params = snakemake.input, snakemake.params
        records = stored_records(CUT_IN, files.encounters, params.support)
        laws = partial(child_generator, params.seed, "laws")
        study = LawStudy.of_smooth(records, params.draws, laws, files.family)
        prediction = HumanPrediction(
            study,
            Grid(**params.grid),
            cut_in_rate(pd.read_csv(files.exposure)),
            as_draws(read_law(files.draws, records.table)),
            posterior_of(pd.read_csv(files.own)),
            child_generator(params.seed, "crash_map", "full"),
            child_generator(params.seed, "humans"),
        )
        write_csv(snakemake.output.predicted, prediction.table(count_events(read_events(files.events))))
