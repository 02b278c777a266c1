"""The subcommand ``compare``, which lists what differs between two finished studies."""

from dataclasses import dataclass
from pathlib import Path

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.options import argument, csv_file, option
from accelerated_evaluation.commands import COMMANDS
from accelerated_evaluation.commands.shared import Command

SHOWN = {  # columns that are printed, by published table
    "answer": ["probability", "low80", "high80"],
    "exact": ["probability"],
}
DESCRIPTION = """\
Compare two finished studies, such as the default study and one in which you have changed a modelling choice:
the settings that differ, and the numbers that differ in the tables that both have published.

The probabilities of the answer, with their 80 % intervals, and of the exact evaluation of the paper's law are
printed. All cells that differ are written to OUT.csv: table, row, column, the cell in each study, and the
ratio of the second to the first. The column half_widths separates an effect from noise: it is the difference
of the logarithms, divided by half the width of the 80 % interval. Above 1 the second number lies outside of
the interval of the first, if both intervals are equally wide; far below 1 the choice hardly matters, compared
with what the records leave uncertain. Numbers of random simulations differ within their sampling error, too.

Run it in the folder in which the studies ran, for example
  echo "{study: bounded, models: {inverse_ttc: {tail: bounded normal}}}" > bounded.yaml
  make study CONFIG=bounded.yaml
  accelerated-evaluation compare spmd bounded"""


@COMMANDS.add("compare")
@dataclass(frozen=True)
class Compare(Command, description=DESCRIPTION):
    """List what differs between two finished studies: settings and published numbers."""

    first: str = argument("STUDY", "name of the study to compare with, such as spmd")
    second: str = argument("OTHER", "name of the other study")
    target: Path | None = option(
        "OUT.csv", "table to write (default: results/OTHER/compared_with_STUDY.csv)", type=csv_file
    )

    def start(self) -> None:
        """Print the settings and probabilities that differ, and write the table of all cells that differ."""
        from accelerated_evaluation.base.files import write_csv
        from accelerated_evaluation.publishing.compared_studies import changed_cells, changed_settings
        from accelerated_evaluation.publishing.study import Study

        names = self.first, self.second
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
        target = self.target or studies[1].results / f"compared_with_{names[0]}.csv"
        write_csv(target, cells)
        print(f"{target}: {len(cells)} cells of the published tables differ")
