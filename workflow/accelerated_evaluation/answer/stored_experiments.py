"""Check the authors' stored experiments by importance sampling.

The stored weights are half of the correct ones. Each experiment is therefore checked twice: as it was stored,
and with doubled weights. See data/stored_experiments/README.md for the files.
"""

import os
from pathlib import Path

import pandas as pd

from accelerated_evaluation.answer.weight_checks import Experiment, crude_runs_needed, weight_table
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.tables import require_file
from accelerated_evaluation.scenarios.protocol import Scenario

RIGHT = 2.0  # the correct weight divided by the stored one
CHANGE = "Restore it from the repository."
IN_FIT = "in_fit"  # column of records that marks those to which the authors fitted their law
COLUMNS = (
    "experiment",
    "weights",
    "probability",
    "error",
    "effective_events",
    "crude",
    "errors_off",
    "mean_weight",
    "mean_weight_error",
    "region",
    "share",
    "weighted",
    "warns_events",
    "warns_mean",
    "warns_region",
    "crude_runs",
)


def authors_records(scenario: Scenario, path: str | os.PathLike) -> Array:
    """Read the records to which the authors fitted their law, shape (n, d).

    Parameters
    ----------
    scenario
        The scenario.
    path
        Its record table. If it has the column `IN_FIT`, only the rows that it marks are used.
    """
    table = scenario.read_records(Path(path))
    own = table[table[IN_FIT].astype(bool)] if IN_FIT in table else table
    return own[list(scenario.names)].to_numpy(float)


def read_experiments(path: str | os.PathLike, names: tuple[str, ...], factor: float) -> dict[str, Experiment]:
    """Read the simulations of the stored experiments of a scenario.

    Parameters
    ----------
    path
        Table of the verdicts of the scenario. The rows with a stored weight belong to the experiments.
    names
        Names of the variables of the scenario, which are columns of the table.
    factor
        Factor of the stored weights: 1 to leave them as they are, or `RIGHT` (2) to correct them.

    Returns
    -------
    dict
        The simulations of each experiment, with their weights and outcomes, by its name.
    """
    require_file(path, CHANGE)
    rows = pd.read_csv(path).dropna(subset=["stored_weight"])
    return {
        name: Experiment(
            part[list(names)].to_numpy(float),
            factor * part["stored_weight"].to_numpy(float),
            part["crash"].to_numpy(bool),
        )
        for name, part in rows.groupby("source")
    }


def stored_experiments(
    path: str | os.PathLike,
    published: str | os.PathLike,
    scenario: str,
    records: Array,
    names: tuple[str, ...],
) -> pd.DataFrame:
    """Tabulate the stored experiments of a scenario, with checks of their weights.

    Parameters
    ----------
    path, published
        Paths of two tables: the verdicts of the scenario, which contain a part of the simulations of each
        experiment, and the published results of the complete experiments.
    scenario
        Name of the scenario.
    records
        The records to which the authors fitted their law, shape (n, d); control regions are compared with
        their shares.
    names
        Names of the variables.

    Returns
    -------
    pandas.DataFrame
        One row for each experiment and kind of weights, with the columns of `weight_checks.weight_table`, and
        ``weights`` (``as stored`` or ``doubled``). ``probability``, ``error`` and ``effective_events`` are
        those of the complete experiment; ``crude`` is the probability by crude Monte Carlo under the authors'
        law; ``errors_off`` is crude minus probability, in standard errors of the experiment; and
        ``crude_runs`` is the number of crude simulations that would have shown the difference.
    """
    require_file(published, CHANGE)
    known = pd.read_csv(published).query("scenario == @scenario").set_index("experiment")
    tables = []
    for weights, factor in (("as stored", 1.0), ("doubled", RIGHT)):
        table = weight_table(read_experiments(path, names, factor), records, names)
        own = known.loc[table["experiment"]].reset_index()
        table.insert(1, "weights", weights)
        table["probability"], table["error"] = factor * own["probability"], factor * own["error"]
        table["effective_events"] = own["effective_events"]
        table["crude"] = own["crude_events"] / own["crude_simulations"]
        table["errors_off"] = (table["crude"] - table["probability"]) / table["error"]
        pairs = zip(table["probability"], table["crude"], strict=True)
        table["crude_runs"] = [crude_runs_needed(estimated, crude) for estimated, crude in pairs]
        tables.append(table)
    return pd.concat(tables, ignore_index=True)
