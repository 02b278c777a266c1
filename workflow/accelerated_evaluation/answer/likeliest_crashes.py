"""The most probable kinds of crashes, the records nearest to a crash, and the traces of both."""

import numpy as np
import pandas as pd
from scipy.cluster.vq import kmeans2
from scipy.special import ndtri, ndtri_exp

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines, crash_places
from accelerated_evaluation.laws.smooth.dependent import DependentLaw, DependentStratum
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.vehicles.builtin.traces import COLUMNS
from accelerated_evaluation.vehicles.events import CRASH
from accelerated_evaluation.vehicles.protocol import Outcomes, Vehicle

WAYS = 12  # number of groups of crashes, and of records
DRAWN = 4000  # number of drawn crashes that are divided into groups
PLACE = ("lead_speed", "range", "closing_speed")
SHOWN = ("kind", "number", "probability", *PLACE, "crash", "min_range", "min_ttc", "impact_speed")


def ways_to_crash(
    lines: CrashLines, law: DependentLaw, vehicle: Vehicle, generator: np.random.Generator
) -> pd.DataFrame:
    """Divide the crashes under a law into groups, and represent each group by one crash.

    Crashes are drawn from the law and divided into groups by k-means in normal scores (coordinates in which
    the law is standard normal), so that all variables have the same scale. Each group is represented by the
    crash nearest to its centre, and has a share of the crash probability. The groups together contain all
    crashes.

    Parameters
    ----------
    lines
        Lines of the crash map: pairs of lead speed and range, with the closing speeds at which the vehicle
        crashes.
    law
        Law of the cut-ins.
    vehicle
        The car under test.
    generator
        Source of all randomness.

    Returns
    -------
    pandas.DataFrame
        One row for each group, the most probable first: ``kind`` is "crash", ``number`` is counted from 1,
        and ``probability`` is that of the group; the other columns are the initial values ``lead_speed``
        [m/s], ``range`` [m] and ``closing_speed`` [m/s], and the outcome ``crash``, ``min_range`` [m],
        ``min_ttc`` [s] and ``impact_speed`` [m/s] of the representative crash. There are no rows if the
        vehicle never crashes, or if the probability underflows.
    """
    masses = lines.masses(law.ranges, law.speeds)
    if not masses.any():
        return pd.DataFrame(columns=SHOWN)
    place = crash_places(lines, masses, law.speeds, DRAWN, generator)
    z, probability = normal_scores(law, *place), float(masses.sum())
    return _tabulated(_grouped(place, z, WAYS, probability, generator), "crash", vehicle)


def ways_among_runs(
    crashes: pd.DataFrame, probability: float, vehicle: Vehicle, generator: np.random.Generator
) -> pd.DataFrame:
    """Divide the crashes among weighted runs into groups, for a vehicle without a crash map.

    Crashes are drawn from the runs that crashed, by their shares of the crash probability, and are divided
    into groups by k-means of the initial values, each divided by its standard deviation. Each group is
    represented by the crash nearest to its centre.

    Parameters
    ----------
    crashes
        Table of the runs that crashed: initial values, and ``share``, the part of the crash probability that
        the run represents; see `by_few_runs.crashes_table`.
    probability
        The crash probability.
    vehicle
        The vehicle under test, which simulates the representatives again.
    generator
        Source of all randomness.

    Returns
    -------
    pandas.DataFrame
        One row for each group, with its ``probability`` and the initial values and outcome of its
        representative crash, in the columns of `ways_to_crash`; there are at most as many groups as crashes
        with a positive share.
    """
    counted = crashes[crashes["share"] > 0]
    if counted.empty:
        return pd.DataFrame(columns=SHOWN)
    drawn = counted.iloc[generator.choice(len(counted), DRAWN, p=counted["share"] / counted["share"].sum())]
    place = tuple(drawn[name].to_numpy() for name in PLACE)
    x = np.column_stack(place)
    scaled = x / np.maximum(x.std(axis=0), np.finfo(float).tiny)  # each variable by its spread
    groups = _grouped(place, scaled, min(WAYS, len(counted)), probability, generator)
    return _tabulated(groups, "crash", vehicle)


def _grouped(
    place: tuple[Array, ...], z: Array, ways: int, probability: float, generator: np.random.Generator
) -> pd.DataFrame:
    """Divide crashes with coordinates z into groups, each with its nearest crash and its probability."""
    middles, group = kmeans2(z, ways, minit="++", seed=generator, missing="warn")
    rows = []
    for number, middle in enumerate(middles):
        members = np.flatnonzero(group == number)
        if members.size:
            nearest = members[np.argmin(((z[members] - middle) ** 2).sum(axis=1))]
            rows.append((members.size / len(z), *(column[nearest] for column in place)))
    rows.sort(reverse=True)
    table = pd.DataFrame(rows, columns=["probability", *PLACE])
    return table.assign(probability=probability * table["probability"])


def normal_scores(law: DependentLaw, lead_speed: Array, range_: Array, closing_speed: Array) -> Array:
    """Return the normal scores of cut-ins, shape (n, 3).

    Normal scores are coordinates in which the law is standard normal. The three scores are those of the lead
    speed v_L, of the range R given v_L, and of the closing speed C given v_L and R.

    Parameters
    ----------
    law
        Law of the cut-ins.
    lead_speed, range_, closing_speed
        v_L [m/s], R [m] and C [m/s], shape (n,).
    """
    recorded = np.sort(np.concatenate([speeds.values for _, speeds in law.lead_speeds.items()]))  # noqa: PD011
    rank = (np.searchsorted(recorded, lead_speed, side="left") + 0.5) / (recorded.size + 1)
    stratum: DependentStratum = next(iter(law.strata.values()))  # the law is the same in all segments
    exponents = stratum.first(lead_speed, 1 / range_), stratum.second(lead_speed, 1 / range_, closing_speed)
    return np.column_stack([ndtri(rank), *(-ndtri_exp(-exponent) for exponent in exponents)])


def nearest_records(records: DistinctRecords, vehicle: Vehicle) -> pd.DataFrame:
    """Find the distinct records that come nearest to a crash when the vehicle replays them.

    Parameters
    ----------
    records
        The distinct cut-ins.
    vehicle
        The vehicle.

    Returns
    -------
    pandas.DataFrame
        One row for each of `WAYS` records, with the columns of `ways_to_crash`: ``kind`` is "record", and
        ``probability`` is NaN. Crashes come first, in the order of falling impact speed, and then the other
        records by their score, which decreases towards a crash.
    """
    place = records.lead_speed, records.range_, records.closing_speed
    outcomes = vehicle.simulate(*place)
    order = np.lexsort([CRASH.score(outcomes), -outcomes.impact_speed, ~outcomes.crash])[:WAYS]
    table = pd.DataFrame(dict(zip(PLACE, (column[order] for column in place), strict=True)))
    return _tabulated(table.assign(probability=np.nan), "record", vehicle)


def traces_of(shown: pd.DataFrame, vehicle: Vehicle) -> pd.DataFrame:
    """Simulate the encounters of a table, and return the states of both cars over time.

    Parameters
    ----------
    shown
        Table of `ways_to_crash` or `nearest_records`.
    vehicle
        The vehicle.

    Returns
    -------
    pandas.DataFrame
        One row for each time step, with the ``kind`` and ``number`` of the encounter, the time [s], and the
        positions [m], speeds [m/s], host acceleration [m/s^2] and range [m] (all columns: `traces.COLUMNS`).
        There are no rows if the vehicle does not report its states over time.
    """
    parts = [pd.DataFrame(columns=["kind", "number", *COLUMNS])]
    if hasattr(vehicle, "trace"):
        for row in shown.to_dict("records"):
            trace = vehicle.trace(*(row[name] for name in PLACE))
            trace.insert(0, "number", row["number"])
            trace.insert(0, "kind", row["kind"])
            parts.append(trace)
    return pd.concat(parts[1:] or parts, ignore_index=True)


def _tabulated(table: pd.DataFrame, kind: str, vehicle: Vehicle) -> pd.DataFrame:
    """Return a table of encounters with their kind, number and outcomes."""
    outcomes: Outcomes = vehicle.simulate(*(table[name].to_numpy() for name in PLACE))
    table = table.assign(kind=kind, number=np.arange(len(table)) + 1, **vars(outcomes))
    return table[list(SHOWN)]
