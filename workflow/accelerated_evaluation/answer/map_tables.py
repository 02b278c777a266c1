"""Tables that a crash map allows: calibration, thresholds, and shares of the crashes by size."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.by_map import thinned_lines
from accelerated_evaluation.answer.calibration import (
    DIVISIONS,
    TENTHS,
    counts_by_fold,
    fold_row,
    near_miss_counts,
    recorded_by_fold,
    recorded_counts,
    with_poisson_limits,
)
from accelerated_evaluation.answer.law_study import LawStudy
from accelerated_evaluation.answer.law_table import KNOT, PAPER, TOGETHER, papers_law
from accelerated_evaluation.answer.near_misses import near_miss_table
from accelerated_evaluation.answer.posterior import Posterior
from accelerated_evaluation.answer.scores import HeldOut
from accelerated_evaluation.answer.variants import Streams, threshold_table
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.laws.draws import Draws
from accelerated_evaluation.laws.smooth.family import DistinctRecords, Member
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.protocol import CRASH, Outcomes, Vehicle

SHOWN = (Member(), *(Member(KNOT, shape) for shape in ("exponential", "generalised", "two kinds")))


@dataclass(frozen=True)
class NearMisses:
    """Crashes and near misses of the replayed records."""

    # Number of distinct records that end in each event if the vehicle replays them.
    recorded: Mapping[str, int]
    # Probability of each event, by its name, under each law.
    probabilities: Mapping[str, Mapping[str, float]]
    # Probability of each event, by its name, averaged over the draws of the answer.
    together: Mapping[str, float]


def shown_members(study: LawStudy) -> tuple[Member, ...]:
    """Return the smooth laws that tables list individually, if there were enough records to fit them."""
    return tuple(member for member in SHOWN if member in study.smooth.members)


def calibration_table(study: LawStudy, near: NearMisses | None = None) -> pd.DataFrame:
    """Compare recorded and expected numbers for the weighted mean of the smooth laws and for some of them.

    The numbers are those of cut-ins in cells, of range and closing speed or of lead speed and host speed. The
    expected numbers are those under laws that were fitted without the block of the records; only those of
    near misses are under laws that were fitted to all records, and for the weighted mean those of the answer,
    which averages over draws of the parameters. The table has a row for each law and cell, and
    for each event of ``near``, which is None if the records are not replayed: the cell ``where``, the speed
    that divides the cells (``counted``), and the columns of `with_poisson_limits`.
    """
    smooth, records = study.smooth, study.smooth.records
    recorded = recorded_counts(records)

    def near_misses(probability: Mapping[str, float]) -> list[pd.DataFrame]:
        return [] if near is None else [near_miss_counts(near.recorded, probability, records.size)]

    by_event = {} if near is None else near.probabilities
    by_member = dict(zip(smooth.names, smooth.expected[TENTHS].sum(axis=1), strict=True))
    mean = near_misses({} if near is None else near.together)
    tables = {TOGETHER: [recorded.assign(expected=study.without_added.mean(by_member)), *mean]}
    for member in shown_members(study):
        of_member = {name: values[member.name] for name, values in by_event.items()}
        of_cells = recorded.assign(expected=by_member[member.name])
        tables[member.name] = [of_cells, *near_misses(of_member)]
    independent = HeldOut.of_law(papers_law, records)
    tables[PAPER] = [recorded.assign(expected=counts_by_fold(independent)[0].sum(axis=0))]
    rows = [
        with_poisson_limits(pd.concat(parts, ignore_index=True)).assign(law=law)
        for law, parts in tables.items()
    ]
    return pd.concat(rows, ignore_index=True)


def fold_calibration(study: LawStudy) -> pd.DataFrame:
    """Compare recorded and expected numbers of the cells of the cut-ins by fold, for each way to divide them.

    There is a row for each ``law`` of `calibration_table` and each ``division`` of the records (`DIVISIONS`),
    with the columns of `fold_row`.
    """
    smooth, records = study.smooth, study.smooth.records
    rows = []
    for division, divide in DIVISIONS.items():
        folds = divide(records.size)
        recorded = recorded_by_fold(records, folds)
        by_member = dict(zip(smooth.names, smooth.expected[division], strict=True))
        expected = {TOGETHER: study.without_added.mean(by_member)}
        expected |= {member.name: by_member[member.name] for member in shown_members(study)}
        expected[PAPER] = counts_by_fold(HeldOut.of_law(papers_law, records, folds))[0]
        rows += [
            {"law": law, "division": division} | fold_row(recorded, own) for law, own in expected.items()
        ]
    return pd.DataFrame(rows)


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
        return self.vehicle.simulate(*self.records.x.T)

    def lines(self, event: Event = CRASH) -> CrashLines:
        """Return all lines of the map with the intervals of an event."""
        return CrashLines.of(self.crash_map, self.records.lead_speed, event, self.records.support)

    def thresholds(self, streams: Streams) -> pd.DataFrame:
        """Return the crash probability for each threshold of the laws; see `threshold_table`."""
        lines = thinned_lines(self.lines(), self.vehicle, self.draws, streams("answer"))
        return threshold_table(self.study, lines, streams)

    def calibration(self, posteriors: Mapping[Event, Posterior]) -> pd.DataFrame:
        """Return recorded and expected numbers of critical cut-ins; see `calibration_table`.

        ``posteriors`` are those of the answer, by event.
        """
        named = {self.scenario.event_in_words(event): event for event in sorted(posteriors)}
        recorded = {name: int(event.happens(self.replayed).sum()) for name, event in named.items()}
        by_law = {name: self._by_law(event) for name, event in named.items()}
        together = {name: posteriors[event].probabilities.mean() for name, event in named.items()}
        return calibration_table(self.study, NearMisses(recorded, by_law, together))

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
