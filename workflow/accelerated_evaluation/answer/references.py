"""Compare a slow vehicle with reference vehicles that are fast enough for crash maps.

A crash map gives the crash probability of a reference vehicle under every draw of the law without a sampling
error. The ratio of the slow vehicle to the reference is computed for each draw of the law. Uncertainty about
the law that affects both vehicles in the same way therefore cancels.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.compared import compare
from accelerated_evaluation.answer.posterior import Posterior
from accelerated_evaluation.answer.reweighting import NOISE, SampledPosterior
from accelerated_evaluation.answer.study import REFERENCES, UNDER_TEST, with_draws
from accelerated_evaluation.answer.summary import RATIO, SAFER, is_supported, vehicle_table
from accelerated_evaluation.answer.weighted_family import LINES
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.mapping import map_crashes
from accelerated_evaluation.crash_map.maps import CrashMap, Grid
from accelerated_evaluation.crash_map.sampled import sample_crashes
from accelerated_evaluation.laws.smooth.draws import LawDraws
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.vehicles import VEHICLES
from accelerated_evaluation.vehicles.external.slow import is_slow, loaded_for
from accelerated_evaluation.vehicles.loading import load_vehicle
from accelerated_evaluation.vehicles.protocol import Vehicle

GUIDES = 10  # number of draws of the law that determine which lines of a map are kept
LIMITS = ("lead_speed_min", "lead_speed_max", "range_max")  # limits of a crash map


@dataclass(frozen=True)
class Reference:
    """The crash probability of a reference vehicle.

    Attributes
    ----------
    probabilities
        Crash probability under each draw of the law, shape (K,).
    recorded
        Number of distinct records that crash when the vehicle replays them.
    """

    probabilities: Array
    recorded: int

    @classmethod
    def of(
        cls,
        vehicle: Vehicle,
        crash_map: CrashMap,
        records: DistinctRecords,
        draws: LawDraws,
        generator: np.random.Generator,
    ) -> Self:
        """Compute the crash probability of a vehicle from its crash map.

        If the number of replayed records that crash contradicts the map, the map is replaced by one that is
        computed at random closing speeds.

        Parameters
        ----------
        vehicle, crash_map
            The vehicle and its crash map, the set of cut-ins in which it crashes.
        records
            The distinct recorded cut-ins.
        draws
            Draws of the law of cut-ins.
        generator
            Source of all randomness.
        """
        outcomes = vehicle.simulate(records.lead_speed, records.range_, records.closing_speed)
        recorded = int(outcomes.crash.sum())
        probabilities = _by_map(vehicle, crash_map, records, draws, generator)
        if not is_supported(recorded, records.size * probabilities.mean()):
            crash_map = sample_crashes(vehicle, crash_map, generator)
            probabilities = _by_map(vehicle, crash_map, records, draws, generator)
        return cls(probabilities, recorded)


def _by_map(
    vehicle: Vehicle,
    crash_map: CrashMap,
    records: DistinctRecords,
    draws: LawDraws,
    generator: np.random.Generator,
) -> Array:
    """Return the crash probability under every draw, from the most important lines of a map."""
    lines = CrashLines.of(crash_map, records.lead_speed, support=records.support)
    few = draws.thinned(GUIDES)
    pairs = zip(few.shared, few.laws, strict=True)
    masses = [lines.masses(few.ranges[shared], speeds) for shared, speeds in pairs]
    shares = [mass / mass.sum() for mass in masses if mass.any()]
    kept = lines.thinned(np.mean(shares, axis=0), LINES, generator) if shares else lines
    return under_draws(with_draws(kept, vehicle, draws.size, generator), draws)


def map_reference(
    name: str, config: Mapping[str, Any], records: DistinctRecords, draws: LawDraws
) -> Reference:
    """Compute the crash probability of a reference vehicle under every draw of the law.

    The probability is integrated over the crash map of the vehicle, the set of cut-ins in which it crashes.

    Parameters
    ----------
    name
        A label in the section ``compared_vehicles``, or the name of a vehicle.
    config
        A complete configuration; its ``seed`` and the sections ``filters``, ``answer``, ``compared_vehicles``
        and ``simulations`` are read.
    records
        The distinct recorded cut-ins.
    draws
        Draws of the law of cut-ins.

    Raises
    ------
    InputError
        If the vehicle is too slow for a map, or cannot be loaded.
    """
    section = reference_section(name, config)
    limits = {key: config["filters"][key] for key in LIMITS}
    grid, events = Grid(**limits, **config["answer"]["grid"]), []
    generator = child_generator(config["seed"], "laws", "references", name)
    with loaded_for(section, config["simulations"]) as vehicle:
        return Reference.of(vehicle, map_crashes(vehicle, grid, events, generator), records, draws, generator)


def reference_section(name: str, config: Mapping[str, Any]) -> dict[str, Any]:
    """Return the section of a configuration that describes a vehicle with a crash map.

    Raises
    ------
    InputError
        If there is no vehicle of this name, or if it is slow to simulate.
    """
    named = {"name": name, "parameters": {}, "files": [], "deterministic": None}
    section = named | config["compared_vehicles"].get(name, {})
    if ":" not in section["name"] and section["name"] not in VEHICLES:
        known = ", ".join(dict.fromkeys([*config["compared_vehicles"], *VEHICLES]))
        expected = f"one of {known}, or path/to/file.py:ClassName"
        raise InputError("--reference", seen=repr(name), expected=expected, change="Correct the name.")
    if is_slow(section["name"], config["simulations"]):
        change = "Estimate this vehicle under the same law, and compare the two estimates by --compare."
        raise InputError(
            "--reference", seen=name, expected="a vehicle that is fast to simulate", change=change
        )
    load_vehicle(section["name"], **section["parameters"])  # raises an error for a class that does not exist
    return section


def under_draws(lines: CrashLines, draws: LawDraws) -> Array:
    """Return the probability of an event under every draw of the law, shape (K,).

    Parameters
    ----------
    lines
        Lines of a crash map: pairs of lead speed and range, with the intervals of closing speed in which the
        event happens.
    draws
        Draws of the law of cut-ins.
    """
    pairs = enumerate(zip(draws.shared, draws.laws, strict=True))
    return np.array(
        [lines.of_draw(draw).probability(draws.ranges[shared], law) for draw, (shared, law) in pairs]
    )


def compared_with(own: SampledPosterior | None, references: Mapping[str, Reference]) -> pd.DataFrame:
    """Compare the crash probabilities of a slow vehicle and of each reference vehicle.

    Parameters
    ----------
    own
        Posterior of the slow vehicle; None if it has not crashed in any run.
    references
        The reference vehicles by name, under the same draws of the law.

    Returns
    -------
    pandas.DataFrame
        One row for each reference: its name ``other``; the median ``ratio`` of the crash probabilities, slow
        vehicle by reference; the ends ``ratio_low80`` and ``ratio_high80`` of its 80 % interval; and
        ``safer``, the probability that the slow vehicle crashes less often. The numbers are NaN if ``own`` is
        None, or if the reference never crashes under some draw.
    """
    rows = []
    for name, reference in references.items():
        known, row = reference.probabilities, dict.fromkeys((*RATIO, "safer"), np.nan)
        if own is not None and np.all(known > 0):
            row = compare(own, SampledPosterior(known, np.zeros(known.size), own.member, own.batches))
        rows.append({"other": name} | row)
    return pd.DataFrame(rows, columns=["other", *RATIO, "safer"])


def vehicles_with(
    own: SampledPosterior | None, references: Mapping[str, Reference], size: int
) -> pd.DataFrame:
    """Tabulate the crash probabilities of a slow vehicle and of reference vehicles, with their ratios.

    The slow vehicle, which is expensive to simulate, does not replay the records. If the vehicle may lapse
    (rarely behave differently than in most runs of the same encounter), the upper ends of its intervals and
    its probabilities to be safer assume that it reaches the bound ``unseen_lapses``.

    Parameters
    ----------
    own
        Posterior of the slow vehicle; None if it has not crashed in any run, in which case it has no row.
    references
        The reference vehicles by name.
    size
        Number of distinct records.

    Returns
    -------
    pandas.DataFrame
        One row for each vehicle, the slow one first, with the columns of `summary.vehicle_table`: crashes of
        the records, probability with intervals, and ratios to the references.
    """
    posteriors = {} if own is None else {UNDER_TEST: own.whole}
    recorded: dict[str, int | None] = dict.fromkeys(posteriors)
    for name, reference in references.items():
        values = np.repeat(reference.probabilities, NOISE)
        posteriors[name] = Posterior(values, np.zeros(values.size, int))
        recorded[name] = reference.recorded
    table = vehicle_table(posteriors, recorded, size, REFERENCES)
    if own is None or not own.unseen_lapses:
        return table
    whole = posteriors[UNDER_TEST]
    raised = np.minimum(whole.probabilities + own.unseen_lapses, 1.0)
    largest = posteriors | {UNDER_TEST: replace(whole, probabilities=raised)}
    upper = vehicle_table(largest, recorded, size, REFERENCES)
    ends = [name for name in table if "high" in name or name.endswith(SAFER)]
    return table.assign(
        **{name: table[name].where(table["vehicle"] != UNDER_TEST, upper[name]) for name in ends}
    )
