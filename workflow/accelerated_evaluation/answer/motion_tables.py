"""Table of what the other car does next: the crash probabilities of all vehicles."""

from collections.abc import Mapping
from copy import deepcopy

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.lead_motion import Means, MovingProblem, mirrored
from accelerated_evaluation.answer.weighted_family import WeightedLaws
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.laws.motion.ngsim import Ngsim
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.vehicles.moving import takes_motion
from accelerated_evaluation.vehicles.protocol import Vehicle

FEWEST = 30  # opening cut-ins that stand for their population
COLUMNS = ["vehicle", "gap", "cut_ins", "exact", "constant", "moving", "standard_error", "high95"]
COLUMNS += ["factor", "factor_error", "factor_half"]
# Opening cut-ins for each closing one in the Safety Pilot Model Deployment, if a study has no records of
# them: the paper counts 173,692 closing ones among 403,581 (section II). In NGSIM there are 38 for 43.
OPENING_PER_CLOSING = 403_581 / 173_692 - 1


def motion_table(
    vehicles: Mapping[str, Vehicle],
    maps: Mapping[str, CrashMap],
    weighted: WeightedLaws,
    opening: DistinctRecords,
    generator: np.random.Generator,
) -> pd.DataFrame:
    """Tabulate crash probabilities with a lead vehicle that changes its speed as in NGSIM.

    Parameters
    ----------
    vehicles, maps
        The vehicles by name, and their crash maps. Vehicles that cannot be given lead speeds over time are
        left out.
    weighted
        The laws; the one of the largest weight is used.
    opening
        Recorded cut-ins whose gap opens. If there are fewer than 30 of them, mirrored closing ones are used.
    generator
        Source of all randomness. Every vehicle gets the same random numbers.

    Returns
    -------
    pandas.DataFrame
        A row for each vehicle and kind of cut-in. Columns ``vehicle``; ``gap`` (closing, opening or all);
        ``cut_ins``, their share; the crash probabilities ``exact`` (from the map, of closing cut-ins),
        ``constant`` and ``moving`` (estimates), with the standard error of the last one and its upper 95 %
        limit; ``factor``, moving divided by constant, with its standard error; and ``factor_half``, the
        factor if all changes of speed were half as large.
    """
    records, family = weighted.records, weighted.family
    law = family.law(weighted.heaviest)
    has_opening = opening.size >= FEWEST
    ratio = opening.size / records.size if has_opening else OPENING_PER_CLOSING
    share, recorded = ratio / (1 + ratio), opening if has_opening else mirrored(records)
    rows = []
    for name, vehicle in vehicles.items():
        if not takes_motion(vehicle):
            continue
        lines = CrashLines.of(maps[name], records.lead_speed, support=records.support)
        exact = {"closing": lines.probability(family.ranges, law)}
        halves, wholes = (
            _kinds(
                MovingProblem(vehicle, maps[name], records, family.ranges, law, Ngsim(scale)),
                recorded,
                share,
                deepcopy(generator),
            )
            for scale in (0.5, 1.0)
        )
        cut_ins = {"closing": 1 - share, "opening": share, "all": 1.0}
        for gap, found in wholes.items():
            own = cut_ins[gap], exact.get(gap, np.nan), found.still, found.moved, found.error, found.limit
            rows.append((name, gap, *own, *found.factor(), halves[gap].factor()[0]))
    return pd.DataFrame(rows, columns=COLUMNS)


def _kinds(
    problem: MovingProblem, recorded: DistinctRecords, share: float, generator: np.random.Generator
) -> dict[str, Means]:
    """Return the estimates for closing, opening and all cut-ins."""
    closing, opening = problem.closing(generator), problem.opening(recorded, generator)
    return {"closing": closing, "opening": opening, "all": closing.together(opening, share)}
