"""Simulate worlds of any kind, and find the crash probability of each by the map and by few runs."""

import pandas as pd
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from beyond import worlds_beyond
from kinds import World, worlds
from procedures import Fitted
from setting import ROOT, WorldSettings, chunk_arguments, read_setting, simulate_records
from tqdm import tqdm


def examine(kind: str, number: int, world: World, setting: WorldSettings) -> list[dict]:
    """Return a row for the map and one for few runs, with the p-values of the counts of records."""
    records = simulate_records(world, setting, child_generator(ROOT, "worlds", kind, number))
    generator = child_generator(ROOT, "worlds", kind, number, "beyond")
    fitted = Fitted.to(records, setting, generator)
    truth = float(world.masses(setting.lines).sum())
    own = {"kind": kind, "world": number, "truth": truth} | fitted.checks()
    return [
        own | {"procedure": "map"} | fitted.by_map(setting, generator),
        own | {"procedure": "few runs"} | fitted.by_few_runs(generator),
    ]


def main() -> None:
    """Write a table with two rows a world."""
    arguments = chunk_arguments(__doc__)
    setting, kind = read_setting(arguments.setting), arguments.kind
    world = (worlds(setting.family, setting.law) | worlds_beyond(setting.family))[kind]
    numbers = tqdm(range(*arguments.worlds), desc=kind, unit=" worlds")
    rows = [row for number in numbers for row in examine(kind, number, world, setting)]
    write_csv(arguments.output, pd.DataFrame(rows))


if __name__ == "__main__":
    main()
