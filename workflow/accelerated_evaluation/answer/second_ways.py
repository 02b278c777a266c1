"""A second way to the numbers of a study: each of them again, without crash map, search or surrogate.

Encounters are drawn from a wide density that knows nothing of a vehicle. All vehicles are simulated in the
same encounters, so every probability under every draw of the law is a weighted mean, and every published
number is a statistic of these means (`StudyNumbers`). The encounters are scrambled Sobol points in
independent batches. Each number has an error from balanced halves of the batches (McCarthy 1969), which is
consistent for quantiles, too; a jackknife that leaves out one batch is not.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Self

import numpy as np
import pandas as pd
import scipy  # loads scipy.stats where it is used; see `answer.candidates.calibration`
from numpy.typing import NDArray
from scipy.linalg import hadamard
from scipy.special import ndtri

from accelerated_evaluation.answer.candidates.fitted_records import FittedRecords
from accelerated_evaluation.answer.consequences.counted_crashes import (
    HUNDRED_CAR_MILES,
    HUNDRED_CAR_MOST,
    KILOMETRES_PER_MILE,
)
from accelerated_evaluation.answer.consequences.human_prediction import CLOSING as SHARE_CLOSING
from accelerated_evaluation.answer.consequences.human_prediction import (
    KILOMETRES,
    LANE_CHANGES_A_MILE,
    SEVERE,
    BrakingHuman,
    G,
)
from accelerated_evaluation.answer.consequences.injuries.curves import FRONTAL, LEVELS, REAR
from accelerated_evaluation.answer.consequences.injuries.tables import (
    RISKS,
    SPEEDS,
    gentle,
    mean_risks,
)
from accelerated_evaluation.answer.consequences.injuries.tables import Key as RiskKey
from accelerated_evaluation.answer.consequences.rates import UNITS
from accelerated_evaluation.answer.consequences.total import SIZE as VALUES
from accelerated_evaluation.answer.study_tables import UNDER_TEST
from accelerated_evaluation.answer.ways.answer import Answer
from accelerated_evaluation.answer.ways.by_map import MapCrashes
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.files import write_arrays
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.lines import PARTS
from accelerated_evaluation.laws.draws import Draws
from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.builtin.human import Human
from accelerated_evaluation.vehicles.protocol import RandomVehicle, Vehicle, simulate_inner

DRIVERS = 4  # number of drivers in each encounter: most crashes are those of very few of them
BATCHES, SIZE = 32, 2**13  # number of independent batches (a power of 2), and of the encounters in each
FINER = 8  # times as many encounters under the paper's law, which is only one
DOUBTFUL = 3.0  # number of errors from which on there is a reason beside the difference
LARGE = 4.0  # number of errors that chance does not explain
NEAREST = 0.02  # [m], smallest range of a cut-in that is drawn; nearly no cut-in of any law is nearer
CAP = float(SPEEDS[-1])  # [m/s], on the closing speed: at larger impact speeds no risk changes
# Shares and means [m/s] of the exponential closing speeds; the other cut-ins are at the cap.
CLOSING = ((0.48, 2.0), (0.5, 10.0))
SHARES = ("safer", "human_safer", "fewer_injured")  # shares of draws, which change in steps
TINY = np.finfo(float).tiny ** 0.5  # error of two numbers that have none
RATES = 9  # number of equally likely rates of encounters
NONE_OF_MANY = 3.0  # upper 95 % limit of the mean of a Poisson distribution if the count is 0
LARGEST = 0.1  # relative error above which a second number is not known
ROUNDING = 1e-6  # relative difference of numbers that count as equal

PLAIN, COUNT, FORM = "plain importance sampling", "replay of the records", "closed form"
NONE = "no second way"
CHANCE = "chance: of so many differences, a few exceed three errors"
# Columns that name a row, by table of the study.
ROWS: dict[str, tuple[str, ...]] = {
    "answer": ("event",),
    "near_misses": ("event",),
    "exposure": ("event", "per"),
    "vehicles": ("vehicle",),
    "compared": ("other",),
    "injuries": ("vehicle", "level", "per"),
    "injuries_by_curve": ("vehicle", "level", "frontal", "rear"),
    "risk_balance": ("vehicle", "reference", "level"),
    "counted_crashes": ("who", "what"),
    "human_predictions": ("driver", "event"),
    "lead_motion": ("vehicle", "gap"),
    "lead_motion_europe": ("vehicle", "gap"),
    "all_cut_ins": ("vehicle", "part", "per"),
    "exact": ("segment",),
    "severity": ("segment", "quantity", "threshold"),
    "impact_speed": ("segment",),
}
COLUMNS = ["table", "row", "column", "number", "error", "second", "second_error", "mechanism"]
COLUMNS += ["difference", "reason"]

ENDS = (("low", -1), ("high", 1))
QUANTILES = {"median": 0.5} | {
    f"{end}{level}": 0.5 + sign * level / 200 for level in (50, 80, 95) for end, sign in ENDS
}
MOTIONS = "NGSIM", "Europe"  # sources of lead motion
BRAKING = "human drivers"  # whose hard braking is an event
HARD = [CUT_IN.events[0], *(CUT_IN.event("impact_speed", G * level) for level in SEVERE.values())]

Key = tuple[str, str, str]  # table, row, column
Features = Iterator[tuple[str, Array, Callable[[NDArray[np.intp]], Array] | None]]
"""Name of a vehicle, its features, (n, m), and None or a function that returns further weights, (K, k), of
the encounters with the given k indices."""
Means = Mapping[str, Array]
"""Probabilities, and means of risks, of each vehicle under each of K draws, shape (K, m) each."""


@dataclass(frozen=True)
class WideCutIns:
    """Cut-ins with recorded lead speeds, all ranges, and closing speeds up to a cap."""

    lead_speed: Array  # the recorded values [m/s], shape (records,)
    range_max: float  # [m]
    cap: float  # [m/s]; the laws have a probability at this closing speed

    dimension = 5

    def points(self, u: Array) -> tuple[Array, Array]:
        """Map uniform numbers, (n, 5), to cut-ins, (n, 3), with the log of their density given v_L, (n,).

        Half of the ranges are uniform, and half are uniform on a logarithmic scale. Slow lead vehicles are
        drawn more often, because under unlikely laws most crashes are theirs.
        """
        lead = np.sort(self.lead_speed)[(u[:, 0] ** 2 * self.lead_speed.size).astype(int)]
        width, length = np.log(self.range_max / NEAREST), self.range_max - NEAREST
        near = NEAREST * np.exp(u[:, 1] * width)
        range_ = np.where(u[:, 4] < 0.5, near, NEAREST + u[:, 1] * length)
        bounds = np.cumsum([share for share, _ in CLOSING])
        means = np.array([*(mean for _, mean in CLOSING), np.inf])[np.searchsorted(bounds, u[:, 2])]
        exponential = -np.log1p(-u[:, 3])
        closing = np.where(np.isinf(means), self.cap, np.minimum(means * exponential, self.cap))
        below = sum(share / mean * np.exp(-closing / mean) for share, mean in CLOSING)
        capped = 1 - bounds[-1] + sum(share * np.exp(-self.cap / mean) for share, mean in CLOSING)
        density = np.where(closing >= self.cap, capped, below) * 0.5 * (1 / (range_ * width) + 1 / length)
        return np.column_stack([lead, range_, closing]), np.log(density) - np.log(2 * u[:, 0])


@dataclass(frozen=True)
class Plain:
    """Means of features of encounters under K laws, by independent batches."""

    sums: Mapping[str, Array]  # mean of the features of each vehicle in each batch, (batches, K, m)
    # Whether the second half of the batches are the partners of the first half; see `CrashLines.summed`.
    paired: bool = False

    @classmethod
    def of(
        cls,
        wide: WideCutIns,
        density: Callable[[Array], Array],
        features: Callable[[Array], Features],
        generator: np.random.Generator,
        finer: int = 1,
    ) -> Self:
        """Draw the encounters of all batches, and weight their features by the density of each law.

        There are ``finer`` times as many as usual. ``density`` returns the log density of n encounters, (n,
        d), under each law, (K, n). A vehicle with several rows of features has the mean of them.
        """
        sums: dict[str, list[Array]] = {}
        for _ in range(BATCHES):
            points = scipy.stats.qmc.Sobol(wide.dimension, rng=generator).random(finer * SIZE)
            x, log_density = wide.points(points)
            found = list(features(x))
            needed = np.flatnonzero(np.any([each.any(axis=1) for _, each, _ in found], axis=0))
            weights = np.exp(density(x[needed]) - log_density[needed]) / len(x)
            rows: dict[str, list[Array]] = {}
            for name, each, more in found:
                own = each[needed].any(axis=1)
                part = weights[:, own] if more is None else weights[:, own] * more(needed[own])
                rows.setdefault(name, []).append(part @ each[needed[own]])
            for name, parts in rows.items():
                sums.setdefault(name, []).append(np.mean(parts, axis=0))
        return cls({name: np.stack(parts) for name, parts in sums.items()})

    def means(self, chosen: NDArray[np.bool_] | slice = slice(None)) -> Means:
        """Return the means of the features, (K, m) each, of chosen batches."""
        return {name: each[chosen].mean(axis=0) for name, each in self.sums.items()}

    def numbers(self, made: Callable[[Means], Mapping[Key, float]]) -> dict[Key, tuple[float, float]]:
        """Return numbers that follow from the means, each with its error.

        A number from half of the batches differs from that of all batches by as much as this does from the
        truth, in its variance and in a bias that falls with the number of encounters.
        """
        count = len(next(iter(self.sums.values())))
        whole, halves = made(self.means()), hadamard(count)[count // 2 if self.paired else 1 :] > 0
        parts = np.array([list(made(self.means(each)).values()) for each in halves])
        errors = np.sqrt(((parts - list(whole.values())) ** 2).mean(axis=0))
        return {key: (value, float(error)) for (key, value), error in zip(whole.items(), errors, strict=True)}


def summary(values: Array) -> dict[str, float]:
    """Return mean, median and interval ends of equally likely values, under their names in tables."""
    ends = np.quantile(values, list(QUANTILES.values()))
    mean = float(np.mean(values))
    return {"probability": mean, "mean": mean} | dict(zip(QUANTILES, ends.tolist(), strict=True))


def ratio(own: Array, other: Array) -> dict[str, float]:
    """Return median, 80 % interval and share below 1 of the ratio of two probabilities, shape (K,) each."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = own / other
    low, middle, high = np.quantile(ratios, (0.1, 0.5, 0.9)).tolist()
    return {"ratio": middle, "ratio_low80": low, "ratio_high80": high, "safer": float((ratios < 1).mean())}


@dataclass(frozen=True)
class StudyNumbers:
    """The numbers of the tables of a study, as statistics of the means of features."""

    vehicles: Mapping[str, Vehicle]  # by name, the vehicle under test first
    scenario: Scenario
    records: FittedRecords
    draws: Draws
    events: Sequence[Event]  # the crash first
    populations: Callable[[str], np.random.Generator]  # of the weights of random vehicles, by vehicle
    generator: np.random.Generator  # of their inner variables
    paper: IndependentLaw
    mapped: Sequence[Event]  # those under the paper's law, the crash first
    motions: Sequence[pd.DataFrame] = ()  # tables of lead motion
    of_maps: Mapping[str, Array] = field(default_factory=dict)  # `parts_of_map` of each vehicle

    @cached_property
    def risks(self) -> dict[RiskKey, Array]:
        """The risks of injury at `SPEEDS`, if the scenario has injuries."""
        return RISKS[self.scenario.name]() if self.scenario.name in RISKS else {}

    def features(self, x: Array, drivers: int = DRIVERS) -> Features:
        """Yield each vehicle's features of encounters, (n, m): events of the first one, crash, risks.

        Random vehicles have several rows of features, each with other drivers.
        """
        vehicles = {**self.vehicles, BRAKING: BrakingHuman(Human())}
        rows = [drivers if isinstance(each, RandomVehicle) else 1 for each in vehicles.values()]
        for name in np.repeat([*vehicles], rows).tolist():
            vehicle, more, inner = vehicles[name], None, None
            if isinstance(vehicle, RandomVehicle):
                inner = vehicle.draw_inner(len(x), self.generator)
                more = partial(self._inner_weights, vehicle, inner, name)
            outcomes = simulate_inner(vehicle, tuple(x.T), inner)
            events = {self.own: self.events, BRAKING: HARD}.get(name, self.events[:1])
            columns = [event.happens(outcomes).astype(float) for event in events]
            crashed = columns[0] > 0
            for risk in self.risks.values() if name != BRAKING else ():
                speed = np.where(crashed, outcomes.impact_speed, 0.0)
                columns.append(np.where(crashed, np.interp(speed, SPEEDS, risk), 0.0))
            yield name, np.column_stack(columns), more

    def _inner_weights(
        self, vehicle: RandomVehicle, inner: Array, name: str, chosen: NDArray[np.intp]
    ) -> Array:
        return vehicle.inner_weights(inner[chosen], self.draws.size, self.populations(name))

    @cached_property
    def own(self) -> str:
        """Name of the vehicle under test."""
        return next(iter(self.vehicles))

    @cached_property
    def rates(self) -> dict[str, Array]:
        """Equally likely rates of encounters by unit, `RATES` each, if the exposure is known."""
        count, levels = self.records.size, (np.arange(RATES) + 0.5) / RATES
        sizes = {unit: self.records.exposure.get(key) for key, unit in UNITS.items()}
        known = {unit: size for unit, size in sizes.items() if size is not None}
        return {
            unit: scipy.stats.gamma(count + 0.5, scale=1 / size).ppf(levels) for unit, size in known.items()
        }

    @cached_property
    def recorded(self) -> dict[str, Array]:
        """Whether each record ends in each event if a vehicle replays it, by vehicle, (records, events)."""
        return {name: each[:, : len(self.events)] for name, each, _ in self.features(self.records.x, 1)}

    def error_of_recorded(self, name: str) -> float:
        """Return the standard error of the difference of two counts of crashes of replayed records."""
        is_random = isinstance(self.vehicles[name], RandomVehicle)
        return float(np.sqrt(2 * (self.recorded[name][:, 0].sum() + 1))) if is_random else 0.0

    def made(self, means: Means) -> dict[Key, float]:
        """Return all numbers that follow from the means, by table, row and column."""
        parts = (self._of_events, self._of_vehicles, self._of_humans, self._of_injuries)
        return {
            (table, row, column): value
            for part in parts
            for table, row, values in part(means)
            for column, value in values.items()
        }

    def _of_events(self, means: Means) -> Iterator[tuple[str, str, Mapping[str, float]]]:
        counts = self.recorded[self.own].sum(axis=0)
        for k, (event, own, count) in enumerate(zip(self.events, means[self.own].T, counts, strict=False)):
            name, found = self.scenario.event_in_words(event), summary(own)
            per_km = {} if self.records.per_km is None else {"per_km": own.mean() * self.records.per_km}
            yield "answer", name, found | per_km
            blocks = {f"dispersion_{length}": self._dispersion(k, length) for length in (5_000, 15_000)}
            yield "near_misses", name, found | {"recorded": count} | blocks
            for unit, rates in self.rates.items():
                yield "exposure", f"{name}, {unit}", summary(np.outer(own, rates))

    def _dispersion(self, event: int, length: int) -> float:
        """Return variance / mean of the numbers of an event in whole blocks of so many records."""
        happened = self.recorded[self.own][:, event]
        blocks = happened[: happened.size // length * length].reshape(-1, length).sum(axis=1)
        return float(blocks.var(ddof=1) / blocks.mean()) if blocks.size > 1 and blocks.any() else np.nan

    def _of_vehicles(self, means: Means) -> Iterator[tuple[str, str, Mapping[str, float]]]:
        crashes = {name: means[name][:, 0] for name in self.vehicles}
        for name, own in crashes.items():
            found = {"recorded": self.recorded[name][:, 0].sum(), "expected": self.records.size * own.mean()}
            for prefix, reference in self.scenario.references.items():
                if reference in crashes:
                    ratios = ratio(own, crashes[reference])
                    found |= {f"{prefix}{column}": value for column, value in ratios.items()}
            yield "vehicles", name, found | summary(own)
            yield from self._of_all(name, own) if self.motions else ()
            if name != self.own:
                yield "compared", name, ratio(crashes[self.own], own)
            if "kilometre" in self.rates:
                per_mile = 1e6 * KILOMETRES_PER_MILE * self.rates["kilometre"].mean()
                rate = {column: per_mile * value for column, value in summary(own).items()}
                so_few = scipy.stats.poisson.cdf(HUNDRED_CAR_MOST, HUNDRED_CAR_MILES * rate["low95"])
                rate |= {"per_million_miles": rate["mean"], "probability_of_so_few": so_few}
                rate["in_hundred_car"] = HUNDRED_CAR_MILES * rate["mean"]
                yield "counted_crashes", f"{name}, crash: closing cut-in, predicted", rate

    @cached_property
    def motion_values(self) -> dict[str, dict[str, tuple[Array, Array, Array]]]:
        """Equally likely factors of lead motion, and bounds of crashes of opening cut-ins per closing one.

        They are by vehicle and source of lead motion, of a shape (K, m) with about `VALUES` values. Where the
        crashes of opening cut-ins have only a limit, the lower bounds are 0.
        """
        shape = self.draws.size, VALUES // self.draws.size
        found: dict[str, dict[str, tuple[Array, Array, Array]]] = {}
        for source, table in zip(MOTIONS, self.motions, strict=bool(self.motions)):
            for name, rows in table.set_index("gap").groupby("vehicle"):
                closing, opening = rows.loc["closing"], rows.loc["opening"]
                if not closing["factor"] > 0:
                    continue
                first, second = (
                    (self.generator.permutation(np.prod(shape)).reshape(shape) + 0.5) / np.prod(shape)
                    for _ in range(2)
                )
                width = np.sqrt(np.log1p((closing["factor_error"] / closing["factor"]) ** 2))
                median = closing["factor"] * np.exp(-(width**2) / 2)
                factors = scipy.stats.lognorm(width, scale=median).ppf(first)
                moved, error = opening["moving"], opening["standard_error"]
                is_known, often = moved > 0, opening["cut_ins"] / closing["cut_ins"]
                law = scipy.stats.gamma((moved / error) ** 2, scale=error**2 / moved) if is_known else None
                limit = scipy.stats.gamma(1, scale=opening["high95"] / NONE_OF_MANY)
                most = often * (law or limit).ppf(second)
                found.setdefault(str(name), {})[source] = factors, most * is_known, most
        return found

    def _of_all(self, name: str, own: Array) -> Iterator[tuple[str, str, Mapping[str, float]]]:
        """Yield the rates of all cut-ins. Those of closing ones vary too little to change an interval."""
        keeps, sources = own[:, None], self.motion_values.get(name, {})
        parts = {"closing, lead keeps its speed": (keeps, keeps)}
        closing = {source: keeps * factors for source, (factors, _, _) in sources.items()}
        parts |= {f"closing, {source}": (each, each) for source, each in closing.items()}
        if sources:
            together = np.array(list(closing.values()))
            opening = [np.array([each[k] for each in sources.values()]) for k in (1, 2)]
            parts |= {"closing": (together, together), "opening": (opening[0], opening[1])}
            parts["all"] = together + opening[0], together + opening[1]
        often = {"closing cut-in": 1.0} | {unit: rates.mean() for unit, rates in self.rates.items()}
        for part, (least, most) in parts.items():
            high = {column: value for column, value in summary(most).items() if column.startswith("high")}
            found = summary(least) | high | {"upper95": float(np.quantile(most, 0.95))}
            for per, rate in often.items():
                values = {column: rate * value for column, value in found.items()}
                if per == "kilometre":
                    values["in_hundred_car"] = values["mean"] * KILOMETRES
                if sources:
                    values["share"] = least.mean() / parts["all"][0].mean()
                yield "all_cut_ins", f"{name}, {part}, {per}", values

    def _of_humans(self, means: Means) -> Iterator[tuple[str, str, Mapping[str, float]]]:
        crash, *braked = means[BRAKING].T
        per_km = self.records.per_km
        for event, own in {"crash": crash, **dict(zip(SEVERE, braked - crash, strict=True))}.items():
            found = {"probability": own.mean()}
            often = LANE_CHANGES_A_MILE * SHARE_CLOSING / KILOMETRES_PER_MILE
            for driver, rate in (("human", per_km), ("with cut-ins from lane changes a mile", often)):
                more = {} if rate is None else {"expected": rate * KILOMETRES * own.mean()}
                yield "human_predictions", f"{driver}, {event}", found | more

    def _of_injuries(self, means: Means) -> Iterator[tuple[str, str, Mapping[str, float]]]:
        injured = {name: self._injured(means[name][:, -len(self.risks) :]) for name in self.vehicles}
        for name, levels in injured.items() if self.risks else ():
            crash = means[name][:, 0].mean()
            for level, (own, other, slow) in levels.items():
                numbers = own[:, :, None] + other[:, None, :]
                mean = numbers.mean()
                shares = {"per_crash": mean / crash, "in_own_car": own.mean() / mean, "gentle": slow / mean}
                yield "injuries", f"{name}, {level}, cut-in", summary(numbers) | shares
                for unit, rates in self.rates.items():
                    found = summary(np.multiply.outer(numbers, 1e6 * rates))
                    yield "injuries", f"{name}, {level}, million {unit}s", found | shares
                sources = [
                    [key[2] for key in self.risks if key[:2] == (level, end)] for end in (FRONTAL, REAR)
                ]
                for i, first in enumerate(sources[0]):
                    for j, second in enumerate(sources[1]):
                        row = f"{name}, {level}, {first}, {second}"
                        yield "injuries_by_curve", row, summary(numbers[:, i, j])
                if name != self.own:
                    base = injured[self.own][level]
                    found = ratio(base[0][:, :, None] + base[1][:, None, :], numbers)
                    row = f"{self.own}, {name}, {level}"
                    yield "risk_balance", row, found | {"fewer_injured": found["safer"]}

    def _injured(self, risks: Array) -> dict[str, tuple[Array, Array, float]]:
        """Return the injured drivers of both cars by level, (K, curves) each, and those in slow impacts."""

        def of(level: str, end: str) -> Array:
            return risks[:, [key[:2] == (level, end) for key in self.risks]]

        return {
            level: (
                of(level, FRONTAL),
                of(level, REAR),
                sum(of(gentle(level), end).mean() for end in (FRONTAL, REAR)),
            )
            for level in LEVELS
        }


def generator_of(seed: int, name: str) -> np.random.Generator:
    """Return the generator with which a study weights the inner variables of a random vehicle."""
    paths = {UNDER_TEST: ("laws", "answer"), BRAKING: ("humans",)}
    return child_generator(seed, *paths.get(name, ("laws", "references", name)))


def parts_of_map(crashes: MapCrashes, risks: Mapping[RiskKey, Array]) -> Array:
    """Return crash probability and mean risks by part of the lines of a map, (2 PARTS, K, 1 + risks).

    Each part estimates the numbers of the whole map. They are computed with the published numbers, because
    some maps need much time.
    """
    values = np.vstack([np.ones(len(crashes.x)), *mean_risks(crashes.impact_speed, risks)]).T
    return 2 * PARTS * crashes.lines.summed(crashes.weights, values)


def parts_by_name(name: str, answer: Answer) -> dict[str, Array]:
    """Return the parts of the map of an answer (`parts_of_map`) under a name; nothing if it has no map."""
    crashes = answer.crashes
    return {name: parts_of_map(crashes, RISKS[CUT_IN.name]())} if isinstance(crashes, MapCrashes) else {}


def with_parts_stored(
    answers: Iterable[tuple[str, Answer]], path: str | os.PathLike | None
) -> Iterator[tuple[str, Answer]]:
    """Yield answers, each with its name, and at the end write the parts of their maps to the path, if any."""
    parts: dict[str, Array] = {}
    for name, answer in answers:
        if path is not None:
            parts |= parts_by_name(name, answer)
        yield name, answer
        del answer  # before the next answer is computed
    if path is not None:
        write_arrays(path, parts)


def paper_numbers(numbers: StudyNumbers) -> dict[Key, tuple[float, float]]:
    """Return the numbers of the tables ``exact``, ``severity`` and ``impact_speed`` under the paper's law."""
    law, records, events = numbers.paper, numbers.records, numbers.mapped
    vehicle = numbers.vehicles[numbers.own]
    segments = {name: (each.lower, each.upper) for name, each in law.lead_speeds.items()}

    def features(x: Array) -> Features:
        outcomes = vehicle.simulate(*x.T)
        happened = [event.happens(outcomes) for event in events]
        columns = np.column_stack([*happened, np.where(happened[0], outcomes.impact_speed, 0.0)])
        for name, (low, high) in segments.items():
            yield name, columns * ((x[:, 0] >= low) & (x[:, 0] <= high))[:, None], None

    def made(means: Means) -> dict[Key, float]:
        parts = {name: means[name][0] / law.shares[name] for name in segments}
        parts["all"] = np.sum([means[name][0] for name in segments], axis=0)
        numbers = {}
        for name, (*found, speed) in parts.items():
            # The paper's law has all rows of the records, also those that repeat others.
            rows = sum(law.counts.values()) / records.size
            per_km = 1e6 * (records.per_km or np.nan) * rows * law.shares.get(name, 1.0)
            numbers["exact", name, "probability"] = found[0]
            numbers["impact_speed", name, "mean_m_s"] = speed / found[0] if found[0] else np.nan
            for event, own in zip(events, found, strict=True):
                row = f"{name}, {event.quantity}, {event.threshold}"
                ratios = {"to_crash": own / found[0] if found[0] else np.nan, "per_million_km": per_km * own}
                for column, value in ({"probability": own} | ratios).items():
                    numbers["severity", row, column] = value
        return numbers

    wide = WideCutIns(records.x[:, 0], law.box.upper[1], law.closing_speed_max)
    plain = Plain.of(wide, lambda x: law.log_density(x)[None], features, numbers.generator, FINER)
    found = plain.numbers(made)
    # Ratios of segments with too few crashes have no error that means anything.
    few = {
        row
        for (table, row, _), (value, error) in found.items()
        if table == "exact" and error > LARGEST * value
    }
    return {key: value for key, value in found.items() if key[1].split(", ")[0] not in few}


def second_numbers(numbers: StudyNumbers) -> tuple[dict[Key, tuple[float, float]], dict[Key, float]]:
    """Return all second numbers of a study by table, row and column, each with its standard error.

    With them come the errors of the first numbers by the lines of the crash maps (`map_errors`).
    """
    draws = numbers.draws.with_cap_at(CAP)
    wide = WideCutIns(numbers.records.x[:, 0], draws.support.range_max, CAP)
    plain = Plain.of(wide, draws.log_densities, numbers.features, numbers.generator)
    return plain.numbers(numbers.made) | paper_numbers(numbers), map_errors(numbers, plain.means())


def map_errors(numbers: StudyNumbers, means: Means) -> dict[Key, float]:
    """Return the errors of the numbers that follow from crash maps, by the random lines of the maps.

    Vehicles without a map, and events of the vehicle under test other than the crash, have the given means.
    """
    sums = {name: np.broadcast_to(each, (2 * PARTS, *each.shape)) for name, each in means.items()}
    for name, (crash, *risks) in ((name, np.moveaxis(own, 2, 0)) for name, own in numbers.of_maps.items()):
        events = np.moveaxis(sums[name], 2, 0)[1 : sums[name].shape[2] - len(risks)]
        sums[name] = np.stack([crash, *events, *risks], axis=2)
    return {key: error for key, (_, error) in Plain(sums, paired=True).numbers(numbers.made).items()}


def closed_forms(records: FittedRecords, counted: pd.DataFrame | None) -> dict[Key, float]:
    """Return the rate of encounters, and exact limits of counted crashes by chi-squared distributions."""
    found: dict[Key, float] = {}
    for key, unit in UNITS.items():
        if (size := records.exposure.get(key)) is not None:
            law = scipy.stats.gamma(records.size + 0.5, scale=1 / size)
            ends = {column: law.ppf(level) for column, level in QUANTILES.items()} | {"mean": law.mean()}
            found |= {("exposure", f"cut-in, {unit}", column): value for column, value in ends.items()}
    rows = () if counted is None else counted[counted["kind"] == "counted"].itertuples()
    for row in rows:
        low, high = scipy.stats.chi2.ppf(0.025, 2 * row.count), scipy.stats.chi2.ppf(0.975, 2 * row.count + 2)
        rates = {"per_million_miles": row.count, "low95": np.nan_to_num(low / 2), "high95": high / 2}
        for column, events in rates.items():
            found["counted_crashes", f"{row.who}, {row.what}", column] = events / row.million_miles
    return found


def published(tables: Mapping[str, pd.DataFrame]) -> dict[Key, tuple[float, float]]:
    """Return every number of tables by table, row and column, with its stated error or NaN."""
    found: dict[Key, tuple[float, float]] = {}
    for name, table in tables.items():
        rows = [column for column in ROWS[name] if column in table]
        numbers = table.drop(columns=[*rows, "standard_error"], errors="ignore").select_dtypes("number")
        relative = table.get("standard_error", np.nan) / table.get(
            "probability", pd.Series(np.nan, table.index)
        )
        for index, names in table[rows].iterrows():
            label = ", ".join(map(str, names))
            known = numbers.loc[index].dropna()
            errors = errors_of_values(known) if name == "all_cut_ins" else known * relative[index]
            found |= {(name, label, column): (value, errors[column]) for column, value in known.items()}
    return found


def errors_of_values(row: pd.Series) -> pd.Series:
    """Return the standard errors of mean and quantiles that come from `VALUES` equally likely values.

    The density at a quantile is estimated from its neighbours in the row.
    """
    levels = pd.Series(QUANTILES | {"upper95": 0.95}).reindex(row.index).dropna().sort_values()
    slopes = np.gradient(row[levels.index].to_numpy(float), levels.to_numpy())
    errors = np.abs(slopes) * np.sqrt(levels * (1 - levels) / VALUES)
    deviation = (row["high80"] - row["low80"]) / (2 * ndtri(0.9))
    relative = deviation / np.sqrt(VALUES) / row.get("mean", np.nan)
    return errors.reindex(row.index).fillna(row * relative)


def second_ways(numbers: StudyNumbers, tables: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Return the table ``second_ways``: a row for every number of tables, with the second number if any.

    ``difference`` is that of both numbers, divided by the root of the sum of their squared errors. If it is
    large, ``reason`` is chance, unless chance does not explain it.
    """
    closed = closed_forms(numbers.records, tables.get("counted_crashes"))
    second, of_maps = second_numbers(numbers)
    second |= {key: (value, 0.0) for key, value in closed.items()}
    rows = []
    for key, (number, error) in published(tables).items():
        again, second_error = second.get(key, (np.nan, np.nan))
        if second_error > LARGEST * abs(again) and key[2] not in SHARES:
            again, second_error = np.nan, np.nan
        is_count = key[2].startswith(("recorded", "dispersion"))
        mechanism = NONE if np.isnan(again) else FORM if key in closed else COUNT if is_count else PLAIN
        if key[0] == "vehicles" and key[2] == "recorded":
            second_error = numbers.error_of_recorded(key[1])
        if key[0] == "all_cut_ins":  # both numbers come from as many values
            second_error = np.hypot(second_error, error)
        if (of_map := of_maps.get(key, 0.0)) > ROUNDING * abs(number):
            error = np.hypot(np.nan_to_num(error), of_map)
        if key[2] in SHARES:
            second_error += 1 / numbers.draws.size
        together = np.sqrt(np.nansum(np.square([error, second_error, ROUNDING * again, TINY])))
        difference = 0.0 if number == again else (number - again) / together
        reason = CHANCE if DOUBTFUL < abs(difference) < LARGE else ""
        rows.append((*key, number, error, again, second_error, mechanism, difference, reason))
    return pd.DataFrame(rows, columns=COLUMNS)
