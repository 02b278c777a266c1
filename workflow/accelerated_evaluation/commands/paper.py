"""The subcommand ``paper``, which writes figures, tables and numbers for a LaTeX paper."""

import argparse
from pathlib import Path

from accelerated_evaluation.commands import COMMANDS

DESCRIPTION = """\
Write the figures, tables and numbers of a finished study for a LaTeX paper into one folder:

  figures/one_column     each figure as PDF, 3.48 in wide, with the font of the text
  figures/two_columns    each figure as PDF, 7.14 in wide
  tables                 each table, for the package booktabs; claims_short fits into a column
  numbers.tex            a macro for each number of the table of claims, and for the versions of code and data
  example.tex            two pages that use all of this; pdflatex example.tex

Run it in the folder in which the study ran, for example
  accelerated-evaluation paper spmd
  accelerated-evaluation paper spmd --figure fig12"""


@COMMANDS.add("paper")
class Paper:
    """Write the figures, tables and numbers of a study for a LaTeX paper."""

    help = "write figures, tables and numbers of a study for a LaTeX paper"
    description = DESCRIPTION

    @staticmethod
    def add_arguments(command: argparse.ArgumentParser) -> None:
        """Add the arguments to the parser: name of the study, folder to write, one figure, and the font."""
        command.add_argument("study", metavar="STUDY", help="name of the study, as in its configuration")
        command.add_argument(
            "--target", metavar="FOLDER", type=Path, help="folder to write (default: results/STUDY/paper)"
        )
        command.add_argument(
            "--figure", metavar="NAME", help="write only this figure, by its name or number, such as fig12"
        )
        command.add_argument(
            "--font",
            metavar="FAMILY",
            default="STIXGeneral",
            help="font of the texts in the figures (default: %(default)s, which is similar to Times)",
        )

    @staticmethod
    def run(arguments: argparse.Namespace) -> None:
        """Write the folder with figures, tables and numbers of the study, and print its path."""
        from accelerated_evaluation.publishing.latex_paper import write_paper
        from accelerated_evaluation.publishing.study import Study

        name = arguments.study
        target = arguments.target or Path("results") / name / "paper"
        write_paper(Study.named(name), target, arguments.font, arguments.figure)
        print(f"{target}: {sum(path.is_file() for path in target.rglob('*'))} files")
