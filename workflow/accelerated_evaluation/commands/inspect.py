"""The subcommand ``inspect``, which checks records."""

import argparse
import sys
from pathlib import Path
from typing import Any

from accelerated_evaluation.commands import COMMANDS, csv_file

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
class Inspect:
    """Check records before any study."""

    help = "check records before any study: fine, warning or stop"
    description = DESCRIPTION

    @staticmethod
    def add_arguments(command: argparse.ArgumentParser) -> None:
        """Add the records, the vehicle and the file to write to the parser."""
        command.add_argument("records", metavar="TABLE_OR_CONFIG", type=Path, help="records to check")
        command.add_argument(
            "--vehicle",
            metavar="NAME",
            help="vehicle that replays the records: a built-in vehicle, or path/to/file.py:ClassName "
            "(default: the vehicle of the configuration)",
        )
        command.add_argument(
            "--scenario", metavar="NAME", help="scenario of the records (default: that of the configuration)"
        )
        command.add_argument(
            "--report", metavar="OUT.csv", type=csv_file, help="write the report also as a table"
        )

    @staticmethod
    def run(arguments: argparse.Namespace) -> None:
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

        is_config = arguments.records.suffix.lower() in (".yaml", ".yml")
        given = _given(arguments.records, arguments.scenario, is_config=is_config)
        config = load([arguments.records] if is_config else [], given)
        scenario = SCENARIOS[config["scenario"]["name"]]
        vehicle = config["vehicle"]
        if arguments.vehicle is not None:
            vehicle = section_of(arguments.vehicle)
        if "segments" in scenario.stages:
            config = resolved(config)
            cap = config["models"]["closing_speed_max"]
            print(limits_in_words(config["filters"], config["segments"]["lead_speed_edges"], cap))
        with NamedVehicle.of(vehicle, config["simulations"], scenario).loaded() as car:
            records = named_records_of(scenario, config)
            raw = records.read(child_generator(config["seed"], "sample"))
            report = inspect_records(records.for_checks(raw, car.simulate))
        print(report_in_words(report))
        if arguments.report is not None:
            write_csv(arguments.report, report)
        if STOP in set(report["verdict"]):
            sys.exit(1)


def _given(path: Path, scenario: str | None, *, is_config: bool) -> dict[str, Any]:
    """Return the keys that the command line adds to the configuration: scenario and table of records."""
    given = {} if scenario is None else {"scenario": {"name": scenario}}
    if is_config:
        return given
    from accelerated_evaluation.scenarios import SCENARIOS

    if scenario is not None and SCENARIOS[scenario].named_records is None:
        return {"scenario": {"name": scenario, "records": str(path)}}
    return given | {"data": {"source": "table", "table": {"path": str(path), "description": path.name}}}
