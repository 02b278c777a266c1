"""The subcommand ``extract``, which finds cut-ins in recordings."""

import sys
from dataclasses import dataclass
from pathlib import Path

from accelerated_evaluation.base.options import argument
from accelerated_evaluation.commands import COMMANDS
from accelerated_evaluation.commands.shared import Command

DESCRIPTION = """\
Find the cut-ins in raw recordings, and write them as a table for the source `table`.

STUDY.yaml is the configuration of a study, or only the part of it that names the recordings:

  data:
    source: spmd_raw               # or highd, exid, osi
    spmd_raw: {path: my/recordings}

files that are written:
  OUT.parquet or OUT.csv   one row for each cut-in: lead_speed [m/s], range [m] and closing_speed [m/s] at the
                           moment of the lane change, host_speed [m/s], and its place in the recordings
  OUT_account.csv          what each step has found, removed and kept, and why
  OUT_exposure.json        time and distance that the hosts drove: hours, kilometres

A study can also begin with the recordings and then extracts the cut-ins itself. docs/your_records.md explains
the definition of a cut-in and each of its settings.

example:
  accelerated-evaluation extract my_recordings.yaml cut_ins.parquet"""


@COMMANDS.add("extract")
@dataclass(frozen=True)
class Extract(Command, description=DESCRIPTION):
    """Find the cut-ins in raw recordings."""

    study: Path = argument("STUDY.yaml", "configuration that names the recordings")
    target: Path = argument("OUT.parquet", "table to write, or OUT.csv")

    def start(self) -> None:
        """Extract the cut-ins from recordings, and write them to a table.

        The table of dropped rows (the account) and the exposure are written next to it.
        """
        import pandas as pd

        from accelerated_evaluation.base.errors import InputError
        from accelerated_evaluation.base.files import write_csv, write_json
        from accelerated_evaluation.base.tables import write_parquet
        from accelerated_evaluation.records.sources import SOURCES
        from accelerated_evaluation.study.configuration import load

        target = self.target
        if target.suffix not in (".csv", ".parquet"):
            raise InputError(
                str(target),
                seen=f"the ending {target.suffix!r}",
                expected=".parquet or .csv",
                change="Choose another ending.",
            )
        data = load([self.study])["data"]
        cut_ins = SOURCES[data["source"]].read(data[data["source"]])
        if "account" not in cut_ins.attrs:
            raise InputError(
                f"{self.study}, data.source",
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
            write_parquet(target, cut_ins)
        driven = f"{exposure['hours']:,.2f} h and {exposure['kilometres']:,.1f} km"
        print(f"{len(cut_ins):,} cut-ins in {driven}: {target}")
