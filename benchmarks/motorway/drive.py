"""Simulate some hours of a world, and write their cut-ins and the statistics of their traffic."""

import argparse

import pandas as pd
from accelerated_evaluation.base.files import atomic_path, write_csv
from calibration import traffic_row
from traffic import add_part, named_part, run_command, simulate


def main() -> None:
    """Write the cut-ins of some hours of a world, and the row about its traffic."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_part(parser)
    parser.add_argument("--output", required=True, help="Parquet file of the cut-ins")
    parser.add_argument("--traffic", required=True, help="CSV file of the row about the traffic")
    arguments = parser.parse_args()
    found = simulate(*named_part(arguments))
    cut_ins = found.cut_ins().query("counts").drop(columns="counts")
    with atomic_path(arguments.output) as temporary:
        cut_ins.to_parquet(temporary, index=False)
    write_csv(arguments.traffic, pd.DataFrame([traffic_row(found, cut_ins)]))


if __name__ == "__main__":
    run_command(main)
