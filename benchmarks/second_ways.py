"""Compute the answers of studies of other scenarios than the cut-in a second time, by counts.

    python benchmarks/second_ways.py left_turn [STUDY ...] --output FILE.csv

A study simulates encounters of the mean of all draws of the law, and weights them for each draw. Here, each
draw has encounters of its own, which are counted, so neither weights nor densities are used. Of events that
are too rare for that, the mean of all draws alone is compared. The studies have to be finished, in
``results/STUDY``. The columns are those of the table ``second_ways`` of a study.
"""

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from accelerated_evaluation.answer.candidates.fitted_records import stored_records
from accelerated_evaluation.answer.second_ways import COLUMNS, PLAIN, Key, Means, Plain, summary
from accelerated_evaluation.answer.study_tables import WHOLE
from accelerated_evaluation.answer.ways.posterior import FEWEST
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.files import read_json, write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.draws import Draws, as_draws
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.vehicles.named import NamedVehicle
from accelerated_evaluation.vehicles.protocol import events_of

BATCHES, SIZE = 32, 2**11  # batches of each draw, and the largest number of encounters in each
EVENTS = 100  # expected events of a draw from which on a quantile of draws is little wider by their noise
COUNTS = "counts of simulations under each draw of the law"
PUBLISHED = ["probability", "median", "low50", "high50", "low80", "high80", "low95", "high95"]


def counted(
    draws: Draws, happened: Callable[[Array], Mapping[str, Array]], size: int, generator: np.random.Generator
) -> Plain:
    """Return the means of the columns of each part of the encounters, by batches of a size and by draws."""
    sums: dict[str, list[Array]] = {}
    for _ in range(BATCHES):
        x = np.concatenate([law.draw(size, generator) for law in draws.laws])
        for name, columns in happened(x).items():
            sums.setdefault(name, []).append(columns.reshape(draws.size, size, -1).mean(axis=1))
    return Plain({name: np.stack(parts) for name, parts in sums.items()})


def compared(
    first: Mapping[Key, tuple[float, float]],
    second: Mapping[Key, tuple[float, float]],
    mechanism: Callable[[Key], str] = lambda _: PLAIN,
) -> pd.DataFrame:
    """Return the rows of numbers that have a second one; each number comes with its error or NaN."""
    rows = []
    for key, (number, error) in first.items():
        if key in second:
            again, own = second[key]
            difference = (number - again) / np.hypot(own, np.nan_to_num(error))
            rows.append((*key, number, error, again, own, mechanism(key), difference, ""))
    return pd.DataFrame(rows, columns=COLUMNS)


def twice(study: Path, seed: int) -> pd.DataFrame:
    """Return the table of the answer of a study, each number with its second one."""
    config = read_json(study / "config.json")
    scenario = SCENARIOS[config["scenario"]["name"]]
    records = stored_records(scenario, study / "encounters.parquet", None, read_json(study / "exposure.json"))
    draws = as_draws(read_law(study / "laws" / "draws.json", records.table))
    events = [scenario.events[0], *events_of(scenario, config["answer"]["events"])]
    parts = {WHOLE: lambda x: np.ones(len(x), dtype=bool), **scenario.restrictions}
    answer = pd.read_csv(study / "laws" / "answer.csv")
    named = NamedVehicle.of(config["vehicle"], config["simulations"], scenario)

    def numbers(means: Means) -> dict[Key, float]:
        return {
            ("answer", f"{scenario.event_in_words(event)}, {name}", column): value
            for name in parts
            for k, event in enumerate(events)
            for column, value in summary(means[name][:, k] / means[name][:, -1]).items()
        }

    with named.loaded() as vehicle:

        def happened(x: Array) -> dict[str, Array]:
            """Return the events of encounters, (n, events), followed by ones, for each part."""
            outcomes = vehicle.simulate(*x.T)
            columns = np.column_stack([*(event.happens(outcomes) for event in events), np.ones(len(x))])
            return {name: columns * inside(x)[:, None] for name, inside in parts.items()}

        size = min(SIZE, int(EVENTS / answer["low95"].iloc[0] / BATCHES) + 1)
        plain = counted(draws, happened, size, child_generator(seed, "second ways", study.name))
    first = {}
    for row in answer.dropna(subset="median").to_dict("records"):
        # The sampling error of the mean, which all draws share.
        error = 1 / np.sqrt(max(row["probability"] * config["scenario"]["simulations"], FEWEST))
        is_counted = row["low95"] * BATCHES * size >= EVENTS / 2
        for column in PUBLISHED if is_counted else PUBLISHED[:1]:
            key = "answer", f"{row['event']}, {row['encounters']}", column
            first[key] = row[column], error * row[column]
    return compared(first, plain.numbers(numbers), lambda _: COUNTS)


def main() -> None:
    """Compute the numbers of some studies a second time, and write their table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("studies", nargs="+", metavar="STUDY")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--output", type=Path, required=True)
    given = parser.parse_args()
    tables = [twice(Path("results") / name, given.seed).assign(study=name) for name in given.studies]
    write_csv(given.output, pd.concat(tables, ignore_index=True))


if __name__ == "__main__":
    main()
