"""Simulate a chunk of worlds of one kind, run both procedures on each, and write what they said."""

import argparse
import time

import numpy as np
import pandas as pd
from accelerated_evaluation.files import write_csv
from accelerated_evaluation.fitting.support import SUPPORT
from accelerated_evaluation.randomness import child_generator
from kinds import World, worlds
from procedures import PROCEDURES
from setting import ROOT, Setting, read_setting


def simulate_records(world: World, setting: Setting, generator: np.random.Generator) -> pd.DataFrame:
    """Draw as many cut-ins as were recorded, and repeat rows as often as they repeat in the record."""
    size = setting.lead_speeds.size
    events = world.draw(generator.choice(setting.lead_speeds, size), generator)
    inverse_range = 1 / np.minimum(events.range_, SUPPORT.range_max)
    columns = events.lead_speed, inverse_range, events.closing_speed * inverse_range
    lengths = generator.permutation(setting.run_lengths)
    return pd.DataFrame(
        {
            name: np.repeat(column, lengths)
            for name, column in zip(("lead_speed", "inverse_range", "inverse_ttc"), columns, strict=True)
        }
    )


def main() -> None:
    """Write a table with a row a world and procedure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kind")
    parser.add_argument("--worlds", type=int, nargs=2, metavar=("FIRST", "END"), required=True)
    parser.add_argument("--setting", required=True)
    parser.add_argument("--output", required=True)
    arguments = parser.parse_args()
    setting, kind, rows = read_setting(arguments.setting), arguments.kind.replace("_", " "), []
    world = worlds(setting.family, setting.law)[kind]
    truth = float(world.masses(setting.lines).sum())
    for number in range(*arguments.worlds):
        records = simulate_records(world, setting, child_generator(ROOT, "worlds", kind, number))
        for name, procedure in PROCEDURES.items():
            start = time.process_time()
            told = procedure(records, setting, child_generator(ROOT, "worlds", kind, number, name))
            seconds = round(time.process_time() - start, 2)
            rows.append(
                {"kind": kind, "world": number, "procedure": name, "truth": truth, "seconds": seconds} | told
            )
    write_csv(arguments.output, pd.DataFrame(rows))


if __name__ == "__main__":
    main()
