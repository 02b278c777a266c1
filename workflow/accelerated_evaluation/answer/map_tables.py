"""Tables that a crash map allows: calibration, thresholds, and shares of the crashes by size."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

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
from accelerated_evaluation.answer.posterior import Posterior
from accelerated_evaluation.answer.scores import HeldOut
from accelerated_evaluation.answer.variants import Streams, threshold_table
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.laws import Box, Law
from accelerated_evaluation.laws.draws import DrawnLaws, Draws, OneLaw
from accelerated_evaluation.laws.smooth.family import DistinctRecords, Member
from accelerated_evaluation.scenarios.protocol import Event, Scenario
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
    """Compare recorded and expected numbers for the weighted mean of all laws and for some single laws.

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
    tables = {TOGETHER: [recorded.assign(expected=study.mean(by_member)), *mean]}
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
        expected = {TOGETHER: study.mean(by_member)}
        expected |= {member.name: by_member[member.name] for member in shown_members(study)}
        expected[PAPER] = counts_by_fold(HeldOut.of_law(papers_law, records, folds))[0]
        rows += [
            {"law": law, "division": division} | fold_row(recorded, own) for law, own in expected.items()
        ]
    return pd.DataFrame(rows)


BLOCKS = (5_000, 15_000)  # consecutive records in a block; the longest are used for the factor
LEAST = 20  # number of records below which a dispersion says nothing


def block_counts(happened: NDArray[np.bool_], length: int) -> Array:
    """Return the numbers of events in blocks of consecutive records; a last shorter block is left out."""
    whole = happened[: happened.size // length * length]
    return whole.reshape(-1, length).sum(axis=1)


def dispersion(happened: NDArray[np.bool_], length: int) -> float:
    """Return variance / mean of the block counts, which is 1 for Poisson counts; NaN for few events."""
    if happened.sum() < LEAST or happened.size < 2 * length:
        return float("nan")
    counts = block_counts(happened, length)
    return float(counts.var(ddof=1) / counts.mean())


def level_factors(critical: NDArray[np.bool_], draws: int, generator: np.random.Generator) -> Array:
    """Draw the relative number of critical records by the Bayesian bootstrap of long blocks, (draws,)."""
    counts = block_counts(critical, min(BLOCKS[-1], max(critical.size // 10, 1)))
    shares = generator.dirichlet(np.ones(counts.size), draws)
    return shares @ counts / max(counts.mean(), np.finfo(float).tiny)


def near_miss_table(
    posteriors: Mapping[str, Posterior],
    replayed: Mapping[str, NDArray[np.bool_]],
    critical: NDArray[np.bool_],
    generator: np.random.Generator,
) -> pd.DataFrame:
    """Tabulate the 95 % intervals of events with and without the variation between blocks of records.

    The laws take records as independent of each other. Critical cut-ins are more frequent in some parts of
    the file than in others, so their number varies more than a Poisson number. Here every draw of a
    probability is multiplied by a random factor, the relative number of critical records in a Bayesian
    bootstrap of long blocks.

    ``critical`` marks the records near the events, as in the region in which laws are scored.
    ``dispersion_5000`` and ``dispersion_15000`` are those in blocks of so many records, and the limits with
    the variation between blocks begin with ``clustered``. The random factors are the same for all events.
    """
    factors = level_factors(critical, len(next(iter(posteriors.values())).probabilities), generator)
    rows = []
    for event, posterior in posteriors.items():
        clustered = replace(posterior, probabilities=posterior.probabilities * factors)
        happened = replayed[event]
        row = {"event": event, "recorded": int(happened.sum())}
        row |= {f"dispersion_{length}": dispersion(happened, length) for length in BLOCKS}
        row |= dict(zip(("low95", "high95"), posterior.interval(0.95), strict=True))
        row |= dict(zip(("clustered_low95", "clustered_high95"), clustered.interval(0.95), strict=True))
        rows.append(row)
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


COLUMNS = (
    "variable",
    "at_least",
    "below",
    "encounters",
    "crashes",
    "crash_probability",
    "impact_speed",
    "probability_above",
    "standard_error",
)


def crash_shares(
    scenario: Scenario,
    law: Law,
    vehicle: Vehicle,
    generator: np.random.Generator,
    *,
    simulations: int = 200_000,
) -> pd.DataFrame:
    """Return the crash probability in intervals of the absolute value of one variable, by crude Monte Carlo.

    The scenario specifies the variable and the edges of the intervals (`Scenario.divided_by`). The outcomes
    must contain an impact speed. A row has the ends of the interval, the last of which is infinite; the
    shares of all ``encounters`` and of all ``crashes`` in the interval; the ``crash_probability`` of an
    encounter in it; the median ``impact_speed`` [m/s] of its crashes; and ``probability_above``, the crash
    probability of an encounter with a value of at least ``at_least``, with its ``standard_error``. There are
    no rows if the scenario specifies no variable.
    """
    if scenario.divided_by is None:
        return pd.DataFrame(columns=list(COLUMNS))
    variable, edges = scenario.divided_by
    x = law.draw(simulations, generator)
    outcomes = vehicle.simulate(*scenario.to_inputs(x).T)
    crash = outcomes.crash
    size = np.abs(x[:, scenario.names.index(variable)])
    limits = np.array([0.0, *edges, np.inf])
    groups = np.digitize(size, limits[1:-1])
    drawn = np.bincount(groups, minlength=len(limits) - 1)
    crashed = np.bincount(groups, crash, minlength=len(limits) - 1)
    drawn_above, crashed_above = (np.cumsum(counts[::-1])[::-1] for counts in (drawn, crashed))
    impact = pd.Series(outcomes.impact_speed[crash]).groupby(groups[crash]).median()
    with np.errstate(divide="ignore", invalid="ignore"):  # if an interval has no encounters or no crashes
        above = crashed_above / drawn_above
        error = np.sqrt(above * (1 - above) / drawn_above)
        shares = (drawn / drawn.sum(), crashed / crashed.sum(), crashed / drawn)
    speeds = impact.reindex(range(len(drawn))).to_numpy(float)
    columns = (variable, limits[:-1], limits[1:], *shares, speeds, above, error)
    return pd.DataFrame(dict(zip(COLUMNS, columns, strict=True)))


POINTS = 20_000  # number of points with which the probability of a part of the encounters is estimated

Holds = Callable[[Array], NDArray[np.bool_]]
"""Returns whether each of n encounters, shape (n, d), belongs to the part, shape (n,)."""


@dataclass(frozen=True)
class Restricted:
    """A law given that a condition holds, for crude Monte Carlo; it has no map from normal scores."""

    law: Law
    holds: Holds
    share: float  # estimated probability of the condition

    @classmethod
    def of(cls, law: Law, holds: Holds, generator: np.random.Generator) -> Self:
        """Return the restricted law, with an estimate of the probability of the condition."""
        return cls(law, holds, float(holds(law.draw(POINTS, generator)).mean()))

    @property
    def box(self) -> Box:
        """The limits of the law."""
        return self.law.box

    def log_density(self, x: Array) -> Array:
        """Return the log density at points x, shape (n, d), or -inf at points that are not in the part."""
        return np.where(self.holds(x), self.law.log_density(x) - np.log(self.share), -np.inf)

    def draw(self, n: int, generator: np.random.Generator) -> Array:
        """Draw n points by rejection, shape (n, d)."""
        kept = np.empty((0, self.law.dimension))
        while len(kept) < n:
            x = self.law.draw(n, generator)
            kept = np.concatenate([kept, x[self.holds(x)]])
        return kept[:n]


def restricted(draws: DrawnLaws, holds: Holds, generator: np.random.Generator) -> DrawnLaws:
    """Return draws of joint laws given that a condition holds."""
    parts = [
        OneLaw(Restricted.of(law, holds, generator), name)
        for law, name in zip(draws.laws, draws.names, strict=True)
    ]
    return replace(draws, parts=parts)
