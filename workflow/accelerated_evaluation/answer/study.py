"""The study of laws: weights of the laws, crash probabilities, and all tables of the answer."""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtri

from accelerated_evaluation.answer.calibration_table import NearMisses, calibration_table
from accelerated_evaluation.answer.exposure import exposure_table
from accelerated_evaluation.answer.extrapolation import (
    DISJOINT,
    divided,
    extrapolation_table,
    parts_by_speed,
    places,
    speed_limits,
)
from accelerated_evaluation.answer.injuries.impacts import ImpactSpeeds, Key, tabulated_risks
from accelerated_evaluation.answer.injuries.tables import injury_tables
from accelerated_evaluation.answer.likeliest_crashes import PLACE
from accelerated_evaluation.answer.near_misses import near_miss_table
from accelerated_evaluation.answer.posterior import Posterior, budget, drawn_laws
from accelerated_evaluation.answer.scored_family import ScoredFamily
from accelerated_evaluation.answer.summary import (
    answer_table,
    is_supported,
    threshold_table,
    vehicle_table,
)
from accelerated_evaluation.answer.weighted_family import WeightedLaws
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines, crash_places
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.crash_map.sampled import sample_crashes
from accelerated_evaluation.laws.smooth.dependent import DependentLaw
from accelerated_evaluation.laws.smooth.family import LawFamily, Member
from accelerated_evaluation.scenarios.protocol import Event
from accelerated_evaluation.vehicles.protocol import Outcomes, RandomVehicle, Vehicle

QUANTITIES = {
    "crash": "crash",
    "impact_speed": "impact above {:g} m/s",
    "min_ttc": "TTC at most {:g} s",
    "min_range": "range at most {:g} m",
}
UNDER_TEST = "under test"
# The competent and careful human of UN R157, and the human driver from data; by the prefix of their columns.
REFERENCES = {"": "cc_human", "human_": "human"}
DRAWN = 2000  # number of crashes that are drawn from the mean of the draws
# Name of the random stream of the answer. It consists of the names of the tables that were first drawn from
# it, and is kept because another name would change all numbers.
ANSWER_STREAM = (
    "answer",
    "vehicles",
    "answer_budget",
    "answer_draws",
    "answer_thresholds",
    "calibration",
    "crash_places",
)


@dataclass(frozen=True)
class LawStudy:
    """The study of laws: the weighted laws, the crash maps of all vehicles, and the tables of the answer.

    Attributes
    ----------
    encounters
        Encounter table, in the order of the records.
    vehicles
        The vehicles by name, the car under test first.
    weighted
        The family of laws with its weights.
    lines
        Lines of the crash maps, by the name of the event: all events of the car under test, and the crashes
        of the other vehicles (see `crash_of`).
    thinned
        The lines of ``lines``, thinned to those that are probable under some law.
    events
        The events of the car under test, by name.
    sampled
        Names of the crashes whose maps were computed with random closing speeds; see `resolve`.
    """

    encounters: pd.DataFrame
    vehicles: Mapping[str, Vehicle]
    weighted: WeightedLaws
    lines: dict[str, CrashLines]
    thinned: dict[str, CrashLines]
    events: Mapping[str, Event]
    sampled: set[str] = field(default_factory=set)

    @classmethod
    def of(
        cls,
        encounters: pd.DataFrame,
        vehicles: Mapping[str, Vehicle],
        maps: Mapping[str, CrashMap],
        scored: ScoredFamily,
        draws: int,
        generator: np.random.Generator,
    ) -> "LawStudy":
        """Weight the laws of a fitted family, and prepare the crash maps for them.

        Parameters
        ----------
        encounters
            Encounter table, in the order of the records.
        vehicles
            The vehicles by name, the car under test first.
        maps
            Crash maps of the vehicles, by name. The map of the car under test contains all events. All maps
            extend to a closing speed above which the outcome no longer changes, because the laws have no
            upper limit of the closing speed.
        scored
            The family, fitted to the distinct records of the encounter table, and its scores.
        draws
            Number of draws of the weights and of the posterior.
        generator
            Source of all randomness.

        Returns
        -------
        LawStudy
            The study, from which the tables of the answer are computed.
        """
        records, support = scored.records, scored.records.support
        (_, own), *others = maps.items()
        speeds, named = records.lead_speed, {event_name(event): event for event in sorted(own.events)}
        lines = {name: CrashLines.of(own, speeds, event, support) for name, event in named.items()}
        lines |= {
            f"crash of {name}": CrashLines.of(mapped, speeds, support=support) for name, mapped in others
        }
        weighted = WeightedLaws.drawn(scored, generator, draws)
        # Random vehicles have generators of their own, so that they do not change the numbers of others.
        own_generators = dict(zip(vehicles, generator.spawn(len(vehicles)), strict=True))
        thinned = {}
        for name, part in lines.items():
            whose = name.removeprefix("crash of ") if name not in named else next(iter(vehicles))
            if part.inner is None:
                thinned[name] = weighted.thinned(part, generator)
            else:
                thin = weighted.thinned(part, own_generators[whose])
                thinned[name] = with_draws(thin, vehicles[whose], draws, own_generators[whose])
        return cls(encounters, vehicles, weighted, lines, thinned, named)

    def resolve(self, maps: Mapping[str, CrashMap], generator: np.random.Generator) -> None:
        """Replace crash maps that are contradicted by the replayed records.

        A map is contradicted if the number of records that crash when the vehicle replays them does not agree
        with the number that is expected from the map. The new map has random closing speeds; see
        `crash_map.sampled`.

        Parameters
        ----------
        maps
            Crash maps of the vehicles, by name.
        generator
            Source of the random closing speeds.
        """
        records = self.weighted.records
        for name, vehicle in self.vehicles.items():
            crash = self.crash_of(name)
            of_laws = self.thinned[crash].probabilities(self.family, self.weighted.members)
            recorded = int(self.replayed[name].crash.sum())
            if not is_supported(recorded, records.size * self.weighted.mean(of_laws)):
                sampled = sample_crashes(vehicle, maps[name], generator)
                self.lines[crash] = CrashLines.of(sampled, records.lead_speed, support=records.support)
                self.thinned[crash] = self.weighted.thinned(self.lines[crash], generator)
                self.sampled.add(crash)

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle under test."""
        return next(iter(self.vehicles.values()))

    def crash_of(self, name: str) -> str:
        """Return the name of the event of a crash for the vehicle with a given name."""
        return "crash" if self.vehicles[name] is self.vehicle else f"crash of {name}"

    @property
    def family(self) -> LawFamily:
        """The family fitted to all records."""
        return self.weighted.family

    def probabilities(self, event: str) -> dict[Member, float]:
        """Return the probability of an event under each law, computed from the complete crash map.

        Parameters
        ----------
        event
            Name of the event.
        """
        return self.lines[event].probabilities(self.family, self.weighted.members)

    @cached_property
    def replayed(self) -> dict[str, Outcomes]:
        """Outcomes of every vehicle when it replays the distinct records, by the name of the vehicle."""
        records = self.weighted.records
        cut_ins = records.lead_speed, records.range_, records.closing_speed
        return {name: vehicle.simulate(*cut_ins) for name, vehicle in self.vehicles.items()}

    @property
    def replayed_events(self) -> dict[str, NDArray[np.bool_]]:
        """Whether each record ends in each event if the car under test replays it, by event, (records,)."""
        outcomes = self.replayed[next(iter(self.vehicles))]
        return {name: event.happens(outcomes) for name, event in self.events.items()}

    def calibration(self) -> pd.DataFrame:
        """Compare the recorded numbers of critical cut-ins with the numbers that the laws predict.

        The near misses of the records that the car under test replays are included.

        Returns
        -------
        pandas.DataFrame
            The columns of `calibration_table.calibration_table`: one row for each law and cell or near miss.
        """
        recorded = {name: int(happened.sum()) for name, happened in self.replayed_events.items()}
        near = NearMisses(recorded, {name: self.probabilities(name) for name in self.events})
        return calibration_table(self.weighted, near)

    def extrapolation(self, generator: np.random.Generator) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Divide the predicted crashes of the car under test by their distance from the records.

        Parameters
        ----------
        generator
            A copy of the generator of `draws` in its state before the draws, so that the laws are the same.

        Returns
        -------
        table, crashes : pandas.DataFrame
            The table of `extrapolation.extrapolation_table`; and `DRAWN` crashes from the mean of the draws,
            with the columns ``lead_speed`` [m/s], ``range`` [m], ``closing_speed`` [m/s] and ``part``.
        """
        weighted, lines = self.weighted, self.thinned["crash"]
        records = weighted.records.encounters.T
        lines = divided(lines, speed_limits(records, lines.places.lead_speed, lines.places.range_))
        laws = drawn_laws(self.family, weighted.members, weighted.weights, generator)
        masses = np.array(
            [lines.of_draw(draw).masses(ranges, law) for draw, (_, ranges, law) in enumerate(laws)]
        )
        crashed = records[self.replayed_events["crash"]]
        table = extrapolation_table(
            parts_by_speed(records, places(lines)), masses, len(records), parts_by_speed(records, crashed)
        )
        if not (mean := masses.mean(axis=0)).any():
            return table, pd.DataFrame(columns=[*PLACE, "part"])
        law = self.family.law(weighted.heaviest)
        drawn = np.column_stack(crash_places(lines, mean, law, DRAWN, generator))
        parts = parts_by_speed(records, drawn)
        part = np.select([parts[name] for name in DISJOINT], DISJOINT, "")
        return table, pd.DataFrame(drawn, columns=PLACE).assign(part=part)

    def representative(self) -> DependentLaw:
        """Return the law with the largest weight, for methods that need a single law."""
        weighted = self.weighted
        return DependentLaw.fitted(self.family, weighted.heaviest, self.encounters, weighted.records.support)

    def draws(self, tabulated: Mapping[Key, Array], generator: np.random.Generator) -> dict[str, Posterior]:
        """Draw the probability of every event, and expected risks of injury, from the posterior of the law.

        Parameters
        ----------
        tabulated
            Risks of injury at given impact speeds, by curve, as from `injuries.impacts.tabulated_risks`.
        generator
            Source of all randomness.

        Returns
        -------
        dict
            Posteriors by the name of the event. Those of crashes contain the expected risks in an encounter.
        """
        law = self.family.law(self.weighted.heaviest)
        crashing = {self.crash_of(name): vehicle for name, vehicle in self.vehicles.items()}
        impacts = {
            crash: ImpactSpeeds.of(self.thinned[crash], vehicle, law) for crash, vehicle in crashing.items()
        }
        lines = self.thinned | {crash: found.lines for crash, found in impacts.items()}
        risks = {crash: found.risks(tabulated) for crash, found in impacts.items()}
        return self.weighted.draw(lines, generator, risks=risks)

    def answers(
        self, exposure: Mapping[str, float | None], half_width: float, generator: np.random.Generator
    ) -> dict[str, pd.DataFrame]:
        """Return the tables of the answer, of its uncertainty, and of the comparison of vehicles.

        Parameters
        ----------
        exposure
            ``kilometres`` and ``hours`` in which the records were made; None if unknown.
        half_width
            Relative half-width of the 80 % interval of an estimator of the probability.
        generator
            Source of all randomness.

        Returns
        -------
        dict
            The tables by name. ``answer`` contains the probability of each event, ``exposure`` the rates per
            kilometre and hour, and ``vehicles`` the comparison of vehicles. ``answer_draws`` contains the
            crash probability under each draw of the law, ``answer_budget`` the parts of its variance, and
            ``answer_thresholds`` its values by threshold of the tail. ``calibration`` compares the laws with
            the records. ``extrapolation`` and ``crash_places`` are the results of `extrapolation`, and
            ``near_misses`` contains intervals that allow for clusters of critical records. The tables of
            `injuries.tables.injury_tables` are added.
        """
        tabulated, as_drawn = tabulated_risks(), deepcopy(generator)
        posteriors = self.draws(tabulated, generator)
        extrapolation, crashes_drawn = self.extrapolation(as_drawn)
        cut_ins, kilometres = self.weighted.records.size, exposure["kilometres"]
        per_km = None if kilometres is None else cut_ins / kilometres
        own = {name: posteriors[name] for name in self.events}
        crashes = {
            UNDER_TEST if vehicle is self.vehicle else name: posteriors[self.crash_of(name)]
            for name, vehicle in self.vehicles.items()
        }
        vehicles, sampling = self.compared(crashes), half_width / ndtri(0.9)
        resolved = {name: crashes[name] for name in vehicles.loc[vehicles["resolved"], "vehicle"]}
        return {
            "answer": answer_table(own, per_km),
            "exposure": exposure_table(own, cut_ins, exposure),
            "vehicles": vehicles,
            **injury_tables(resolved, UNDER_TEST, list(tabulated), cut_ins, exposure, sampling),
            "answer_draws": answer_draws(own["crash"], self.weighted),
            "answer_budget": budget(own["crash"], sampling),
            "answer_thresholds": threshold_table(self.weighted, self.thinned["crash"], generator),
            "calibration": self.calibration(),
            "extrapolation": extrapolation,
            "crash_places": crashes_drawn,
            "near_misses": near_miss_table(own, self.replayed_events, self.weighted.critical, generator),
        }

    def compared(self, posteriors: Mapping[str, Posterior]) -> pd.DataFrame:
        """Compare the crash probabilities of the vehicles, and check each crash map by the replayed records.

        Parameters
        ----------
        posteriors
            Posterior of the crash probability of each vehicle, in the order of ``vehicles``.

        Returns
        -------
        pandas.DataFrame
            One row for each vehicle, with the columns of `summary.vehicle_table` (crashes of the records,
            probability with intervals, and ratios to the references) and ``scan``, which is ``random`` if the
            map was replaced by one with random closing speeds, and ``refined`` otherwise.
        """
        replays = zip(posteriors, self.replayed.values(), strict=True)
        recorded = {name: int(outcomes.crash.sum()) for name, outcomes in replays}
        table = vehicle_table(posteriors, recorded, self.weighted.records.size, REFERENCES)
        crashes = ["crash" if name == UNDER_TEST else f"crash of {name}" for name in table["vehicle"]]
        return table.assign(scan=["random" if crash in self.sampled else "refined" for crash in crashes])


def with_draws(lines: CrashLines, vehicle: Vehicle, draws: int, generator: np.random.Generator) -> CrashLines:
    """Add weights for draws of the uncertain parameters of a random vehicle to the lines of its crash map.

    The lines of any other vehicle are returned unchanged. The draws depend on the seed of the generator and
    not on its state, so that all events of a vehicle have the same draws.

    Parameters
    ----------
    lines, vehicle
        Lines of a crash map of the vehicle (pairs of lead speed and range, with the intervals of closing
        speed in which an event happens), and the vehicle.
    draws
        Number of draws.
    generator
        Random generator whose seed is used.

    Returns
    -------
    CrashLines
        The lines with the weights.
    """
    if not isinstance(vehicle, RandomVehicle) or lines.inner is None:
        return lines
    same = np.random.Generator(type(generator.bit_generator)(generator.bit_generator.seed_seq))
    return replace(lines, weights=vehicle.inner_weights(lines.inner, draws, same))


def event_name(event: Event) -> str:
    """Return the name of an event in tables: the quantity with its threshold and unit."""
    return QUANTITIES[event.quantity].format(event.threshold)


def answer_draws(posterior: Posterior, weighted: WeightedLaws) -> pd.DataFrame:
    """Tabulate the draws of a posterior: the ``probability`` and the name of the ``law`` of each draw.

    Parameters
    ----------
    posterior
        Draws of the probability, each with the index of its law.
    weighted
        The family of laws, for their names.
    """
    names: Array = np.array([member.name for member in weighted.members])
    return pd.DataFrame({"probability": posterior.probabilities, "law": names[posterior.member]})
