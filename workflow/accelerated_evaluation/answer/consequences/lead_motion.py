"""Tables of the crash probability if the lead vehicle changes its speed (`answer.moving_problem`)."""

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.consequences.moving_problem import (
    DRAWS,
    FEWER,
    PLACES,
    RESAMPLED,
    MovingProblem,
    moving_problems,
)
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.laws.motion import LeadMotion
from accelerated_evaluation.laws.motion.ngsim import Ngsim
from accelerated_evaluation.laws.motion.recorded import Recorded
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.vehicles.protocol import Vehicle

FEWEST = 30  # smallest number of recorded opening cut-ins that are used
COLUMNS = ["vehicle", "gap", "cut_ins", "exact", "constant", "constant_error", "moving", "standard_error"]
COLUMNS += ["high95", "factor", "factor_error", "factor_half"]
# Number of opening cut-ins per closing cut-in, for studies without records of opening cut-ins. In the Safety
# Pilot Model Deployment, 173,692 of 403,581 cut-ins are closing (paper, section II). In NGSIM there are 38
# opening and 43 closing cut-ins.
OPENING_PER_CLOSING = 403_581 / 173_692 - 1
MOTION = "what the other car does next"


def mirrored(records: DistinctRecords) -> DistinctRecords:
    """Return closing cut-ins with the opposite sign of the closing speed.

    The negative closing speed is limited such that the speed of the host does not become negative.
    """
    return replace(records, closing_speed=np.maximum(-records.closing_speed, -records.lead_speed))


def motion_table(
    problems: Mapping[str, MovingProblem],
    opening: DistinctRecords,
    generator: np.random.Generator,
    motion: LeadMotion | None = None,
    resampled: Sequence[LeadMotion] = (),
) -> pd.DataFrame:
    """Tabulate the crash probabilities of vehicles if the lead vehicle changes its speed.

    ``motion`` is the law of lead motion, by default `Ngsim`, and ``resampled`` are the laws that are fitted
    to resampled profiles of speed. All vehicles and resampled laws get the same random numbers. If there are
    fewer than `FEWEST` opening cut-ins, closing ones with the opposite sign of the closing speed are used
    instead. The row of a vehicle and kind of cut-in (``gap``) has the crash probability with a constant lead
    speed, ``exact`` (from the crash map, only for closing cut-ins, see `MovingProblem.exact`) and
    ``constant`` (estimated, with ``constant_error``); with a changing lead speed, ``moving``;
    ``factor``, moving divided by constant; and ``factor_half``, the factor if all changes of speed are
    halved, which is known for closing cut-ins and `Ngsim` only. With too few crashes of opening cut-ins,
    ``moving`` is NaN, and only its one-sided 95 % limit ``high95`` is known. ``factor_error`` is the standard
    error of the factor. It contains the error of the simulation and, for closing cut-ins, the spread of the
    factors of the resampled laws.
    """
    rows = []
    for name, problem in problems.items():
        records = problem.records
        has_opening = opening.size >= FEWEST
        ratio = opening.size / records.size if has_opening else OPENING_PER_CLOSING
        share, recorded = ratio / (1 + ratio), opening if has_opening else mirrored(records)
        exacts = {"closing": problem.exact}
        motions = [Ngsim(), Ngsim(0.5)] if motion is None else [motion]
        stream = deepcopy(generator)
        whole, *halves = problem.closing_with(motions, stream)
        opens = problem.opening(recorded, motions[0], stream)
        wholes = {"closing": whole, "opening": opens, "all": whole.together(opens, share)}
        fewer = PLACES // FEWER  # the spread of the factors is larger than their errors
        spread = problem.closing_with(resampled, deepcopy(generator), fewer) if resampled else []
        factors = [each.factor()[0] for each in spread]
        cut_ins = {"closing": 1 - share, "opening": share, "all": 1.0}
        for gap, found in wholes.items():
            still_error, moved_error = found.errors
            constant = exacts.get(gap, np.nan), found.still, still_error
            own = cut_ins[gap], *constant, found.moved, moved_error, found.limit
            factor, error = found.factor()
            if factors and gap == "closing":
                error = float(np.hypot(error, np.std(factors, ddof=1)))
            half = halves[0].factor()[0] if halves and gap == "closing" else np.nan
            rows.append((name, gap, *own, factor, error, half))
    return pd.DataFrame(rows, columns=COLUMNS)


def motion_budget(moving: pd.DataFrame, vehicle: str, together: float) -> pd.DataFrame:
    """Return the contribution of the unknown lead motion to the budget of the answer.

    Lead motion multiplies the crash probability by a factor. The law of motion was fitted to all cars. It is
    not known whether cars that have just changed lane change their speed as much as other cars. The changes
    of speed are therefore multiplied by a scale that is uniform from 0 to 1. The logarithm of the factor, as
    a function of the scale, is interpolated by a parabola through its values at 0, 1/2 and 1. Its variance is
    the contribution. ``together`` is the factor, exp(standard deviation of the log probability), of all other
    sources together. The ``variance_share`` is relative to their variance, and ``effect`` is the factor of
    the probability for the scale 1. There is no row if the vehicle is not in the table or never crashes.
    """
    own = moving[(moving["vehicle"] == vehicle) & (moving["gap"] == "closing")]
    own = own[(own["factor"] > 0) & (own["factor_half"] > 0)]
    half, whole = (np.log(own[name].astype(float)) for name in ("factor_half", "factor"))
    slope, bend = 4 * half - whole, 2 * whole - 4 * half
    # For a uniform variable s on [0, 1]: var(s) = 1/12, var(s^2) = 4/45, cov(s, s^2) = 1/12.
    variance = (
        slope**2 / 12 + slope * bend / 6 + 4 * bend**2 / 45 + (own["factor_error"] / own["factor"]) ** 2
    )
    return pd.DataFrame(
        {
            "source": MOTION,
            "factor": np.exp(np.sqrt(variance)),
            "variance_share": variance / np.log(together) ** 2,
            "effect": own["factor"],
        }
    )


def motion_tables(
    vehicles: Mapping[str, Vehicle],
    maps: Mapping[str, CrashMap],
    study: LawStudy,
    opening: DistinctRecords,
    europe: Recorded,
    generators: Callable[..., np.random.Generator],
) -> dict[str, pd.DataFrame]:
    """Return the table of `motion_table` with American and with European lead motion, by name.

    The error of the European motion is that of laws fitted to resampled profiles. ``generators`` returns a
    generator for the names of a step.
    """
    stream = generators("resampled profiles")
    laws = max(2, round(RESAMPLED * len(study.weights) / DRAWS))  # two for a spread
    resampled = [europe.resampled(stream) for _ in range(laws)]
    problems = moving_problems(vehicles, maps, study)
    tables = {
        name: motion_table(problems, opening, generators(), *motion)
        for name, motion in {"NGSIM": (), "Europe": (europe, resampled)}.items()
    }
    return {
        name: table.assign(vehicle=table["vehicle"].replace("under_test", "under test"))
        for name, table in tables.items()
    }
