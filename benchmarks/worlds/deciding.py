"""Is a criterion decided by the records that the table ``deciding`` asks for? On worlds of known probability.

python benchmarks/worlds/deciding.py --setting SETTING --worlds 0 20 --output TABLE.csv

In each world, a criterion is chosen that few records do not decide: it is met with a probability of 90 %. The
number of records that should decide it with a probability of 80 % is computed. So many records of the same
world are simulated, and at most `MOST`. It is counted how often the criterion is then decided, and how often
the verdict is right. If no number of records decides by the table, `MOST` records are simulated.
"""

import argparse
from functools import partial

import numpy as np
import pandas as pd
from accelerated_evaluation.answer.criterion import ENCOUNTER, UNDECIDED, Criterion, Judged, judge, verdict_of
from accelerated_evaluation.answer.deciding import deciding_table, variances_of
from accelerated_evaluation.answer.law_study import LawStudy
from accelerated_evaluation.answer.posterior import Posterior
from accelerated_evaluation.answer.scores import HeldOut, contiguous_folds
from accelerated_evaluation.answer.smooth_family import SmoothFamily, region
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.smooth.family import DistinctRecords, Fitter
from accelerated_evaluation.publishing.tables.display import reproducible
from accelerated_evaluation.records.segments import assign_segments
from kinds import World, worlds
from procedures import BLOCKS, DRAWS, EDGES, THIN, TOP
from setting import MEMBERS, ROOT, WorldSettings, read_setting
from tqdm import tqdm

KIND = "exponential"
FEW = 4000  # records at first
MOST = 60_000  # records at most, to save time
MET = 0.9  # probability that the criterion is met, with the first records


def draw_records(
    world: World, setting: WorldSettings, size: int, generator: np.random.Generator
) -> DistinctRecords:
    """Draw so many distinct records of a world."""
    return world.draw(generator.choice(setting.lead_speeds, size), generator)


def answer_of(records: DistinctRecords, setting: WorldSettings, generator: np.random.Generator) -> Posterior:
    """Return the posterior of the crash probability that the family of laws gives for some records."""
    fitter = Fitter(records, MEMBERS)
    family, boundary = fitter.fit(setting.family), region(records) * records.range_
    folds = contiguous_folds(records.size, BLOCKS)
    scores = HeldOut.of_family(fitter, family, folds).scores({"region": boundary}, THIN)["region"]
    table = pd.DataFrame(
        {
            "lead_speed": records.lead_speed,
            "inverse_range": 1 / records.range_,
            "inverse_ttc": records.closing_speed / records.range_,
        }
    )
    fitted = SmoothFamily(fitter, family, scores, {}, assign_segments(table, EDGES), TOP)
    draws = LawStudy.of_family(fitted, DRAWS, generator).draws(generator)
    return Posterior(draws.masses(setting.lines).sum(axis=1), draws.member)


def records_needed(judged: Judged, posterior: Posterior, size: int) -> float:
    """Return how many records would decide a criterion by the table ``deciding``; infinite if none would."""
    variances = variances_of(judged, posterior.member, 0.0, size)
    table = deciding_table(judged, variances, size, None, {})
    return float(table.set_index("effort").loc["records", "needed"])


def examine(number: int, world: World, setting: WorldSettings) -> dict[str, float | str]:
    """Return the verdicts in one world before and after the records that the table asked for."""
    stream = partial(child_generator, ROOT, "worlds", "deciding", number)
    before = answer_of(draw_records(world, setting, FEW, stream("few")), setting, stream("first"))
    limit = float(np.quantile(before.probabilities, MET))
    criterion = Criterion(f"{limit:.3g} per cut-in", limit, ENCOUNTER)
    judged = judge(criterion, before, FEW, {})
    truth = float(world.masses(setting.lines).sum())
    row = {"world": number, "truth": truth, "limit": limit, "met_before": judged.probability_met}
    row |= {"verdict_before": judged.verdict}
    if judged.verdict != UNDECIDED:
        return row
    needed = records_needed(judged, before, FEW)
    size = int(min(np.ceil(needed), MOST))
    after = answer_of(draw_records(world, setting, size, stream("many")), setting, stream("second"))
    met = float(np.mean(after.probabilities <= limit))
    return row | {
        "needed": needed,
        "simulated": size,
        "met_after": met,
        "verdict_after": verdict_of(met),
        "should_be_met": truth <= limit,
    }


def main() -> None:
    """Write a table with a row for each world."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=int, nargs=2, metavar=("FIRST", "END"), required=True)
    parser.add_argument("--setting", required=True)
    parser.add_argument("--output", required=True)
    arguments = parser.parse_args()
    setting = read_setting(arguments.setting)
    world = worlds(setting.family, setting.law)[KIND]
    rows = []
    for number in tqdm(range(*arguments.worlds), unit="world"):
        rows.append(examine(number, world, setting))
        write_csv(arguments.output, reproducible(pd.DataFrame(rows)))


if __name__ == "__main__":
    main()
