"""Simulate a chunk of worlds of one kind, run both procedures on each, and write what they said."""

import time

import pandas as pd
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from kinds import worlds
from procedures import PROCEDURES
from setting import ROOT, chunk_arguments, read_setting, simulate_records


def main() -> None:
    """Write a table with a row a world and procedure."""
    arguments = chunk_arguments(__doc__)
    setting, kind, rows = read_setting(arguments.setting), arguments.kind, []
    world = worlds(setting.family, setting.law)[kind]
    truth = float(world.masses(setting.lines).sum())
    for number in range(*arguments.worlds):
        records = simulate_records(world, setting, child_generator(ROOT, "worlds", kind, number))
        for name, procedure in PROCEDURES.items():
            start = time.process_time()
            reported = procedure(records, setting, child_generator(ROOT, "worlds", kind, number, name))
            seconds = round(time.process_time() - start, 2)
            rows.append(
                {"kind": kind, "world": number, "procedure": name, "truth": truth, "seconds": seconds}
                | reported
            )
    write_csv(arguments.output, pd.DataFrame(rows))


if __name__ == "__main__":
    main()
