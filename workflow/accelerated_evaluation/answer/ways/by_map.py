"""The answer from a crash map: the law of every draw is integrated over the map, so nothing is sampled."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from accelerated_evaluation.answer.ways.answer import Answer, Crashes, Replayed
from accelerated_evaluation.answer.ways.extrapolation import speed_limits
from accelerated_evaluation.answer.ways.posterior import Posterior
from accelerated_evaluation.base.arguments import Argument, one_of
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.crash_map.impacts import with_impacts
from accelerated_evaluation.crash_map.lines import CrashLines, crash_places, divided_at
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.crash_map.sampled import sample_crashes
from accelerated_evaluation.laws.draws import Draws
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.loading import identity_of
from accelerated_evaluation.vehicles.protocol import CRASH, RandomVehicle, Vehicle

LINES = 2500  # number of lines of a map that are kept for the integrals
INTERVALS = 60_000  # number of intervals that are kept of a map with random closing speeds
INTERVAL_GUIDES = 3  # number of draws that determine which; such a map may have twenty million intervals
GUIDES = 10  # number of draws of the law that determine which lines are kept


def _require_cut_ins(scenario: Scenario, what: str) -> None:
    """Raise InputError if there are no crash maps of a scenario."""
    if scenario.names != CUT_IN.names:
        raise InputError(
            "Map",
            seen=f"{what} of the scenario {scenario.name}",
            expected=f"{what} of cut-ins, for which there are crash maps",
            change=f"Use {'Scan, ' if scenario.scanned else ''}Simulations, or FewRuns for a slow vehicle.",
        )


def _points(records: Any) -> Array:  # noqa: ANN401
    """Return recorded cut-ins as points, shape (n, 3); TypeError or ValueError if they are none."""
    _require_cut_ins(getattr(records, "scenario", CUT_IN), "records")
    x = np.asarray(getattr(records, "x", records), dtype=float)
    if x.ndim != 2 or x.shape[1] != CUT_IN.dimension or not len(x):
        raise ValueError
    CUT_IN.checked(*x.T, source="Map, argument records")
    return x


@checked(
    crash_map=one_of(CrashMap, words="a crash map", change="map_crashes makes one."),
    records=Argument("records of cut-ins", _points, "Read them with read_records."),
)
@dataclass(frozen=True)
class Map:
    """The way to an answer by a crash map, for fast vehicles in cut-ins.

    The draws of a law only need to give the probability of intervals of the closing speed
    (`Draws.log_slices`).

    Parameters
    ----------
    crash_map
        Crash map of the vehicle, with the events of which the answer shall give the probability. A map of
        another vehicle is refused if class and parameters of both are known. They are unknown for a function,
        and for an object that is not a frozen dataclass of numbers and texts.
    records
        The records of cut-ins, or an array of them, shape (n, 3). They give the distribution of the lead
        speed, and are replayed: if their crashes contradict the map, its crashes are drawn at random in place
        of an adaptive scan, which may overlook narrow stripes.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> config = ae.load(given={"data": {"sample": 2000, "spmd": {"outlier_rows": []}}})
    >>> records = ae.read_records(config)
    >>> limits = {"lead_speed_min": 5, "lead_speed_max": 35, "range_max": 75}
    >>> cells = {"lead_speed_cells": 4, "range_cells": 6, "refinement": 2}
    >>> grid = ae.Grid(**limits, **cells, closing_speed_max=60, closing_speed_points=40)
    >>> way = ae.Map(ae.map_crashes("acc_aeb", grid, [], 1), records)
    >>> law = ae.fit_paper_law("two_pieces", records, config)
    >>> exact = ae.evaluate(ae.Problem(ae.CUT_IN, "acc_aeb"), law, way, generator=1)
    >>> 0 < exact.posterior.probability < 1e-4
    True
    """

    crash_map: CrashMap
    records: Array

    def answer(
        self, problem: Problem, draws: Draws, events: Sequence[Event], generator: np.random.Generator
    ) -> Answer:
        """Return the probability of the events of a problem under each draw of the law.

        InputError is raised if the problem is not one of cut-ins, or if the map is that of another vehicle.
        """
        _require_cut_ins(problem.scenario, "a problem")
        vehicle, scan = problem.vehicle, "refined"
        of_map, of_problem = self.crash_map.vehicle, identity_of(vehicle)
        if None not in (of_map, of_problem) and of_map != of_problem:
            raise InputError(
                "Map, argument crash_map",
                seen=f"a map of the vehicle {of_map}",
                expected=f"a map of the vehicle of the problem, {of_problem}",
                change="Make it with map_crashes and this vehicle.",
            )
        replayed = Replayed.of(problem, self.records[draws.holds(self.records)])
        lines = self._lines(self.crash_map, problem.event, vehicle, draws, generator)
        if not replayed.supports(lines.masses(draws).sum(axis=1).mean()):
            lines, scan = self._random_lines(problem.event, vehicle, draws, generator), "random"
        fixed = {
            name: Posterior(lines.masses(own).sum(axis=1), draws.member)
            for name, own in draws.fixed().items()
        }
        posteriors, crashes = {}, None
        for event in (problem.event, *events):
            if event != problem.event:
                lines = self._lines(self.crash_map, event, vehicle, draws, generator)
            if event == CRASH and (law := draws.typical) is not None:
                lines, impact_speed = with_impacts(lines, vehicle, law)
                limits = speed_limits(self.records, lines.places.lead_speed, lines.places.range_)
                lines, part = divided_at(lines, limits.values())
                masses = lines.masses(draws)
                crashes = MapCrashes(lines.inside, impact_speed[part], masses, lines, draws)
                probabilities = crashes.weights.sum(axis=1)
            else:
                probabilities = lines.masses(draws).sum(axis=1)
            posteriors[event] = Posterior(probabilities, draws.member)
        return Answer(problem, draws, posteriors, crashes, replayed, fixed=fixed, notes={"scan": scan})

    def _lines(
        self,
        crash_map: CrashMap,
        event: Event,
        vehicle: Vehicle,
        draws: Draws,
        generator: np.random.Generator,
    ) -> CrashLines:
        """Return the lines of a map that matter for an event."""
        lines = CrashLines.of(crash_map, self.records[:, 0], event, draws.support)
        return draws.within(thinned_lines(lines, vehicle, draws.unlimited, generator))

    def _random_lines(
        self, event: Event, vehicle: Vehicle, draws: Draws, generator: np.random.Generator
    ) -> CrashLines:
        """Return intervals of a map with random closing speeds, each on a line of its own.

        Half of them are chosen by their probability, and half by its product with the square of the closing
        speed: nearly all crashes of a vehicle may be slow, and nearly all injuries happen in the others.
        """
        sampled = sample_crashes(vehicle, self.crash_map, generator, events=(event,))
        lines = CrashLines.of(sampled, self.records[:, 0], event, draws.support)
        del sampled  # which needs nearly as much memory as the lines
        guides, chance = draws.unlimited.thinned(INTERVAL_GUIDES), np.zeros(lines.row.size)
        for k in range(guides.size):
            (mass,) = lines.masses(guides.subset(np.array([k])))
            for power in (0, 2):
                mass *= lines.start**power  # in place: there are millions of intervals
                chance += mass / max(mass.sum(), np.finfo(float).tiny)
        if chance.any():
            lines = lines.thinned_intervals(chance, INTERVALS, generator)
        return draws.within(_weighted(lines, vehicle, draws, generator))


@dataclass(frozen=True)
class MapCrashes(Crashes):
    """Crashes of a map: ``x`` has one cut-in of each interval of the closing speed, which contains others."""

    lines: CrashLines
    draws: Draws

    def drawn(self, size: int, generator: np.random.Generator) -> Array:
        """Draw crashes from the mean of the draws, shape (size, 3)."""
        probabilities = self.weights.sum(axis=1)
        counts, places = generator.multinomial(size, probabilities / probabilities.sum()), []
        for law, masses, count in zip(self.draws.laws, self.weights, counts, strict=True):
            if count:
                places.append(np.column_stack(crash_places(self.lines, masses, law, count, generator)))
        return generator.permutation(np.concatenate(places))


def thinned_lines(
    lines: CrashLines, vehicle: Vehicle, draws: Draws, generator: np.random.Generator
) -> CrashLines:
    """Return the lines that matter for an event, with weights for each draw of a random vehicle."""
    masses = lines.masses(draws.thinned(GUIDES))
    totals = masses.sum(axis=1, keepdims=True)
    np.divide(masses, totals, out=masses, where=totals > 0)
    mean = masses.sum(axis=0) / max(np.count_nonzero(totals), 1)
    # The share of each line in the probability of the event, as a mean over draws.
    share = np.bincount(lines.row, mean, lines.weight.size).astype(float)
    if share.any():  # otherwise the event never happens, or its probability underflows
        lines = lines.thinned(share, LINES, generator)
    return _weighted(lines, vehicle, draws, generator)


def _weighted(
    lines: CrashLines, vehicle: Vehicle, draws: Draws, generator: np.random.Generator
) -> CrashLines:
    """Return the lines with weights for each draw of a random vehicle.

    The weights depend on the seed of the generator and not on its state, so that all events of a random
    vehicle have the same draws of its parameters.
    """
    if not isinstance(vehicle, RandomVehicle) or lines.inner is None:
        return lines
    same = np.random.Generator(type(generator.bit_generator)(generator.bit_generator.seed_seq))
    return replace(lines, weights=vehicle.inner_weights(lines.inner, draws.size, same))
