"""Checks of the order of the rows, for a drift of the records, and of the outcomes of replays."""

import numpy as np
from scipy.stats import norm

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.tables import CLUSTER
from accelerated_evaluation.records.checks import (
    CHECKS,
    CUT_INS,
    FINE,
    LEVEL,
    MANY,
    NAMED_ROWS,
    ORDER,
    STOP,
    WARNING,
    Finding,
    Records,
    needs,
)

DRIFTING = ("lead_speed", "range", "inverse_ttc")
BLOCKS = 10  # number of blocks of consecutive rows in a third of the record, for the jackknife
MEDIUM = 0.5  # difference of means in standard deviations, a medium effect (Cohen 1988)
NEAR_TTC, NEAR_RANGE = 1.0, 1.0  # [s], [m]; the crash map defines near misses by the same limits
# Largest share of crashes in records of other scenarios than the cut-in. Their vehicles are less careful than
# the recorded drivers: the vehicle of the left turn crashes in 2 % of the records of the project.
MANY_CRASHES = 0.1


@CHECKS.add("order_of_rows")
def order_of_rows(records: Records) -> Finding:
    """Check that the rows are not sorted by a quantity.

    Checks that compare neighbouring rows are not made if they are. The verdict is then ``stop`` if the laws
    are scored on blocks of consecutive rows, and ``warning`` if they are scored on whole clusters. The number
    is 1 if the rows are sorted, and otherwise 0.
    """
    name = records.sorted_by
    left_out = [check for check, made in CHECKS.items() if ORDER in getattr(made, "needs", ())]
    return Finding(
        FINE if not name else WARNING if CLUSTER in records.valid else STOP,
        "whether the rows are sorted by a quantity, and not in the order of recording",
        f"sorted by {name}" if name else "not sorted",
        float(bool(name)),
        "Give the rows in the order in which they were recorded, because neighbouring rows are held out "
        "together to compare models. If this order is unknown, shuffle the rows. Not checked in sorted rows: "
        f"{', '.join(left_out).replace('_', ' ')}.",
    )


@CHECKS.add("drift")
@needs(*CUT_INS, ORDER)
def drift(records: Records) -> Finding:
    """Test whether the first and the last third of the rows have the same distribution.

    The statistic of each variable is the probability that a value of the last third is larger than a value of
    the first third. Its standard error comes from a jackknife over blocks of consecutive rows, because rows
    of one trip are similar. The test level is divided by the number of variables (Bonferroni). The verdict is
    ``stop`` if a significant difference is larger than a medium effect. The number is the statistic of the
    variable with the most significant difference.
    """
    rows = records.closing
    looked_at = "chance that a value of the last third of the rows is larger than one of the first third"
    third = len(rows) // 3
    if third < 2 * BLOCKS:
        return Finding(FINE, looked_at, "too few rows for a test", 0.5)
    found = {}
    for name in DRIFTING:
        values = rows[name].to_numpy()
        found[name] = _superiority(values[:third], values[-third:])
    critical = norm.isf(LEVEL / 2 / len(DRIFTING))
    name = max(found, key=lambda name: abs(found[name][0] - 0.5) / found[name][1])
    chance, error = found[name]
    large = max(abs(value - 0.5) for value, _ in found.values()) > norm.cdf(MEDIUM / np.sqrt(2)) - 0.5
    drifts = abs(chance - 0.5) > critical * error
    return Finding(
        FINE if not drifts else STOP if large else WARNING,
        looked_at,
        "; ".join(
            f"{key.replace('_', ' ')} {p:.3f} +- {deviation:.3f}" for key, (p, deviation) in found.items()
        ),
        chance,
        "Plot the columns in the order of the rows: other places, vehicles, seasons, or a sensor that loses "
        "its calibration? The intervals assume that all rows are from one population.",
    )


def _superiority(first: Array, last: Array) -> tuple[float, float]:
    """Return the probability that a value of ``last`` exceeds one of ``first``, and its standard error."""
    blocks = [np.array_split(values, BLOCKS) for values in (first, last)]
    wins = np.array([[_wins(a, b) for b in blocks[1]] for a in blocks[0]])
    all_but = BLOCKS * (BLOCKS - 1)
    without = [(wins.sum() - wins.sum(axis=axis)) / all_but for axis in (0, 1)]
    variance = sum((BLOCKS - 1) * np.var(part) for part in without)
    return float(wins.mean()), float(np.sqrt(variance)) or np.finfo(float).tiny


def _wins(first: Array, last: Array) -> float:
    """Return the share of the pairs in which the value of ``last`` is larger; ties count by half."""
    ordered = np.sort(first)
    below = np.searchsorted(ordered, last, side="left") + np.searchsorted(ordered, last, side="right")
    return float(below.mean() / (2 * ordered.size))


@CHECKS.add("replayed_crashes")
def replayed_crashes(records: Records) -> Finding:
    """Simulate the records within the limits, and report crashes and, for cut-ins, near misses.

    A near miss has a time to collision below 1 s or a range below 1 m. The verdict is ``stop`` if more than 1
    % of the cut-ins crash, or more than 10 % of the encounters of another scenario. It is ``warning`` if
    there is any crash or near miss.
    """
    near_miss = f", or come to a TTC under {NEAR_TTC:g} s or a range under {NEAR_RANGE:g} m"
    looked_at = f"rows that crash when the vehicle replays them{near_miss if records.are_cut_ins else ''}"
    if records.simulate is None or records.kept.empty:
        return Finding(FINE, looked_at, "not checked: no vehicle or no rows", 0.0)
    outcomes = records.outcomes
    crash = outcomes["crash"]
    crashes, nearly = outcomes.index[crash], outcomes.index[:0]
    if records.are_cut_ins:
        near = ~crash & ((outcomes["min_ttc"] < NEAR_TTC) | (outcomes["min_range"] < NEAR_RANGE))
        nearly = outcomes[near].sort_values("min_ttc").index
    most = MANY if records.are_cut_ins else MANY_CRASHES
    return Finding(
        STOP if crash.mean() > most else WARNING if len(crashes) + len(nearly) else FINE,
        looked_at,
        f"{len(crashes):,} of {len(crash):,} rows crash{_named(crashes)}"
        + (f", {len(nearly):,} nearly" if records.are_cut_ins else ""),
        len(crashes),
        "Inspect these rows with the command accelerated-evaluation replay: an error of the record, or of "
        "the vehicle? The recorded drivers did not crash, so with many crashes a unit may be wrong.",
        [*crashes, *nearly],
    )


def _named(rows: list[int]) -> str:
    """Return the first few row numbers in brackets."""
    return f" ({'; '.join(map(str, rows[:NAMED_ROWS]))})" if len(rows) else ""
