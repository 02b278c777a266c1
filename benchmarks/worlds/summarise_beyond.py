"""Tabulate how often the intervals cover in worlds beyond the family, and what would reveal these worlds."""

import argparse

import numpy as np
import pandas as pd
from accelerated_evaluation.answer.calibration import CLOSING, strips
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.publishing.tables.display import reproducible
from summarise_worlds import coverages

LEVEL = 0.05  # of the test whether any cell has too few or too many records


def tabulate(rows: pd.DataFrame) -> pd.DataFrame:
    """Sum up the worlds of each kind, for the map and for few runs.

    Returns
    -------
    pandas.DataFrame
        ``worlds`` and ``answers``, of which there are fewer if few runs gave none; median and quantiles of
        the answer over the truth; by level the share of the worlds that are covered, with 95 % limits; shares
        of the worlds in which the counts of records differ from the laws, near the crashes (``near_found``)
        and by host speed (``host_found``), at the level 5 % by Bonferroni; ``simulations`` of few runs.
    """
    cells = {True: 0, False: 0}
    for strip in strips():
        cells[strip.counted == CLOSING] += len(strip.names)
    table = []
    for (kind, procedure), own in rows.groupby(["kind", "procedure"], sort=False):
        known, truth = own.dropna(subset="probability"), float(own["truth"].iloc[0])
        ratio = known["probability"] / truth
        row = {
            "kind": kind,
            "procedure": procedure,
            "worlds": len(own),
            "answers": len(known),
            "truth": truth,
        }
        row |= {
            "median_ratio": ratio.median(),
            "ratio_10": ratio.quantile(0.1),
            "ratio_90": ratio.quantile(0.9),
        }
        row["width80"] = (known["high0.8"] / known["low0.8"]).median()
        row["truth_above80"] = float(np.mean(known["high0.8"] < truth))
        row |= coverages(own)
        row["near_found"] = float((own["near_p"] < LEVEL / cells[True]).mean())
        row["host_found"] = float((own["host_p"] < LEVEL / cells[False]).mean())
        row["simulations"] = own["simulations"].mean() if "simulations" in own else np.nan
        table.append(row)
    return pd.DataFrame(table)


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="+")
    parser.add_argument("--output", required=True)
    arguments = parser.parse_args()
    runs = pd.concat([pd.read_csv(path) for path in arguments.runs], ignore_index=True)
    write_csv(arguments.output, reproducible(tabulate(runs)))


if __name__ == "__main__":
    main()
