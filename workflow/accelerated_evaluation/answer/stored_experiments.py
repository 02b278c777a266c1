"""Table of the authors' stored experiments by importance sampling, with checks that they do not pass.

The stored weights are half of the right ones. Each experiment is therefore checked twice: as it was stored,
and with the weights doubled. See data/stored_experiments/README.md for the files.
"""

import os
from pathlib import Path

import pandas as pd

from accelerated_evaluation.answer.weight_checks import Experiment, crude_runs_needed, weight_table
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.tables import require_file
from accelerated_evaluation.scenarios.protocol import Scenario

RIGHT = 2.0  # the right weight divided by the stored one
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
    """Return the records to which the authors fitted their law, shape (n, d)."""
    table = scenario.read_records(Path(path))
    own = table[table[IN_FIT].astype(bool)] if IN_FIT in table else table
    return own[list(scenario.names)].to_numpy(float)


def read_experiments(path: str | os.PathLike, names: tuple[str, ...], factor: float) -> dict[str, Experiment]:
    """Read the rows of stored experiments.

    Parameters
    ----------
    path
        Verdicts of one scenario; the rows with a stored weight belong to the experiments.
    names
        Names of the variables.
    factor
        The stored weights are multiplied by it: 1 as they were stored, or `RIGHT`.
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
    """Tabulate the stored experiments of a scenario with their checks.

    Parameters
    ----------
    path, published
        Verdicts of the scenario, and the numbers of all rows of its experiments.
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
        The columns of `weight_table`, and ``weights`` (``as stored`` or ``doubled``). ``probability``,
        ``error`` and ``effective_events`` are those of all rows of an experiment; ``crude`` is the
        probability by crude Monte Carlo under the authors' law; ``errors_off`` says by how many of its
        standard errors the experiment is too low; and ``crude_runs``, how many crude runs would have shown
        that.
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
