"""Checks of the distributions: accumulations at round numbers, gaps, cut edges and outliers."""

from collections.abc import Iterable, Iterator

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import binom, poisson

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.numerals import counted
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.records.checks import (
    CHECKS,
    CUT_INS,
    FINE,
    LEVEL,
    MANY,
    STOP,
    VERDICTS,
    WARNING,
    Finding,
    Records,
    by_share,
    needs,
)
from accelerated_evaluation.records.checks.known import Comparison

SPEED_UNITS = {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704}
# Units in which a sensor may have rounded. Metres that were exported in feet, and are taken for metres, are
# multiples of 1/0.3048.
UNITS = {
    "m/s": SPEED_UNITS | {"m/s in a column of km/h": 3.6, "m/s in a column of mph": 1 / 0.44704},
    "m": {"m": 1.0, "ft": 0.3048, "m in a column of ft": 1 / 0.3048},
}
STEPS = (10.0, 5.0, 1.0, 0.5)
OFFSETS = sorted({j / 10 for j in range(1, 10)} | {j / 16 for j in range(1, 16)})  # in steps
DIGITS = 5  # largest number of decimals, minus 1, of values that are on a grid
NEIGHBOURS = 50  # number of distinct values next to a value that give the expected count or distance
# Edges beyond which crashes lie. Values that accumulate there are a stop, however few rows have them.
CRITICAL, SATURATED = (("m/s", "largest"), ("m", "smallest")), 1e-6
MANY_EQUAL = 0.05  # share of records with the same value, which no smooth law can describe
MOST_EQUAL = 0.2  # share that is larger than those of road users who stand, so that it is a code or a fault
TOP = 100  # number of largest values; the standard error of their mean excess is 10 %
# Number of the largest values whose end is compared: a share of the rows within two limits.
TOP_SHARE, FEWEST, MOST = 0.01, 30, 500
# Shape of the generalised Pareto tail with the sharpest end of traffic. Tails of the recorded cut-ins have
# shapes above -0.1; that of an exponential tail whose top 1 % is missing is about -0.8.
SHARPEST, SAMPLES = -0.25, 5_000
SMALLEST, LARGEST_START = 0.01, 0.25  # in recorded cut-ins this quantile is at most 0.1 medians
EXTREMES = ("inverse_range", "inverse_ttc")  # quantities whose tails the models describe


@CHECKS.add("round_numbers")
def round_numbers(records: Records) -> Finding:
    """Check for rounding: more values on multiples of a step than on multiples plus an offset.

    The steps are 0.5, 1, 5 and 10 in several units. The number of values on multiples is compared with the
    largest number for any offset by a binomial test. If the test is significant, the verdict is ``stop`` if
    more than half of the values are on multiples, and otherwise ``warning``. The number is the share of the
    values on the most conspicuous multiples.
    """
    units = {name: UNITS.get(unit, {unit: 1.0}) for name, unit in records.units.items()}
    heaps, tests = [], sum(len(each) for each in units.values()) * len(STEPS)
    for name in records.units:
        values = records.measured(name)
        values = values[values != 0]  # because 0, the speed of a standing car, is a multiple of all steps
        grid = _grid(values.to_numpy(), units[name].values())
        for unit, factor in units[name].items():
            for step in STEPS:
                on, others = _on_lattices((values / (factor * step)).to_numpy(), grid / (factor * step))
                p = float(binom.sf(on.sum() - 1, on.sum() + others, 0.5)) * tests
                where = f"{name.replace('_', ' ')} on multiples of {step:g} {unit}"
                heaps.append((p, -on.mean() if on.size else 0.0, where, values.index[on], name, unit))
    p, minus_share, where, rows, name, unit = min(heaps, key=lambda heap: heap[:2])
    heaped = p < LEVEL
    meaning = _meaning(records, name, unit) if heaped and unit != records.units[name] else ""
    return Finding(
        FINE if not heaped else STOP if -minus_share > 0.5 else WARNING,
        "rows on multiples of 0.5, 1, 5 and 10 of m/s, km/h, mph, m and ft, compared with shifted lattices",
        f"most conspicuous: {where}, {counted(len(rows), 'row')} "
        f"({-minus_share:.1%}; p = {min(p, 1):.2g}){meaning}",
        -minus_share,
        "Use the values as they were measured, because rounded values make steps in the tails. Many values "
        "on multiples of another unit show the unit of the sensor.",
        list(rows) if heaped else (),
    )


def _meaning(records: Records, name: str, unit: str) -> str:
    """Return in words what values on multiples of another unit say about the unit of their column."""
    unit = unit.rpartition(" ")[-1]
    if (compared := Comparison.of(records)) is None:
        return f"; {name} was measured or exported in {unit}"
    of_unit = (left for left, fault in compared.without if (fault.unit, fault.columns) == (unit, {name}))
    left = min(of_unit, default=np.inf)
    now = compared.distance
    if left < now:
        nearer = f"the distance from the known records is then {left:.2f}, not {now:.2f}"
        return f"; the column {name} is probably in {unit}: {nearer}"
    return (
        f"; {name} was measured in {unit} and then converted, because the known records are nearer as it is"
    )


def _grid(values: Array, factors: Iterable[float]) -> float:
    """Return the largest decimal step, in any of some units, of which all values are multiples; else 0."""
    steps = sorted((factor * 10.0**-digits for factor in factors for digits in range(DIGITS)), reverse=True)
    return next((step for step in steps if _are_whole(values / step).all()), 0.0)


def _are_whole(steps: Array) -> NDArray[np.bool_]:
    return np.abs(steps - np.round(steps)) < 1e-5


def _on_lattices(steps: Array, grid: float) -> tuple[NDArray[np.bool_], int]:
    """Return which values are whole numbers, and the largest number of values on a shifted lattice.

    The values are in units of the step of the lattice. The lattices are shifted by `OFFSETS`, and by the
    multiples of the ``grid`` of the values that are next to these: of values with two decimals in metres,
    every 381st is a multiple of half a foot, and none is one plus a tenth of the step.
    """
    near = {round(offset / grid) * grid for offset in OFFSETS} if grid else set()
    offsets = {*OFFSETS, *(offset for offset in near if 0.01 < offset < 0.99)}
    return _are_whole(steps), max(int(_are_whole(steps - offset).sum()) for offset in offsets)


@CHECKS.add("cut_edges")
def cut_edges(records: Records) -> Finding:
    """Check for values that accumulate at the smallest or largest value of a quantity.

    The cause may be a limit of the export or a saturated sensor. The number of values at the edge is compared
    with the mean number at the `NEIGHBOURS` values next to it, by a Poisson test. Values at 0 are at most a
    warning, because cars may stand. Values at the largest speed or the smallest distance are a stop: nothing
    is known where crashes are. The number is that of the values at the most conspicuous edge.
    """
    found = [(FINE, 0.0, "none", pd.Index([]))]
    for name in records.units:
        column = records.valid[name].round(9)
        values, counts = np.unique(records.measured(name).round(9), return_counts=True)
        if values.size <= NEIGHBOURS:
            continue
        edges = {
            "smallest": (0, counts[1 : NEIGHBOURS + 1]),
            "largest": (-1, counts[-1 - NEIGHBOURS : -1]),
        }
        for word, (edge, neighbours) in edges.items():
            p = float(poisson.sf(counts[edge] - 1, neighbours.mean())) * 2 * len(records.units)
            if p >= LEVEL:
                continue
            rows = column.index[column == values[edge]]
            is_critical = p < SATURATED and (records.units[name], word) in CRITICAL
            verdict = STOP if is_critical else by_share(len(rows), len(column))
            verdict = WARNING if values[edge] == 0 else verdict
            text = f"the {word} {name.replace('_', ' ')}, {values[edge]:g} (p = {p:.2g})"
            found.append((verdict, -p, f"{counted(len(rows), 'row')} at {text}", rows))
    verdict, _, seen, rows = max(found, key=lambda entry: (VERDICTS.index(entry[0]), entry[1]))
    return Finding(
        verdict,
        "rows exactly at the smallest and largest value of a quantity, compared with its 50 neighbours",
        seen,
        len(rows),
        "The records were cut or the sensor saturates here. Set the limit of the variable (of cut-ins, in "
        "filters) to this value or inside of it, because nothing is known beyond this value.",
        list(rows),
    )


@CHECKS.add("gaps")
def gaps(records: Records) -> Finding:
    """Check for gaps: intervals without a value, between values that are dense on both sides.

    The widest gap of each quantity is compared with the distances of the 50 values on either side. The
    verdict is ``warning`` if the gap is unlikely for a density that is constant nearby. The number is the
    width of the most conspicuous gap, and the rows are those at its ends.
    """
    worst = (1.0, "no gap", 0.0, 0.0, records.variables[0])
    for name in records.units:
        values = np.unique(records.measured(name).round(9))
        for p, low, high in _widest(values):
            text = f"{name.replace('_', ' ')} from {low:.4g} to {high:.4g}"
            worst = min(worst, (p * len(records.units), text, low, high, name), key=lambda entry: entry[0])
    p, where, low, high, name = worst
    hole = p < LEVEL
    return Finding(
        WARNING if hole else FINE,
        "widest interval without a value, compared with the distances of the 50 values on either side",
        f"{where} (p = {min(p, 1):.2g})",
        high - low,
        "Find out what is missing: a lost file, a filter, a sensor that jumps. The answer uses the shares of "
        "the lead speeds as they are recorded.",
        list(records.valid.index[records.valid[name].round(9).isin([low, high])]) if hole else (),
    )


def _widest(values: Array) -> Iterator[tuple[float, float, float]]:
    """Yield the p-value and the ends of the gap that is widest relative to its neighbourhood.

    If the density is locally constant, the ratio of a distance to the sum of m other distances exceeds r with
    probability (1 + r)^-m. The neighbouring distances are those on the side with the lower density. The
    p-value is multiplied by the number of gaps. Nothing is yielded if there are too few values. The distinct
    values are in increasing order.
    """
    if values.size < 2 * NEIGHBOURS + 2:
        return
    place = np.arange(NEIGHBOURS, values.size - NEIGHBOURS - 1)
    below = values[place] - values[place - NEIGHBOURS]
    above = values[place + 1 + NEIGHBOURS] - values[place + 1]
    hole = values[place + 1] - values[place]
    log_p = -NEIGHBOURS * np.log1p(hole / np.maximum(below, above))
    first = int(np.argmin(log_p))
    p = float(np.exp(log_p[first])) * place.size
    yield p, float(values[place[first]]), float(values[place[first] + 1])


@CHECKS.add("equal_values")
def equal_values(records: Records) -> Finding:
    """Check for a value that many fitted records share, such as a constant or a code for missing values.

    The verdict is ``stop`` above `MOST_EQUAL`. It is ``warning`` above `MANY_EQUAL`, or above `MANY` if the
    value is much more frequent than the second most frequent one (by a Poisson test). The number is the
    largest share of records with the same value of a variable.
    """
    rows, looked_at = (
        records.fitted,
        "largest share of the fitted records that have the same value of a variable",
    )
    if rows.empty:
        return Finding(FINE, looked_at, "no fitted records", 0.0)
    found = []
    for name in records.units:
        counts = rows[name].value_counts().to_numpy()
        share, second = counts[0] / len(rows), counts[1] if counts.size > 1 else 0
        stands_out = share > MANY and poisson.sf(counts[0] - 1, second) * len(records.units) < LEVEL
        own = STOP if share > MOST_EQUAL else WARNING if share > MANY_EQUAL or stands_out else FINE
        found.append((VERDICTS.index(own), float(share), name))
    verdict, share, name = max(found)
    value = rows[name].value_counts().index[0]
    return Finding(
        VERDICTS[verdict],
        looked_at,
        f"{share:.1%} have {name} {value:g}",
        share,
        "Use the values as they were measured, and leave out rows without a measurement. Laws are smooth, "
        "and cannot describe a constant or many equal values that were rounded or stand for missing values.",
        list(rows.index[rows[name] == value]) if VERDICTS[verdict] != FINE else (),
    )


@CHECKS.add("outliers")
@needs(*CUT_INS)
def outliers(records: Records) -> Finding:
    """Check for values of R^-1 and TTC^-1 that are too large for the exponential tail of the models.

    The scale of the tail is estimated from the median excess of the `TOP` largest values. The p-value of a
    value is the probability that the largest of as many exponential variables exceeds it.

    The verdict is ``warning`` if there is any such value.
    """
    found: dict[int, float] = {}
    for name in EXTREMES:
        values = records.closing[name].sort_values(ascending=False)
        count = min(TOP, len(values) // 20)
        if count < 2:
            continue
        excess = values.iloc[:count] - values.iloc[count]
        scale = max(float(excess.median() / np.log(2)), np.finfo(float).tiny)
        with np.errstate(divide="ignore"):  # an excess is 0 if values are equal
            p = -np.expm1(count * np.log1p(-np.exp(-excess / scale))) * len(EXTREMES)
        found |= {row: min(value, found.get(row, 1.0)) for row, value in p[p < LEVEL].items()}
    rows = sorted(found, key=found.get)
    return Finding(
        WARNING if rows else FINE,
        "R^-1 and TTC^-1 larger than the exponential tail of their 100 largest values reaches by chance",
        counted(len(rows), "row") + (f"; smallest p = {found[rows[0]]:.2g}" if rows else ""),
        len(rows),
        "Inspect these rows one by one. List false rows under data.<source>.outlier_rows; table sensitivity "
        "then shows their influence on the result.",
        rows,
    )


@CHECKS.add("selection")
@needs(*CUT_INS)
def selection(records: Records) -> Finding:
    """Check whether the most critical cut-ins, or all but these, were left out.

    A cut-in is critical by its closing speed v, by 1/TTC = v / R, or by the deceleration v² / (2 R). Records
    of traffic thin out towards their largest value. If the critical ones were left out, many rows lie just
    below a sharp end: the mean excess of the largest values over a threshold is then nearly half of the
    largest excess. It is compared with samples from a generalised Pareto tail of the shape `SHARPEST`, which
    ends more sharply than tails of traffic do. The verdict is ``stop``, because the tail is missing. If the
    smallest values are a large part of the median, the others were left out. This is a ``warning``, because
    the law then describes the selected cut-ins. The number is the smallest p-value of the upper ends.
    """
    rows, looked_at = records.closing, "closing speed, TTC^-1 and v²/(2R): a sharp end, or no small values"
    size = min(max(int(TOP_SHARE * len(rows)), FEWEST), MOST)
    if len(rows) < 10 * size:
        return Finding(FINE, looked_at, "not checked: too few rows", 1.0)
    speed, range_ = rows["closing_speed"], rows["range"]
    measures = {"closing speed": speed, "TTC^-1": speed / range_, "v²/(2R)": speed**2 / (2 * range_)}
    uniform = child_generator(0, "selection").random((SAMPLES, size))
    sharp = (uniform**-SHARPEST - 1) / SHARPEST  # excesses of a generalised Pareto tail
    by_chance = sharp.mean(axis=1) / sharp.max(axis=1)
    p_values, starts = {}, {}
    for name, values in measures.items():
        threshold, *largest = np.sort(values.to_numpy())[-size - 1 :]
        excess = np.array(largest) - threshold
        reached = excess.mean() / excess.max() if excess.max() > 0 else 1.0
        p_values[name] = len(measures) * (1 + np.count_nonzero(by_chance >= reached)) / (1 + SAMPLES)
        starts[name] = float(values.quantile(SMALLEST) / values.median())
    end, start = min(p_values, key=p_values.__getitem__), max(starts, key=starts.__getitem__)
    is_cut, is_chosen = p_values[end] < LEVEL, starts[start] > LARGEST_START
    seen = f"{end} {'ends sharply at' if is_cut else 'thins out to'} {measures[end].max():.3g}"
    seen += f" (p = {min(p_values[end], 1):.2g}); {start} begins at {starts[start]:.2g} of its median"
    return Finding(
        STOP if is_cut else WARNING if is_chosen else FINE,
        looked_at,
        seen,
        p_values[end],
        "Find out how the records were selected, and use all cut-ins. Crashes are predicted from the most "
        "critical records; and the probability is that of a cut-in like these records.",
        list(measures[end].sort_values().index[::-1][:NEIGHBOURS]) if is_cut else (),
    )
