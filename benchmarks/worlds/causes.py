"""Why an interval is wide, and what a threshold does by chance: in worlds that are true to one law.

The tail of such a world is of one kind above every threshold, so that what the answer depends on the
threshold is chance. The interval of the true law alone, which nobody knows, says what the choice
among laws adds to the width.
"""

import argparse
from functools import partial

import pandas as pd
from accelerated_evaluation.answer.law_study import LawStudy
from accelerated_evaluation.answer.smooth_family import SmoothFamily
from accelerated_evaluation.answer.variants import summary_under, threshold_table
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.smooth.family import Member
from accelerated_evaluation.publishing.tables.display import reproducible
from kinds import LEVEL, World, worlds
from setting import ROOT, WorldSettings, distinct_records, read_setting, simulate_records
from tqdm import tqdm

DRAWS = 200  # of the posterior, for each threshold as well
# The laws that are true; light tails end, and no law of the family does.
TRUE_LAW = {"exponential": "exponential", "heavy": "generalised"}


def examine(kind: str, number: int, world: World, setting: WorldSettings) -> dict[str, float | str]:
    """Return what the study's own procedure, with all thresholds, says of one world.

    Returns
    -------
    dict
        ``threshold_ratio``, the largest mean of the posterior at one threshold over the smallest; whether the
        80 % intervals of the procedure and of the true law alone hold the truth, and by which factor they
        span: ``held``, ``width``, ``true_law_held``, ``true_law_width``.
    """
    records = simulate_records(world, setting, child_generator(ROOT, "worlds", kind, number))
    streams = partial(child_generator, ROOT, "worlds", kind, number, "causes")
    study = LawStudy.of_family(SmoothFamily.of(distinct_records(records)[0]), DRAWS, streams("weigh"))
    levels = threshold_table(study, setting.lines, streams)["probability"]
    reported = {"kind": kind, "world": number, "threshold_ratio": levels.max() / levels.min()}
    truth = float(world.masses(setting.lines).sum())
    true_law = study.only([Member(LEVEL, TRUE_LAW[kind]).name])
    for prefix, laws in (("", study), ("true_law_", true_law)):
        summary = summary_under(laws, setting.lines, streams)
        low, high = summary["low80"], summary["high80"]
        reported |= {f"{prefix}held": low <= truth <= high, f"{prefix}width": high / low}
    return reported


def tabulate(rows: pd.DataFrame) -> pd.DataFrame:
    """Sum up the worlds of each kind: shares of worlds, and medians of widths.

    ``ratio_10``, ``ratio_50`` and ``ratio_90`` are quantiles of the threshold ratio.
    """
    table = []
    for kind, of_kind in rows.groupby("kind", sort=False):
        quantiles = of_kind["threshold_ratio"].quantile([0.1, 0.5, 0.9])
        reported = {"kind": kind, "worlds": len(of_kind)}
        reported |= {f"ratio_{100 * level:.0f}": value for level, value in quantiles.items()}
        for prefix in ("", "true_law_"):
            reported[f"{prefix}coverage80"] = of_kind[f"{prefix}held"].mean()
            reported[f"{prefix}width80"] = of_kind[f"{prefix}width"].median()
        table.append(reported)
    return pd.DataFrame(table)


def main() -> None:
    """Write a table with a row a world, or sum up such tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(required=True, dest="command")
    examined = commands.add_parser("examine", help="write a table with a row a world")
    examined.add_argument("kind", choices=TRUE_LAW)
    examined.add_argument("--worlds", type=int, nargs=2, metavar=("FIRST", "END"), required=True)
    examined.add_argument("--setting", required=True)
    summed = commands.add_parser("tabulate", help="sum up such tables")
    summed.add_argument("runs", nargs="+")
    for command in (examined, summed):
        command.add_argument("--output", required=True)
    arguments = parser.parse_args()
    if arguments.command == "tabulate":
        runs = pd.concat([pd.read_csv(path) for path in arguments.runs], ignore_index=True)
        write_csv(arguments.output, reproducible(tabulate(runs)))
        return
    setting, kind = read_setting(arguments.setting), arguments.kind
    world = worlds(setting.family, setting.law)[kind]
    numbers = tqdm(range(*arguments.worlds), unit="world")
    write_csv(arguments.output, pd.DataFrame([examine(kind, number, world, setting) for number in numbers]))


if __name__ == "__main__":
    main()
