"""The subcommand ``inspect``, which checks records."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from accelerated_evaluation.base.options import argument, csv_file, option
from accelerated_evaluation.commands import COMMANDS
from accelerated_evaluation.commands.shared import Command

DESCRIPTION = """\
Check records before any study: units, signs, repeated rows, stuck sensors, heaps, gaps, outliers, sample
size, drift, and the records that crash when the vehicle replays them. The verdict of each check is fine,
warning or stop, with advice on what to do.

TABLE_OR_CONFIG is one of:
  a table         .csv or .parquet, one cut-in in each row, with the columns lead_speed [m/s], range [m] and
                  closing_speed [m/s] (host speed minus lead speed)
  a configuration .yaml of a study, whose section data names the records, their columns and units

The records of another scenario (--scenario, or scenario.name of the configuration) have the columns of its
variables and of its clusters. The checks of the signs, time gaps and tails of cut-ins are then left out; the
records are compared with those of the scenario in the project instead.

The exit status is 1 if the verdict of a check is stop.

examples:
  accelerated-evaluation inspect my_cut_ins.csv --report report.csv
  accelerated-evaluation inspect my_study.yaml"""


@COMMANDS.add("inspect")
@dataclass(frozen=True)
class Inspect(Command, description=DESCRIPTION):
    """Check records before any study: fine, warning or stop."""

    records: Path = argument("TABLE_OR_CONFIG", "records to check")
    vehicle: str | None = option(
        "NAME",
        "vehicle that replays the records: a built-in vehicle, or path/to/file.py:ClassName (default: the "
        "vehicle of the configuration)",
    )
    scenario: str | None = option("NAME", "scenario of the records (default: that of the configuration)")
    report: Path | None = option("OUT.csv", "write the report also as a table", type=csv_file)

    def start(self) -> None:
        """Check the records, and print the report; exit with status 1 if a verdict is ``stop``."""
        from accelerated_evaluation.base.files import write_csv
        from accelerated_evaluation.base.randomness import child_generator
        from accelerated_evaluation.records.checks import STOP, inspect_records
        from accelerated_evaluation.records.limits import limits_in_words
        from accelerated_evaluation.records.verdict import report_in_words
        from accelerated_evaluation.scenarios import SCENARIOS
        from accelerated_evaluation.scenarios.record_table import named_records_of
        from accelerated_evaluation.study.configuration import load, resolved
        from accelerated_evaluation.vehicles.loading import section_of
        from accelerated_evaluation.vehicles.named import NamedVehicle

        is_config = self.records.suffix.lower() in (".yaml", ".yml")
        given = _given(self.records, self.scenario, is_config=is_config)
        config = load([self.records] if is_config else [], given)
        scenario = SCENARIOS[config["scenario"]["name"]]
        vehicle = config["vehicle"]
        if self.vehicle is not None:
            vehicle = section_of(self.vehicle)
        if scenario.has_support:
            config = resolved(config)
            cap = config["models"]["closing_speed_max"]
            print(limits_in_words(config["filters"], config["segments"]["lead_speed_edges"], cap))
        with NamedVehicle.of(vehicle, config["simulations"], scenario).loaded() as car:
            records = named_records_of(scenario, config)
            raw = records.read(child_generator(config["seed"], "sample"))
            report = inspect_records(records.for_checks(raw, car.simulate))
        print(report_in_words(report))
        if self.report is not None:
            write_csv(self.report, report)
        if STOP in set(report["verdict"]):
            sys.exit(1)


def _given(path: Path, scenario: str | None, *, is_config: bool) -> dict[str, Any]:
    """Return the keys that the command line adds to the configuration: scenario and table of records."""
    given = {} if scenario is None else {"scenario": {"name": scenario}}
    if is_config:
        return given
    from accelerated_evaluation.scenarios import SCENARIOS

    if scenario is not None and SCENARIOS[scenario].records.named is None:
        return {"scenario": {"name": scenario, "records": str(path)}}
    table = {"path": str(path), "description": path.name or str(path)}
    return given | {"data": {"source": "table", "table": table}}
