"""The subcommand ``crate``, which packs a study into an RO-Crate."""

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from accelerated_evaluation.base.errors import StudyError
from accelerated_evaluation.base.options import argument, option
from accelerated_evaluation.commands import COMMANDS
from accelerated_evaluation.commands.shared import Command

LICENCE = "https://spdx.org/licenses/MIT"
DESCRIPTION = """\
Pack a finished study into one file that records the origin of every part of it: an RO-Crate of the profile
Provenance Run Crate 0.5, as a ZIP file.

It contains
  the records and, if it is your own, the vehicle, with checksums
  the configuration, the lock file of the environment, and the installed packages
  the workflow, its library and its notebooks, with a digest of the code of every rule
  all results, figures and tables, with the job that made each of them, its inputs and its time

Run it in the folder in which the study ran, for example
  accelerated-evaluation crate spmd

The code and the data must not have changed since the study ran. The records are copied into the file.
Consider this before you pass the file on, and state the licence under which you do so."""


@COMMANDS.add("crate")
@dataclass(frozen=True)
class Crate(Command, description=DESCRIPTION):
    """Pack a study and the record of its origin into one file (RO-Crate)."""

    study: str = argument("STUDY", "name of the study, as in its configuration")
    target: Path | None = option("FILE.zip", "file to write (default: results/STUDY.crate.zip)")
    licence: str = option(None, "address or name of the licence (default: %(default)s)", LICENCE)

    def start(self) -> None:
        """Write the crate, and print its path."""
        if find_spec("rocrate") is None:
            raise StudyError("the library rocrate is missing: pip install accelerated-evaluation[provenance]")
        from accelerated_evaluation.publishing.crate import write_crate
        from accelerated_evaluation.publishing.study import Study

        name = self.study
        target = self.target or Path("results") / f"{name}.crate.zip"
        files = write_crate(Study.named(name), target, self.licence)
        print(f"{target}: {files:,} files, {target.stat().st_size / 1e6:.1f} MB")
