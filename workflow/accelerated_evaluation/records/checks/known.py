"""Comparison of the records with known ones, as they are and without each likely fault of their columns.

The comparison needs only the names and units of the variables, so it is the same for every scenario. The
known records of a scenario are those in the project. Known cut-ins are divided by lead speed and country,
because cut-ins in a town and on a motorway differ more from each other than records in two units.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import combinations, permutations, product

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import rankdata

from accelerated_evaluation.base.arrays import LENGTH, SPEED, Array
from accelerated_evaluation.base.files import project_file
from accelerated_evaluation.records.checks import CHECKS, FINE, MANY, STOP, WARNING, Finding, Records
from accelerated_evaluation.records.segments import MINIMUM_ROWS, complete

# Numbers in one unit that stand for 1 in the unit of the variable.
FACTORS = {
    "m/s": {"km/h": 3.6, "mph": 1 / 0.44704},
    "m": {"ft": 1 / 0.3048, "km": 0.001, "cm": 100.0, "mm": 1000.0},
}
LEVELS = (0.25, 0.5, 0.75, 0.95)  # of the quantiles that are compared; the smallest values are mostly noise
# Usual differences between two kinds of traffic: a factor of 1.5 in a quantile, and 0.2 in a rank
# correlation. Distances are in multiples of them.
FACTOR, RELATION = float(np.log(1.5)), 0.2
SMALLEST = 0.02  # values below this share of the known median are taken as this share; 0 has no logarithm
ENOUGH = 5_000  # number of rows that are compared
# A fault explains a distance from the known records if the distance without the fault is this many times
# smaller. Sums of two speeds, such as the host speed in the column of the lead speed, are the likeliest fault
# and change least; exchanged columns and times are the rarest one. The numbers were chosen so that 5 % of the
# sound tables of other traffic in the tests get a warning, most of them of slow traffic, and none a stop. It
# is therefore no independent measure: the share in tables that were not used may be larger.
SUM, UNIT, RARE = 1.3, 1.6, 2.0
# A length in feet needs less. It makes lengths, gaps and times to collision 3.3 times as large at once, as
# no other traffic does. In 204 drawn tables that were not used to choose the number, division by this factor
# brought no sound table nearer to the known records, and four of five tables in feet nearer by 1.2 or more.
FEET = 1.2
CERTAIN = 2.5  # the same for a stop, if the records without the fault are
SIMILAR = 1.0  # no farther from the known records than this
FAR, SLIGHT = 0.8, 0.4  # below the first, all faults need the ratio `RARE`; below the second, none explains
# Distances of records that describe other traffic than the known ones, or have an unknown fault. Cut-ins
# differ more: sound ones of other traffic have distances up to 1.5, and parts of other records up to 1.
OTHER_CUT_INS, OTHER = 1.5, 0.8
SHOWN = 3  # number of differences, and of faults, that are named
SMALL = float(np.log(1.25))  # smaller factors are not named
COLUMNS = {
    "lead_speed": "data.table.columns.lead_speed",
    "range": "data.table.columns.range",
    "closing_speed": "data.table.columns.closing",
}  # keys of the columns of cut-ins


@dataclass(frozen=True)
class Picture:
    """Quantiles and rank correlations of the variables, and quantiles of the times length / speed."""

    quantiles: Array  # logarithms, shape (aspects, levels)
    relations: Array  # rank correlation of each pair of variables
    size: int  # number of rows

    @classmethod
    def of(cls, x: Array, units: Mapping[str, str], smallest: Array) -> "Picture":
        """Return the picture of points, shape (n, d); magnitudes are at least ``smallest``, shape (d,)."""
        logs = np.log(np.maximum(np.abs(x), smallest))
        aspects = [*logs.T, *(logs[:, i] - logs[:, j] for i, j in _times(units))]
        ranks = rankdata(logs, axis=0)
        centred = ranks - ranks.mean(axis=0)
        scaled = centred / np.maximum(np.sqrt((centred**2).sum(axis=0)), 1.0)  # 0 for a constant column
        relations = (scaled.T @ scaled)[np.triu_indices(len(units), 1)]
        return cls(np.quantile(aspects, LEVELS, axis=1).T, relations, len(x))

    def distance(self, other: "Picture") -> float:
        """Return the root mean square of the differences of all quantities and relations.

        The difference of a quantity is the mean absolute difference of the logarithms of its quantiles.
        """
        scale = np.abs(self.quantiles - other.quantiles).mean(axis=1) / FACTOR
        chance = np.sqrt(1 / self.size + 1 / other.size)
        relation = np.abs(self.relations - other.relations) / np.hypot(RELATION, chance)
        return float(np.sqrt(np.mean(np.append(scale, relation) ** 2)))

    def factors(self, other: "Picture", units: Mapping[str, str]) -> dict[str, float]:
        """Return how many times as large as in another picture the median of each quantity is."""
        names = list(units)
        aspects = [*names, *(f"{names[i]} / {names[j]}" for i, j in _times(units))]
        middle = LEVELS.index(0.5)
        factors = np.exp(self.quantiles[:, middle] - other.quantiles[:, middle])
        return dict(zip(aspects, factors.tolist(), strict=True))


def _times(units: Mapping[str, str]) -> list[tuple[int, int]]:
    """Return the places of each pair of a length and a speed."""
    kinds = list(units.values())
    return [(i, j) for i, j in permutations(range(len(kinds)), 2) if (kinds[i], kinds[j]) == ("m", "m/s")]


@dataclass(frozen=True)
class Fault:
    """A possible fault of one or more columns."""

    text: str  # what the columns contain
    columns: frozenset[str]  # the variables with the fault
    remedy: str  # what to change
    needed: float  # how many times nearer the records must come to the known ones; see `SUM`
    corrected: Array  # the points without the fault, shape (n, d)
    unit: str = ""  # the unit of the columns, if it is another one

    @property
    def is_like_traffic(self) -> bool:
        """Whether the fault scales one variable, or makes all of a kind small, as other traffic does, too."""
        return self.needed == UNIT and (len(self.columns) == 1 or not self.unit)


def _faults(x: Array, units: Mapping[str, str]) -> Iterator[Fault]:
    """Iterate over the likely faults of points, shape (n, d), which follow from the units.

    A column, or all columns of a unit, may have another unit. All lengths may be in feet and all speeds in
    mph or ft/s; a speed alone is not compared in ft/s, which hardly differs from km/h. Two columns may be
    exchanged. A speed may be the sum or the difference of two speeds, such as that of the host in place of
    that of the lead vehicle. A speed or a length may be replaced by a time or its inverse, such as 1/TTC.
    """
    names = list(units)
    column = dict(zip(names, x.T, strict=True))

    def fault(text: str, remedy: str, needed: float, unit: str = "", **columns: Array) -> Fault:
        changed = x.copy()
        for name, values in columns.items():
            changed[:, names.index(name)] = values
        return Fault(text, frozenset(columns), remedy, needed, changed, unit)

    alike = {unit: [name for name in names if units[name] == unit] for unit in FACTORS}
    for unit, own in alike.items():
        for group in [*([name] for name in own), *([own] if len(own) > 1 else [])]:
            what = " and ".join(group)
            for other, factor in FACTORS[unit].items():
                scaled = {name: column[name] / factor for name in group}
                needed = FEET if other == "ft" else UNIT
                yield fault(
                    f"{what} in {other}", _in_units(dict.fromkeys(group, other)), needed, other, **scaled
                )
                scaled = {name: column[name] * factor for name in group}
                text = f"{what} in {unit}, but converted as if in {other}"
                yield fault(text, _in_units(dict.fromkeys(group, unit)), UNIT, **scaled)
    for chosen in product(["mph", "ft/s"], repeat=len(alike["m/s"])):
        stated = dict.fromkeys(alike["m"], "ft") | dict(zip(alike["m/s"], chosen, strict=True))
        if len({*stated.values()}) > 1:
            scaled = {name: column[name] * {**SPEED, **LENGTH}[unit] for name, unit in stated.items()}
            text = ", ".join(f"{name} in {unit}" for name, unit in stated.items())
            yield fault(text, _in_units(stated), RARE, **scaled)
    for one, other in combinations(names, 2):
        exchanged = {one: column[other], other: column[one]}
        yield fault(f"{one} and {other} exchanged", "exchange the names of the columns", RARE, **exchanged)
    for one, other in permutations([name for name in names if units[name] == "m/s"], 2):
        host = (one, other) == ("lead_speed", "closing_speed")
        text = "the host speed in the column of lead_speed" if host else f"{one} + {other} in place of {one}"
        remedy = (
            "name the column under data.table.columns.host_speed" if host else f"subtract {other} from {one}"
        )
        yield fault(text, remedy, SUM, **{one: column[one] - column[other]})
        text = f"{one} - {other} in place of {one}"
        yield fault(text, f"add {other} to {one}", SUM, **{one: column[one] + column[other]})
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for length, speed in ((names[i], names[j]) for i, j in _times(units)):
            multiplied = column[length] * column[speed]
            time, inverse = f"a time, {length} / {speed},", f"an inverse time, {speed} / {length},"
            multiply = f"multiply {speed} by {length}"
            if speed == "closing_speed":
                time, inverse = "the TTC", "1/TTC"
                multiply = f"set {COLUMNS[speed]}.quantity to ttc, and its unit to 1/s"
            times = f"multiply {length} by {speed}"
            yield fault(f"{time} in place of {length}", times, RARE, **{length: multiplied})
            yield fault(f"{inverse} in place of {speed}", multiply, RARE, **{speed: multiplied})
            divide = multiply.replace("1/s", "s").replace("multiply", "divide")
            quotient = column[length] / column[speed]
            yield fault(f"{time} in place of {speed}", divide, RARE, **{speed: quotient})


def _in_units(stated: Mapping[str, str]) -> str:
    """Return what to do if the columns have the stated units, and not those that they are taken to have."""
    remedy = "set {}.unit to {}" if set(stated) <= set(COLUMNS) else "convert {} from {}"
    return " and ".join(remedy.format(COLUMNS.get(name, name), unit) for name, unit in stated.items())


@dataclass(frozen=True)
class Comparison:
    """The records and the known ones, and what remains of their distance without each likely fault."""

    units: Mapping[str, str]
    limits: Mapping[str, tuple[float, float]]
    x: Array  # the records, shape (n, d); of cut-ins those that close in
    known: Mapping[str, Array]  # kinds of known records by name
    are_cut_ins: bool

    @classmethod
    def of(cls, records: Records) -> "Comparison | None":
        """Return the comparison; None without known records, or if there are too few rows."""
        known = known_cut_ins() if records.are_cut_ins else {"the project": records.known}
        if any(table is None for table in known.values()):
            return None
        names, are_cut_ins = records.variables, records.are_cut_ins
        tables = {name: _some(table[names].to_numpy(float), are_cut_ins) for name, table in known.items()}
        x = _some(records.valid[names].to_numpy(float), are_cut_ins)
        if len(x) < MINIMUM_ROWS or not tables:
            return None
        return cls(records.units, records.limits, x, tables, are_cut_ins)

    @cached_property
    def smallest(self) -> Array:
        """The magnitudes below which values are not distinguished, shape (d,)."""
        return SMALLEST * np.median(np.abs(np.concatenate(list(self.known.values()))), axis=0)

    @cached_property
    def pictures(self) -> dict[str, Picture]:
        """The pictures of the known records."""
        return {name: Picture.of(x, self.units, self.smallest) for name, x in self.known.items()}

    def picture(self, x: Array) -> Picture:
        """Return the picture of points."""
        return Picture.of(x, self.units, self.smallest)

    def nearest(self, x: Array) -> tuple[float, str]:
        """Return the distance of points from the known records of the nearest kind, and its name."""
        picture = self.picture(x)
        return min((picture.distance(other), name) for name, other in self.pictures.items())

    @cached_property
    def distance(self) -> float:
        """The distance of the records as they are."""
        return self.nearest(self.x)[0]

    @cached_property
    def without(self) -> list[tuple[float, Fault]]:
        """The distance without each likely fault; impossible ones are left out.

        The first fault has the smallest product of this distance and the ratio that it needs.
        """
        found = []
        for fault in _faults(self.x, self.units):
            possible = self._possible(fault.corrected)
            if possible.mean() >= 1 - MANY:
                found.append((self.nearest(fault.corrected[possible])[0], fault))
        return sorted(found, key=lambda pair: pair[1].needed * pair[0])

    @property
    def explanations(self) -> list[tuple[float, Fault]]:
        """The faults that explain the distance, the best first, with the distance without each."""
        ratios = (fault.needed if self.distance > FAR else RARE for _, fault in self.without)
        return [
            (left, fault)
            for (left, fault), ratio in zip(self.without, ratios, strict=True)
            if self.distance > max(ratio * left, SLIGHT)
        ]

    @property
    def rivals(self) -> list[Fault]:
        """The best explanation, and other faults that the records do not distinguish from it.

        A fault is distinguished if it explains the distance `UNIT` times worse, the ratio by which another
        unit must be better than other traffic. Otherwise, the best remedy would often be a wrong one.
        """
        best_left, best = self.explanations[0]
        farthest = UNIT * best.needed * best_left
        near = (fault for left, fault in self.without if fault.needed * left <= farthest)
        return [best, *(fault for fault in near if fault.remedy != best.remedy)]

    def _possible(self, x: Array) -> NDArray[np.bool_]:
        """Return which points are encounters; only magnitudes count where the limits exclude one sign."""
        low, high = np.array([self.limits.get(name, (-np.inf, np.inf)) for name in self.units]).T
        signed = np.where(low < 0, x, np.abs(x)) if not self.are_cut_ins else x
        possible = np.isfinite(x).all(axis=1) & ((signed >= low) & (signed <= high)).all(axis=1)
        return (
            possible & (x[:, list(self.units).index("closing_speed")] > 0) if self.are_cut_ins else possible
        )

    def differences(self) -> str:
        """Return in words what differs most from the known records of the nearest kind."""
        name = self.nearest(self.x)[1]
        factors = self.picture(self.x).factors(self.pictures[name], self.units)
        large = sorted(factors, key=lambda each: -abs(np.log(factors[each])))[:SHOWN]
        named = [f"{each} {factors[each]:.2g}" for each in large if abs(np.log(factors[each])) > SMALL]
        found = f"medians in multiples of the known ones: {', '.join(named)}" if named else "similar medians"
        return f"nearest known records: {name}; {found}"

    def effect(self, fault: Fault) -> str:
        """Return in words how the hardest encounters would change if the records had this fault."""
        if not {"m", "m/s"} <= set(self.units.values()):
            return "The answer changes with it"
        corrected = fault.corrected[self._possible(fault.corrected)]
        before, after = (self._hardest(x) for x in (self.x, corrected))
        change = "larger" if after > before else "smaller"
        return (
            f"If so, the hardest 1 % of the records need a deceleration of {after:.2g} m/s² and not of "
            f"{before:.2g} m/s², and the probability of a crash is {change}"
        )

    def _hardest(self, x: Array) -> float:
        """Return the quantile 0.99 of speed² / (2 length), with the closing speed, or the first speed."""
        names, kinds = list(self.units), list(self.units.values())
        speed = names.index("closing_speed") if self.are_cut_ins else kinds.index("m/s")
        length = kinds.index("m")
        way = np.maximum(np.abs(x[:, length]), self.smallest[length])
        return float(np.quantile(x[:, speed] ** 2 / (2 * way), 0.99))


@cache
def known_cut_ins() -> dict[str, pd.DataFrame]:
    """Return the cut-ins that come with the project, by kind of traffic."""
    own = complete(pd.read_parquet(project_file("data/spmd/cut_ins.parquet"))).drop_duplicates()
    speed = own["lead_speed"]
    return {
        "Safety Pilot": own,
        "Safety Pilot below 15 m/s": own[speed < 15],
        "Safety Pilot at 15 to 25 m/s": own[speed.between(15, 25)],
        "Safety Pilot above 25 m/s": own[speed > 25],
        "European motorways": pd.read_csv(project_file("data/europe/cut_ins.csv")),
    }


def _some(x: Array, are_cut_ins: bool) -> Array:
    """Return at most about `ENOUGH` points, spread over all; of cut-ins, those that close in."""
    x = x[(x[:, 1:] > 0).all(axis=1)] if are_cut_ins else x
    return x[:: max(len(x) // ENOUGH, 1)]


@CHECKS.add("known_records")
def known_records(records: Records) -> Finding:
    """Compare the records with known ones of the scenario, as they are and without each likely fault.

    The distance is a typical difference of quantiles and rank correlations, in multiples of the usual
    difference between two kinds of traffic. The verdict is ``warning`` if a fault explains the distance, or
    if the distance is large without an explanation. It is ``stop`` if the records without the fault are
    similar to the known ones and at least `CERTAIN` times nearer. The number is the distance.
    """
    looked_at = "differences from the records of the project, as they are and without each likely fault"
    compared = Comparison.of(records)
    if compared is None:
        return Finding(FINE, looked_at, "not checked: no known records, or too few rows", 0.0)
    seen, advice = f"distance {compared.distance:.2f}; {compared.differences()}", ""
    verdict = WARNING if compared.distance > (OTHER_CUT_INS if compared.are_cut_ins else OTHER) else FINE
    if explanations := compared.explanations:
        left, best = explanations[0]
        is_certain = left < SIMILAR and compared.distance > CERTAIN * left
        verdict = STOP if is_certain else WARNING
        rivals = [fault.text for fault in compared.rivals]
        if len(rivals) == 1 and (is_certain or not best.is_like_traffic):
            found = f"probably {best.text}: the distance is {left:.2f} without it"
            own = " (in a source of your own, convert them there)" if "data.table" in best.remedy else ""
            advice = f"If this is what the columns contain, {best.remedy}{own}. "
        else:
            possible = ", or ".join([*([] if is_certain else ["other traffic"]), *rivals[:SHOWN]])
            found = (
                f"the records do not distinguish: {possible}; without {best.text}, the distance is {left:.2f}"
            )
            advice = (
                "Change nothing unless the description of the records states one of these: each of them, and "
                "often dense or free traffic, explains the records as well. "
            )
        seen = f"{found}. {compared.effect(best)}; {seen}"
    return Finding(
        verdict,
        looked_at,
        seen,
        compared.distance,
        f"{advice}Check the units and the order of the columns. If they are right, the records describe "
        "other traffic than the known ones, which is no fault.",
    )
