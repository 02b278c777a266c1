"""Compute the probabilities of crashes and near-crashes of variants of the human driver a second time.

    python benchmarks/human_variants.py [STUDY] --output FILE.csv

A study makes a coarse crash map for each variant of the driver. Here, cut-ins are drawn from a wide density
that knows no driver, and each of them meets drivers of every variant, whose events are counted. The study has
to be finished, in ``results/STUDY``. The columns are those of the table ``second_ways`` of a study.
"""

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from accelerated_evaluation.answer.consequences.human_prediction import MAIN, SEVERE, VARIANTS, G
from accelerated_evaluation.answer.second_ways import CAP, DRIVERS, Features, Key, Means, Plain, WideCutIns
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.vehicles.builtin.human import Human
from moving_leads import read_study, write_twice
from second_ways import compared


def twice(study: Path, seed: int) -> pd.DataFrame:
    """Return the probabilities of variants in the table ``human_predictions``, each with its second one."""
    _, smooth, law = read_study(study)
    generator = child_generator(seed, "second ways", "variants")

    def features(x: Array) -> Features:
        for name in np.repeat([*VARIANTS], DRIVERS).tolist():
            human = Human(**VARIANTS[name])
            outcomes, braking = human.braking_given(*x.T, human.draw_inner(len(x), generator))
            near_crash = ~outcomes.crash & (braking > G * SEVERE[MAIN])
            yield name, np.column_stack([outcomes.crash, near_crash]).astype(float), None

    def made(means: Means) -> dict[Key, float]:
        return {
            ("human_predictions", f"{name}, {event}", "probability"): value
            for name, (found,) in means.items()
            for event, value in zip(("crash", MAIN), found.tolist(), strict=True)
        }

    wide = WideCutIns(smooth.records.lead_speed, law.support.range_max, CAP)
    second = Plain.of(wide, partial(law.log_densities, cap=CAP), features, generator).numbers(made)
    first = {
        ("human_predictions", f"{row.driver}, {row.event}", "probability"): (
            row.probability,
            row.standard_error,
        )
        for row in pd.read_csv(study / "human_predictions.csv").itertuples()
    }
    return compared(first, second)


if __name__ == "__main__":
    write_twice(__doc__, twice)
