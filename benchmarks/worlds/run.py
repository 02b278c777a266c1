"""Simulate a chunk of worlds of one kind, run the procedures on each, and write what they said.

The paper's procedure is only run in the worlds that resemble the models.
"""

import argparse

import pandas as pd
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from beyond import worlds_beyond
from kinds import worlds
from procedures import OURS, PROCEDURES
from setting import ROOT, read_setting, simulate_records


def main() -> None:
    """Write a table with a row a world and procedure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kind", type=lambda name: name.replace("_", " "))
    parser.add_argument("--worlds", type=int, nargs=2, metavar=("FIRST", "END"), required=True)
    parser.add_argument("--setting", required=True)
    parser.add_argument("--output", required=True)
    arguments = parser.parse_args()
    setting, kind, rows = read_setting(arguments.setting), arguments.kind, []
    similar = worlds(setting.family, setting.law)
    world = (similar | worlds_beyond(setting.family))[kind]
    truth = float(world.masses(setting.lines).sum())
    for number in range(*arguments.worlds):
        records = simulate_records(world, setting, child_generator(ROOT, "worlds", kind, number))
        for name in PROCEDURES if kind in similar else (OURS,):
            # The published worlds of this project were drawn with the word "beyond".
            word = "beyond" if name == OURS else name
            reported = PROCEDURES[name](records, setting, child_generator(ROOT, "worlds", kind, number, word))
            known = {"kind": kind, "procedure": name, "beyond": kind not in similar, "world": number}
            rows.append(known | {"truth": truth} | reported)
    write_csv(arguments.output, pd.DataFrame(rows))


if __name__ == "__main__":
    main()
