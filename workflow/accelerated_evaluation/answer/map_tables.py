"""Tables that a crash map of the vehicle under test allows: calibration, thresholds and places of crashes."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.by_map import thinned
from accelerated_evaluation.answer.calibration_table import NearMisses, calibration_table
from accelerated_evaluation.answer.law_study import LawStudy
from accelerated_evaluation.answer.near_misses import near_miss_table
from accelerated_evaluation.answer.posterior import Posterior
from accelerated_evaluation.answer.variants import threshold_table
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.laws.draws import Draws
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.scenarios.protocol import Event, Scenario
from accelerated_evaluation.vehicles.events import CRASH
from accelerated_evaluation.vehicles.protocol import Outcomes, Vehicle


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

    def near_misses(
        self, posteriors: Mapping[Event, Posterior], generator: np.random.Generator
    ) -> pd.DataFrame:
        """Return intervals of the near misses that allow for clusters of critical records."""
        named = {self.scenario.event_in_words(event): event for event in posteriors}
        replayed = {name: event.happens(self.replayed) for name, event in named.items()}
        own = {name: posteriors[event] for name, event in named.items()}
        return near_miss_table(own, replayed, self.study.smooth.resampled, generator)
