"""The subcommand ``extract``."""

import argparse
import sys
from pathlib import Path

from accelerated_evaluation.commands import COMMANDS

DESCRIPTION = """\
Find the cut-ins in raw recordings, and write them as a table that the source table reads.

STUDY.yaml is the configuration of a study, or the part of one that says where the recordings are:

  data:
    source: spmd_raw               # or highd, exid, osi
    spmd_raw: {path: my/recordings}

files written, whole or not at all:
  OUT.parquet or OUT.csv   one row a cut-in: lead_speed [m/s], range [m] and closing_speed [m/s] at the moment
                           of the lane change, host_speed [m/s], and where it is in the recordings
  OUT_account.csv          what each step found, dropped and kept, and why
  OUT_exposure.json        how long and how far the hosts drove: hours, kilometres

A study may also begin with the recordings themselves; then it does the same by itself. docs/your_records.md
explains the rule of a cut-in and each of its settings."""


@COMMANDS.add("extract")
class Extract:
    """Find the cut-ins in raw recordings."""

    help = "find the cut-ins in raw recordings"
    description = DESCRIPTION

    @staticmethod
    def add_arguments(command: argparse.ArgumentParser) -> None:
        """Add the configuration and the table to write."""
        command.add_argument("study", metavar="STUDY.yaml", type=Path, help="says where the recordings are")
        command.add_argument("target", metavar="OUT.parquet", type=Path, help="table to write, or OUT.csv")

    @staticmethod
    def run(arguments: argparse.Namespace) -> None:
        """Read the recordings, and write the cut-ins, the account and the exposure."""
        import pandas as pd

        from accelerated_evaluation.base.errors import InputError
        from accelerated_evaluation.base.files import atomic_path, write_csv, write_json
        from accelerated_evaluation.records.sources import SOURCES
        from accelerated_evaluation.study.configuration import load

        target = arguments.target
        if target.suffix not in (".csv", ".parquet"):
            raise InputError(
                str(target),
                seen=f"the ending {target.suffix!r}",
                expected=".parquet or .csv",
                change="Rename it.",
            )
        data = load([arguments.study])["data"]
        cut_ins = SOURCES[data["source"]].read(data[data["source"]])
        if "account" not in cut_ins.attrs:
            raise InputError(
                f"{arguments.study}, data.source",
                seen=data["source"],
                expected="a source of recordings, such as spmd_raw, highd, exid or osi",
                change="A source of finished cut-ins needs no extraction.",
            )
        account, exposure = pd.DataFrame(cut_ins.attrs["account"]), cut_ins.attrs["exposure"]
        for warning in cut_ins.attrs["warnings"]:
            print(f"warning: {warning}", file=sys.stderr)
        cut_ins.attrs = {}
        write_csv(target.with_name(f"{target.stem}_account.csv"), account)
        write_json(target.with_name(f"{target.stem}_exposure.json"), exposure)
        if target.suffix == ".csv":
            write_csv(target, cut_ins)
        else:
            with atomic_path(target) as temporary:
                cut_ins.to_parquet(temporary, index=False)
        driven = f"{exposure['hours']:,.2f} h and {exposure['kilometres']:,.1f} km"
        print(f"{len(cut_ins):,} cut-ins in {driven}: {target}")
