"""The whole chain of a study: from a recording of a world to the number of crashes in all its other hours.

``accelerated-evaluation extract`` has found the cut-ins in the recording. The laws of the study and the law
of lead motion are fitted to them. The prediction is an interval: laws are drawn with their weights and
parameters, cut-ins and lead motions from each of them, and the hosts are simulated.
"""

import argparse
from collections.abc import Iterator

import numpy as np
import pandas as pd
from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.candidates.smooth_family import SmoothFamily
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.distributions import Empirical
from accelerated_evaluation.laws.motion import MOTIONS, LeadMotion, draw_lead_speeds
from accelerated_evaluation.laws.motion.recorded import Recorded, recorded_courses
from accelerated_evaluation.laws.smooth.draws import SmoothDraws
from accelerated_evaluation.laws.smooth.family import DistinctRecords, members_at
from accelerated_evaluation.laws.smooth.mean import MeanStratum
from accelerated_evaluation.scenarios.cut_in import SPEED_LIMIT
from hosts import encounters_of, hosts, kept
from scipy.stats import poisson
from traffic import run_command

MEMBERS = members_at((0.9, 0.95))  # fewer thresholds than in the study, as there are fewer records
DRAWS = 100  # of the laws
CUT_INS = 5000  # drawn from each of them
BLOCK = 60.0  # [s]; crashes in different minutes are nearly independent
FEWEST_BLOCKS = 5  # from which intervals are predicted
FEWEST_RECORDS = 100  # from which laws are fitted: ten of them exceed the lowest threshold
LEVELS = {"low95": 0.025, "low80": 0.1, "median": 0.5, "high80": 0.9, "high95": 0.975}


def drawn_cut_ins(study: LawStudy, generator: np.random.Generator) -> Iterator[Array]:
    """Yield cut-ins of laws drawn with their weights and parameters, shape (3, CUT_INS).

    Tails that are fitted to few records also give closing speeds above `SPEED_LIMIT`, which no vehicle
    accepts. They are replaced by it.
    """
    records, draws = study.smooth.records, study.draws(generator).draws
    recorded = Empirical(records.lead_speed)
    for shared, speeds in zip(draws.shared, draws.laws, strict=True):
        lead_speed = generator.choice(records.lead_speed, CUT_INS)
        alone = SmoothDraws.of_laws(draws.ranges[shared], [speeds], records.support)
        stratum = MeanStratum(recorded, alone)
        drawn = stratum.points(lead_speed, *generator.standard_exponential((2, CUT_INS)))
        yield np.minimum(drawn, [np.inf, np.inf, SPEED_LIMIT]).T


def resampled(records: pd.DataFrame, generator: np.random.Generator) -> pd.DataFrame:
    """Return the records of minutes that are drawn with replacement.

    Cut-ins of the same minute share a state of the traffic, such as a wave of congestion. If single cut-ins
    were drawn with replacement, the results would vary too little.
    """
    blocks = [rows for _, rows in records.groupby(records["time"] // BLOCK)]
    return pd.concat([blocks[block] for block in generator.integers(len(blocks), size=len(blocks))])


def are_enough(records: pd.DataFrame) -> bool:
    """Return whether the records are enough for laws and intervals."""
    blocks = (records["time"] // BLOCK).nunique()
    return len(records) >= FEWEST_RECORDS and blocks >= FEWEST_BLOCKS


def probabilities(records: pd.DataFrame, generator: np.random.Generator) -> pd.DataFrame:
    """Return crash probabilities of a cut-in by the law drawn.

    The law of lead motion of each draw is fitted to `resampled` records, so that the draws include the
    uncertainty in this law.

    Parameters
    ----------
    records
        Cut-ins with courses that the filters of the study keep.
    generator
        Source of all randomness.

    Returns
    -------
    pandas.DataFrame
        A row for each host and draw: ``host``, ``snapshot``, with a constant lead speed, and ``recorded``,
        with lead motion.
    """
    family = SmoothFamily.of(DistinctRecords.of(records), MEMBERS)
    study = LawStudy.of_family(family, DRAWS, generator)
    constant, cars, rows = MOTIONS["constant"](), hosts(generator), []
    for cut_ins in drawn_cut_ins(study, generator):
        moving = Recorded.of(resampled(records, generator))
        motions: dict[str, LeadMotion] = {"snapshot": constant, "recorded": moving}
        speeds = {name: draw_lead_speeds(motion, cut_ins, generator) for name, motion in motions.items()}
        for host, car in cars.items():
            crashes = {
                name: car.simulate_moving(*cut_ins, each).crash.mean() for name, each in speeds.items()
            }
            rows.append({"host": host} | crashes)
    return pd.DataFrame(rows)


def chain(records: pd.DataFrame, cut_ins: pd.DataFrame, generator: np.random.Generator) -> pd.DataFrame:
    """Predict the number of crashes among the cut-ins of a world from records of it, and count them.

    Only cut-ins that the filters of the study keep are counted: the gap closes, and range and lead speed are
    within the limits.

    Returns
    -------
    pandas.DataFrame
        A row for each host and prediction (``snapshot`` and ``recorded``): number of ``records`` and of
        ``cut_ins``, ``counted`` crashes, and median and ends of the 80 and 95 % intervals of the predicted
        count, which include Poisson variation. Median and ends are NaN if the records are not enough; see
        `are_enough`.
    """
    records, cut_ins = kept(records), kept(cut_ins)
    found = probabilities(records, generator) if are_enough(records) else None
    courses, rows = recorded_courses(cut_ins), []
    for host, car in hosts(generator).items():
        counted = int(car.simulate_moving(*encounters_of(cut_ins), courses).crash.sum())
        for prediction in ("snapshot", "recorded"):
            ends = dict.fromkeys(LEVELS, np.nan)
            if found is not None:
                expected = found.loc[found["host"] == host, prediction].to_numpy() * len(cut_ins)
                possible = poisson.rvs(expected, random_state=generator)
                ends = dict(zip(LEVELS, np.quantile(possible, list(LEVELS.values())), strict=True))
            known = {"records": len(records), "cut_ins": len(cut_ins), "counted": counted}
            rows.append({"host": host, "prediction": prediction} | known | ends)
    return pd.DataFrame(rows)


def main() -> None:
    """Predict the crashes of one world."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cut_ins", nargs="+", help="Parquet files of the cut-ins whose crashes are counted")
    parser.add_argument("--records", required=True, help="Parquet file of the cut-ins that extract found")
    parser.add_argument("--seed", type=int, required=True, help="root of all random numbers")
    parser.add_argument("--world", type=int, required=True, help="number of the world")
    parser.add_argument("--output", required=True)
    arguments = parser.parse_args()
    cut_ins = pd.concat(map(pd.read_parquet, arguments.cut_ins), ignore_index=True)
    generator = child_generator(arguments.seed, "motorway", "chain", arguments.world)
    table = chain(pd.read_parquet(arguments.records), cut_ins, generator)
    table.insert(0, "world", arguments.world)
    write_csv(arguments.output, table)


if __name__ == "__main__":
    run_command(main)
