"""The most probable kinds of crashes, the records nearest to a crash, and the traces of both."""

import numpy as np
import pandas as pd
from scipy.cluster.vq import kmeans2
from scipy.special import ndtri, ndtri_exp

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines, crash_places
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.mean import MeanLaw
from accelerated_evaluation.vehicles.builtin.traces import COLUMNS
from accelerated_evaluation.vehicles.protocol import CRASH, Outcomes, Vehicle

WAYS = 12  # number of groups of crashes, and of records
DRAWN = 4000  # number of drawn crashes that are divided into groups
PLACE = ("lead_speed", "range", "closing_speed")
SHOWN = ("kind", "number", "probability", *PLACE, "crash", "min_range", "min_ttc", "impact_speed")


def ways_to_crash(
    lines: CrashLines, law: MeanLaw, vehicle: Vehicle, generator: np.random.Generator
) -> pd.DataFrame:
    """Divide the crashes under a law into groups, and represent each group by one crash.

    Crashes are drawn from the law and divided into groups by k-means in normal scores (coordinates in which
    the law is standard normal), so that all variables have the same scale. Each group is represented by the
    crash nearest to its centre, and has a share of the crash probability. The groups together contain all
    crashes. A row has the ``probability`` of the group and the initial values and the outcome of its
    representative; the most probable group comes first. There are no rows if the vehicle never crashes, or if
    the probability underflows.
    """
    masses = lines.masses(law)[0]
    if not masses.any():
        return pd.DataFrame(columns=SHOWN)
    place = crash_places(lines, masses, law.typical, DRAWN, generator)
    z, probability = cut_in_scores(law, *place), float(masses.sum())
    return _tabulated(_grouped(place, z, WAYS, probability, generator), "crash", vehicle)


def ways_among_runs(
    crashes: pd.DataFrame, probability: float, vehicle: Vehicle, generator: np.random.Generator
) -> pd.DataFrame:
    """Divide the crashes among weighted runs into groups, for a vehicle without a crash map.

    Crashes are drawn from the runs that crashed, by their shares of the crash probability, and are divided
    into groups by k-means of the initial values, each divided by its standard deviation. Each group is
    represented by the crash nearest to its centre. ``share`` in ``crashes`` is the part of the crash
    probability that a run represents (see `by_few_runs.crashes_table`). The columns are those of
    `ways_to_crash`, and there are at most as many groups as crashes with a positive share.
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


def cut_in_scores(law: MeanLaw, lead_speed: Array, range_: Array, closing_speed: Array) -> Array:
    """Return the normal scores of cut-ins, coordinates in which the law is standard normal, shape (n, 3).

    They are those of the lead speed v_L [m/s], of the range R [m] given v_L, and of the closing speed [m/s]
    given v_L and R.
    """
    recorded = np.sort(np.concatenate([speeds.values for _, speeds in law.lead_speeds.items()]))  # noqa: PD011
    rank = (np.searchsorted(recorded, lead_speed, side="left") + 0.5) / (recorded.size + 1)
    stratum = next(iter(law.strata.values()))  # the law is the same in all segments
    exponents = stratum.first(lead_speed, 1 / range_), stratum.second(lead_speed, 1 / range_, closing_speed)
    return np.column_stack([ndtri(rank), *(-ndtri_exp(-exponent) for exponent in exponents)])


def nearest_records(records: DistinctRecords, vehicle: Vehicle) -> pd.DataFrame:
    """Find the `WAYS` distinct records that come nearest to a crash when the vehicle replays them.

    The columns are those of `ways_to_crash`, with NaN as probability. Crashes come first, in the order of
    falling impact speed, and then the other records by their score, which decreases towards a crash.
    """
    place = records.lead_speed, records.range_, records.closing_speed
    outcomes = vehicle.simulate(*place)
    order = np.lexsort([CRASH.score(outcomes), -outcomes.impact_speed, ~outcomes.crash])[:WAYS]
    table = pd.DataFrame(dict(zip(PLACE, (column[order] for column in place), strict=True)))
    return _tabulated(table.assign(probability=np.nan), "record", vehicle)


def traces_of(shown: pd.DataFrame, vehicle: Vehicle) -> pd.DataFrame:
    """Simulate the encounters of a table, and return the states of both cars over time (`traces.COLUMNS`).

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
