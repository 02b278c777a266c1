"""What the other car does next: the crash probability if the lead vehicle changes its speed.

The crash map is for a lead vehicle that keeps its speed. If it does not, crashes happen near the boundary of
the map, and more rarely far from it. The closing speeds of each line of the map are therefore divided into
strata by their distance from the boundary. The probability of a stratum under a law is exact. From each
stratum cut-ins are drawn by the law, each with a drawn lead motion, and simulated. The sum over the strata of
probability times share of crashes is an unbiased estimate of the crash probability, in which the rare and
dangerous strata are oversampled.

Cut-ins whose gap opens cannot crash while the lead vehicle keeps its speed, and are not in the records. They
are represented by recorded cut-ins whose closing speed has the other sign.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.weighted_family import WeightedLaws
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines, crash_places
from accelerated_evaluation.crash_map.maps import CrashMap, Intervals
from accelerated_evaluation.laws.motion import LeadMotion, draw_lead_speeds
from accelerated_evaluation.laws.smooth.conditional import SpeedLaw
from accelerated_evaluation.vehicles.builtin.moving import MovingVehicle
from accelerated_evaluation.vehicles.events import CRASH

DISTANCES = (0.0, 1.5, 4.0, 9.0)  # [m/s], from the smallest closing speed that crashes down to each stratum
SIZES = (20_000, 20_000, 20_000, 40_000, 120_000)  # of the strata; the last one is the rest
AT_ONCE = 20_000  # bounds the memory: 100 MB
OPENING = 100_000
OPENING_PER_CLOSING = 38 / 43  # NGSIM, US-101 and I-80
COLUMNS = ["vehicle", "exact", "constant", "moving", "standard_error", "factor", "opening", "opening_error"]


@dataclass(frozen=True)
class MovingProblem:
    """The question how often a vehicle crashes if the lead vehicle changes its speed.

    Attributes
    ----------
    vehicle
        The vehicle.
    weighted
        The laws; the one of the largest weight is used.
    motion
        The law of lead motion.
    generator
        Source of all randomness.
    """

    vehicle: MovingVehicle
    weighted: WeightedLaws
    motion: LeadMotion
    generator: np.random.Generator

    @property
    def law(self) -> SpeedLaw:
        """The law of the largest weight."""
        return self.weighted.family.law(self.weighted.heaviest)

    def closing(self, crash_map: CrashMap) -> tuple[float, float, float]:
        """Return the crash probability of a cut-in whose gap closes.

        Parameters
        ----------
        crash_map
            Map of the vehicle for a lead vehicle that keeps its speed.

        Returns
        -------
        constant, moving, standard_error : float
            Estimates with a lead vehicle that keeps its speed and with one that changes it, from the same
            cut-ins, and the standard error of the second.
        """
        records, ranges = self.weighted.records, self.weighted.family.ranges
        constant, moving, variance = 0.0, 0.0, 0.0
        for stratum, size in zip(strata(crash_map), SIZES, strict=True):
            lines = CrashLines.of(stratum, records.lead_speed, support=records.support)
            if not (mass := lines.probability(ranges, self.law)):
                continue
            parts = [
                self._shares(crash_places(lines, ranges, self.law, each, self.generator))
                for each in np.full(size // AT_ONCE, AT_ONCE)
            ]
            still, moved = np.mean(parts, axis=0)
            constant += mass * still
            moving += mass * moved
            variance += mass**2 * moved * (1 - moved) / size
        return constant, moving, float(np.sqrt(variance))

    def opening(self) -> tuple[float, float]:
        """Return the crash probability of a cut-in whose gap opens, and its standard error."""
        records = self.weighted.records
        shares = []
        for _ in range(OPENING // AT_ONCE):
            row = self.generator.integers(records.size, size=AT_ONCE)
            lead_speed = records.lead_speed[row]
            opening = np.maximum(-records.closing_speed[row], -lead_speed)
            shares.append(self._shares((lead_speed, records.range_[row], opening))[1])
        share = float(np.mean(shares))
        return share, float(np.sqrt(share * (1 - share) / OPENING))

    def _shares(self, cut_ins: tuple[Array, Array, Array]) -> tuple[float, float]:
        """Return the shares of cut-ins that crash with a constant and with a changing lead speed."""
        speeds = draw_lead_speeds(self.motion, np.stack(cut_ins), self.generator)
        still = self.vehicle.simulate(*cut_ins).crash.mean()
        return float(still), float(self.vehicle.simulate_moving(*cut_ins, speeds).crash.mean())


def strata(crash_map: CrashMap) -> Iterator[CrashMap]:
    """Yield maps whose events are strata of the closing speed, which together contain every cut-in once.

    The first contains the closing speeds above the smallest one that crashes, the next ones those that are
    below it by `DISTANCES`, and the last one all others.
    """
    intervals, lines = crash_map.intervals(CRASH), crash_map.lead_speed.size
    first = np.full(lines, np.inf)
    np.minimum.at(first, intervals.line, intervals.start)
    edges = [np.full(lines, np.inf), *(np.maximum(first - distance, 0.0) for distance in DISTANCES)]
    for above, below in zip(edges, [*edges[1:], np.zeros(lines)], strict=True):
        line = np.flatnonzero(below < above)
        part = Intervals(line.astype(np.int32), below[line], above[line])
        yield replace(crash_map, events={CRASH: part})


def motion_table(
    vehicles: Mapping[str, object],
    maps: Mapping[str, CrashMap],
    weighted: WeightedLaws,
    motion: LeadMotion,
    generator: np.random.Generator,
) -> pd.DataFrame:
    """Tabulate crash probabilities with a lead vehicle that changes its speed.

    Parameters
    ----------
    vehicles, maps
        The vehicles by name, and their crash maps. Vehicles that do not take lead speeds are left out.
    weighted, motion, generator
        As in `MovingProblem`.

    Returns
    -------
    pandas.DataFrame
        Columns ``vehicle``; of closing cut-ins under the law of the largest weight ``exact`` (from the map),
        ``constant`` and ``moving`` (estimates), ``standard_error`` of the last one and ``factor``, moving
        divided by constant; and ``opening``, the crash probability of an opening cut-in, with its standard
        error ``opening_error``.
    """
    rows = []
    for name, vehicle in vehicles.items():
        if not isinstance(vehicle, MovingVehicle):
            continue
        problem = MovingProblem(vehicle, weighted, motion, generator)
        records = weighted.records
        lines = CrashLines.of(maps[name], records.lead_speed, support=records.support)
        exact = lines.probability(weighted.family.ranges, problem.law)
        constant, moving, error = problem.closing(maps[name])
        factor = moving / constant if constant else np.nan
        rows.append((name, exact, constant, moving, error, factor, *problem.opening()))
    return pd.DataFrame(rows, columns=COLUMNS)
