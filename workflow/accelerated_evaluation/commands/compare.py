"""The subcommand ``compare``, which lists what differs between two finished studies."""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pandas.api.types import is_numeric_dtype

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.commands import COMMANDS
from accelerated_evaluation.publishing.study import Study

NAMES = ["study", "data"]  # columns of published tables that only name the study


def changed_settings(first: Study, second: Study) -> pd.DataFrame:
    """Return the keys of the configuration with different values: ``key`` and the values of both studies."""
    values = [pd.Series(dict(_flat(study.config)), dtype=object).drop("study") for study in (first, second)]
    return _changed(values, (first, second)).rename_axis("key").reset_index()


def changed_cells(first: Study, second: Study) -> pd.DataFrame:
    """Return the cells that differ in the tables that both studies have published.

    Rows are matched by their leading columns of text, such as the method or the event, and by their order if
    several rows have the same text. A cell that only one of the studies has is missing in the other.
    ``ratio`` is that of the second to the first if both are numbers. InputError is raised if the studies have
    no published table of the same name in the working folder.
    """
    tables = [_published(study) for study in (first, second)]
    common = sorted(tables[0].keys() & tables[1].keys())
    if not common:
        raise InputError(
            f"the tables in {first.figures} and {second.figures}",
            seen="no table of the same name",
            expected="published tables of two finished studies of one scenario",
            change="Correct the names of the studies, or run them in this folder first.",
        )
    parts = {name: _changed(_cells(*(each[name] for each in tables)), (first, second)) for name in common}
    changed = pd.concat(parts, names=["table", "row", "column"]).reset_index()
    numbers = [pd.to_numeric(changed[_header(study)], errors="coerce") for study in (first, second)]
    return changed.assign(ratio=numbers[1] / numbers[0].replace(0, np.nan))


def _header(study: Study) -> str:
    return f"in {study.results.name}"


def _flat(section: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the dotted name and the value of every key that has no keys below it."""
    for key, value in section.items():
        if isinstance(value, Mapping) and value:
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def _published(study: Study) -> dict[str, pd.DataFrame]:
    return {path.stem: pd.read_csv(path) for path in (study.figures / "tables").glob("*.csv")}


def _cells(*tables: pd.DataFrame) -> list[pd.Series]:
    """Return the cells of each table by row and column; leading texts of the first table name the rows."""
    plain = [table.drop(columns=NAMES, errors="ignore") for table in tables]
    first = plain[0]
    texts = list(takewhile(lambda name: not is_numeric_dtype(first[name]), first.columns))
    return [_by_row(table, texts or [first.columns[0]]) for table in plain]


def _by_row(table: pd.DataFrame, texts: Sequence[str]) -> pd.Series:
    words = table.reindex(columns=texts).fillna("").astype(str).to_numpy()
    row = pd.Series(map(", ".join, words), dtype=str)
    repeated = row.groupby(row).cumcount() + 1
    row = row.where(repeated == 1, row + " (" + repeated.astype(str) + ")")
    rest = table.drop(columns=texts, errors="ignore").astype(object).set_axis(row)
    return rest.melt(var_name="column", ignore_index=False).set_index("column", append=True)["value"]


def _changed(values: Sequence[pd.Series], studies: Sequence[Study]) -> pd.DataFrame:
    """Return the values that differ; numbers that agree to nine digits do not differ."""
    both = pd.concat(values, axis=1, keys=map(_header, studies))
    return both[np.array([not _equal(*pair) for pair in both.to_numpy()], dtype=bool)]


def _equal(one: object, other: object) -> bool:
    if isinstance(one, int | float) and isinstance(other, int | float):
        return bool(np.isclose(one, other, rtol=1e-9, atol=0, equal_nan=True))
    return one == other


SHOWN = {  # columns that are printed, by published table
    "answer": ["probability", "low80", "high80"],
    "scenario_answer": ["probability", "low80", "high80"],
    "exact": ["probability"],
}
DESCRIPTION = """\
Compare two finished studies, such as the default study and one in which you have changed a modelling choice:
the settings that differ, and the numbers that differ in the tables that both have published.

The probabilities of the answer, with their 80 % intervals, and of the exact evaluation of the paper's law are
printed. All cells that differ are written to OUT.csv: table, row, column, the cell in each study, and the
ratio of the second to the first. Numbers of random simulations differ within their sampling error, too.

Run it in the folder in which the studies ran, for example
  echo "{study: bounded, models: {inverse_ttc: {tail: bounded normal}}}" > bounded.yaml
  make study CONFIG=bounded.yaml
  accelerated-evaluation compare spmd bounded"""


@COMMANDS.add("compare")
class Compare:
    """List what differs between two finished studies."""

    help = "list what differs between two finished studies: settings and published numbers"
    description = DESCRIPTION

    @staticmethod
    def add_arguments(command: argparse.ArgumentParser) -> None:
        """Add the names of the studies and the table to write to the parser."""
        command.add_argument("first", metavar="STUDY", help="name of the study to compare with, such as spmd")
        command.add_argument("second", metavar="OTHER", help="name of the other study")
        command.add_argument(
            "--target",
            metavar="OUT.csv",
            type=Path,
            help="table to write (default: results/OTHER/compared_with_STUDY.csv)",
        )

    @staticmethod
    def run(arguments: argparse.Namespace) -> None:
        """Print the settings and probabilities that differ, and write the table of all cells that differ."""
        from accelerated_evaluation.base.files import write_csv
        from accelerated_evaluation.commands.compare import changed_cells, changed_settings
        from accelerated_evaluation.publishing.study import Study

        names = arguments.first, arguments.second
        if names[0] == names[1]:
            raise InputError(
                "OTHER", seen=names[1], expected="another study than STUDY", change="Name two studies."
            )
        studies = tuple(map(Study.named, names))
        scenarios = [study.scenario.name for study in studies]
        if scenarios[0] != scenarios[1]:
            expected = f"a study of the scenario {scenarios[0]}, like {names[0]}"
            change = "Name two studies of the same scenario."
            raise InputError(names[1], seen=f"a study of {scenarios[1]}", expected=expected, change=change)
        settings, cells = changed_settings(*studies), changed_cells(*studies)
        print(settings.to_string(index=False) if len(settings) else "The settings are equal.")
        places = zip(cells["table"], cells["column"], strict=True)
        headline = [column in SHOWN.get(table, ()) for table, column in places]
        if any(headline):
            # An interval comes after its number.
            shown = cells[headline].sort_values(["table", "row"], kind="stable")
            print(shown.to_string(index=False, float_format="{:.3g}".format))
        else:
            print("The probabilities are equal.")
        target = arguments.target or studies[1].results / f"compared_with_{names[0]}.csv"
        write_csv(target, cells)
        print(f"{target}: {len(cells)} cells of the published tables differ")
