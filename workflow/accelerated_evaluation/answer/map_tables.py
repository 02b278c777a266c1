"""Tables that a crash map of the vehicle under test allows: calibration, thresholds and places of crashes."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.by_map import thinned
from accelerated_evaluation.answer.calibration_table import NearMisses, calibration_table, shown_members
from accelerated_evaluation.answer.law_study import LawStudy
from accelerated_evaluation.answer.likeliest_crashes import largest_near
from accelerated_evaluation.answer.variants import threshold_table
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines, crash_places
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.laws.draws import Draws
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.scenarios.protocol import Event, Scenario
from accelerated_evaluation.vehicles.events import CRASH
from accelerated_evaluation.vehicles.protocol import Outcomes, Vehicle

DRAWN = 2000  # number of crashes that are drawn from each law


@dataclass(frozen=True)
class MapTables:
    """The laws of cut-ins, and the crash map of a vehicle, from which tables are computed."""

    scenario: Scenario
    study: LawStudy
    draws: Draws
    vehicle: Vehicle
    crash_map: CrashMap

    @property
    def records(self) -> DistinctRecords:
        """The distinct records."""
        return self.study.smooth.records

    @cached_property
    def replayed(self) -> Outcomes:
        """Outcomes of the records."""
        return self.vehicle.simulate(*self.records.cut_ins.T)

    def lines(self, event: Event = CRASH) -> CrashLines:
        """Return all lines of the map with the intervals of an event."""
        return CrashLines.of(self.crash_map, self.records.lead_speed, event, self.records.support)

    def thresholds(self, generator: np.random.Generator) -> pd.DataFrame:
        """Return the crash probability for each threshold of the laws; see `threshold_table`."""
        lines = thinned(self.lines(), self.vehicle, self.draws, generator)
        return threshold_table(self.study, lines, generator)

    def calibration(self) -> pd.DataFrame:
        """Return recorded and expected numbers of critical cut-ins; see `calibration_table`."""
        named = {self.scenario.event_in_words(event): event for event in sorted(self.crash_map.events)}
        recorded = {name: int(event.happens(self.replayed).sum()) for name, event in named.items()}
        return calibration_table(
            self.study, NearMisses(recorded, {name: self._by_law(event) for name, event in named.items()})
        )

    def _by_law(self, event: Event) -> dict[str, float]:
        smooth = self.study.smooth
        found = self.lines(event).probabilities(smooth.family, smooth.members)
        return {member.name: probability for member, probability in found.items()}

    def crash_places(self, generator: np.random.Generator) -> pd.DataFrame:
        """Return crashes drawn from each of the shown laws, and by how much they exceed the records.

        ``beyond_recorded`` is the closing speed minus the largest recorded closing speed at a similar range.
        """
        columns = ["lead_speed", "range", "closing_speed", "law", "beyond_recorded"]
        parts, lines, family = [pd.DataFrame(columns=columns)], self.lines(), self.study.smooth.family
        for member in shown_members(self.study):
            law = family.law(member)
            if (masses := lines.masses(family.ranges, law)).any():
                drawn: tuple[Array, ...] = crash_places(lines, masses, law, DRAWN, generator)
                part = pd.DataFrame(dict(zip(columns, drawn, strict=False)))
                beyond = part["closing_speed"] - largest_near(self.records, part["range"].to_numpy())
                parts.append(part.assign(law=member.name, beyond_recorded=beyond))
        return pd.concat(parts, ignore_index=True)
