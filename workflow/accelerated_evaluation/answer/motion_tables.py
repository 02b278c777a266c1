"""The table of crash probabilities of all vehicles if the lead vehicle changes its speed."""

from collections.abc import Mapping
from copy import deepcopy

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.law_study import LawStudy
from accelerated_evaluation.answer.lead_motion import Means, MovingProblem, mirrored
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.laws.motion.ngsim import Ngsim
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.vehicles.moving import takes_motion
from accelerated_evaluation.vehicles.protocol import Vehicle

FEWEST = 30  # smallest number of recorded opening cut-ins that are used
COLUMNS = ["vehicle", "gap", "cut_ins", "exact", "constant", "moving", "standard_error", "high95"]
COLUMNS += ["factor", "factor_error", "factor_half"]
# Number of opening cut-ins per closing cut-in, for studies without records of opening cut-ins. In the Safety
# Pilot Model Deployment, 173,692 of 403,581 cut-ins are closing (paper, section II). In NGSIM there are 38
# opening and 43 closing cut-ins.
OPENING_PER_CLOSING = 403_581 / 173_692 - 1


def motion_table(
    vehicles: Mapping[str, Vehicle],
    maps: Mapping[str, CrashMap],
    study: LawStudy,
    opening: DistinctRecords,
    generator: np.random.Generator,
) -> pd.DataFrame:
    """Tabulate the crash probabilities of vehicles if the lead vehicle changes its speed as in NGSIM.

    The law with the largest weight is used, and all vehicles get the same random numbers. Vehicles that
    cannot be simulated with a changing lead speed are left out. If there are fewer than `FEWEST` opening
    cut-ins, closing ones with the opposite sign of the closing speed are used instead. The row of a vehicle
    and kind of cut-in (``gap``) has the crash probability with a constant lead speed, ``exact`` (from the
    crash map, only for closing cut-ins) and ``constant`` (estimated); with a changing lead speed, ``moving``;
    ``factor``, moving divided by constant; and ``factor_half``, the factor if all changes of speed are
    halved.
    """
    records, family = study.smooth.records, study.smooth.family
    law = study.smooth.speeds(study.heaviest)
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
