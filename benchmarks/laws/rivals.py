"""Score laws from outside the family on the held-out records of a finished study.

The laws are the paper's with a generalised tail, conditional extremes, and four distributional regressions.
The table has their gains over the paper's own law, with the columns of the study's table of laws.

    python benchmarks/laws/rivals.py results/spmd benchmarks/results/law_rivals.csv
"""

import argparse
import json
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import pandas as pd
from accelerated_evaluation.answer.law_study import LawStudy
from accelerated_evaluation.answer.law_table import KNOT, PAPER, law_table, papers_law, score_laws
from accelerated_evaluation.answer.scores import FittedLaw
from accelerated_evaluation.answer.smooth_family import read_family
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.smooth.family import DistinctRecords, Fitter, LawFamily
from accelerated_evaluation.laws.smooth.independent import IndependentTail
from accelerated_evaluation.laws.smooth.shapes import Exponential, Generalised
from accelerated_evaluation.laws.smooth.smooth_hazard import fit_hazard
from accelerated_evaluation.laws.smooth.splines import Support
from accelerated_evaluation.publishing.tables.display import reproducible
from accelerated_evaluation.records.segments import read_encounters
from accelerated_evaluation.vehicles import load_vehicle
from extremes import ConditionalExtremes
from regressions import REGRESSIONS, fit_regression

EXTREME = 0.98  # level of the threshold of conditional extremes


def rivals(fitter: Fitter, family: LawFamily) -> dict[str, Callable[[DistinctRecords], FittedLaw]]:
    """Return functions that fit the laws, by name; ``family``, fitted to all records, is where fits start."""

    def extremes(records: DistinctRecords) -> ConditionalExtremes:
        body = fit_hazard(fitter.grids[1], fitter.count_speeds(records), start=family.body)
        return ConditionalExtremes.fit(records, body, EXTREME, Exponential())

    fits = {
        "independent, generalised 0.95": lambda records: IndependentTail.fit(records, KNOT, Generalised()),
        f"conditional extremes {EXTREME:g}": extremes,
    }
    for regression in REGRESSIONS:
        whole = cache(partial(fit_regression, regression, fitter.records))
        fits[f"regression: {regression.name}"] = lambda records, r=regression, w=whole: fit_regression(
            r, records, w()
        )
    return fits


def scored(results: Path) -> pd.DataFrame:
    """Return the rows of the laws from outside the family of a finished study."""
    config = json.loads((results / "config.json").read_text())
    records = DistinctRecords.of(read_encounters(results / "encounters.parquet"), Support.configured(config))
    family = read_family(results / "laws/family.npz", records)
    study = LawStudy.of_family(
        family, config["answer"]["draws"], child_generator(config["seed"], "laws", "weigh")
    )
    vehicle = load_vehicle(config["vehicle"]["name"], **config["vehicle"]["parameters"])
    others = rivals(family.fitter, family.family)
    table = law_table(study, *score_laws(study, vehicle, {PAPER: papers_law} | others), {})
    return table[table["law"].isin(others)].drop(columns=["weight", "stacking", "probability"])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("results", type=Path, help="folder of a finished study")
    parser.add_argument("table", type=Path, help="CSV file to write")
    arguments = parser.parse_args()
    write_csv(arguments.table, reproducible(scored(arguments.results)))
