"""Checks of the units by limits of physics and traffic."""

import numpy as np
import pandas as pd
from scipy.stats import binom, spearmanr

from accelerated_evaluation.base.numerals import counted
from accelerated_evaluation.records.checks import (
    CHECKS,
    CUT_INS,
    FINE,
    LEVEL,
    MANY,
    STOP,
    WARNING,
    Finding,
    Records,
    by_share,
    needs,
)
from accelerated_evaluation.records.checks.known import Comparison
from accelerated_evaluation.records.limits import FARTHEST, FASTEST

FASTEST_TRAFFIC = 45.0  # [m/s], 162 km/h: on no road is half of the vehicles faster
LONGEST_GAP = 5.0  # [s]: vehicles farther apart do not follow each other (Highway Capacity Manual 1985)
SHORTEST_GAP = 0.5  # [s]: no driver reacts faster, so half of the drivers cannot have shorter gaps
NEAREST = 3.0  # [m]: a camera behind the windscreen does not see the road that is nearer to the bumper
FULL_BRAKING = 9.81  # [m/s^2]: largest deceleration that tyres can transmit
# Crashes of human drivers per lane change: one in 500,000 miles, with a lane change every 5 miles (the paper)
CRASHES = 1e-5


@CHECKS.add("invalid_values")
def invalid_values(records: Records) -> Finding:
    """Check for rows that are not a valid encounter: missing, negative, infinite or impossible values."""
    rows, size = list(records.invalid), len(records.valid) + len(records.invalid)
    example, correction = records.no_number
    return Finding(
        by_share(len(rows), size),
        "missing, infinite or non-numeric values; of cut-ins also negative values and speeds above 300 m/s",
        f"{len(rows):,} of {size:,} rows{example and f'; {example}'}",
        len(rows),
        f"{correction}Correct these rows. They are left out only if data.invalid_rows is drop.",
        rows,
    )


@CHECKS.add("speed_unit")
@needs(*CUT_INS)
def speed_unit(records: Records) -> Finding:
    """Check whether the speeds are plausible as speeds of road traffic in m/s.

    The verdict is ``stop`` if the median lead speed exceeds 45 m/s, or if more than 1 % of the rows have a
    speed above 70 m/s. The verdict is ``warning`` if there is any such row, or if the source could not check
    its units. The number is the median lead speed [m/s], and the rows are those with too high a speed.
    """
    fastest = np.maximum(records.valid["lead_speed"], records.host_speed)
    median, rows = records.valid["lead_speed"].median(), fastest[fastest > FASTEST]
    verdict = STOP if median > FASTEST_TRAFFIC else by_share(len(rows), len(fastest))
    if verdict == FINE and records.warnings:
        verdict = WARNING
    return Finding(
        verdict,
        f"median lead speed, at most {FASTEST_TRAFFIC:g} m/s on any road; speeds above {FASTEST:g} m/s",
        "; ".join(
            [
                f"median {median:.1f} m/s, largest speed of either vehicle {fastest.max():.1f} m/s",
                *records.warnings,
            ]
        ),
        float(median),
        "Check the unit of the column (km/h or mph taken for m/s?), and that no columns are swapped.",
        list(rows.sort_values(ascending=False).index),
    )


@CHECKS.add("time_gap")
@needs(*CUT_INS)
def time_gap(records: Records) -> Finding:
    """Check whether the median time gap, the range divided by the host speed, is plausible.

    A median outside of `SHORTEST_GAP` to `LONGEST_GAP` (0.5 to 5 s) means that the units of range and speed
    do not fit together.
    """
    moving = records.host_speed > 0
    median = float((records.valid["range"][moving] / records.host_speed[moving]).median())
    return Finding(
        FINE if SHORTEST_GAP <= median <= LONGEST_GAP else STOP,
        f"median time gap, range / host speed; {SHORTEST_GAP:g} to {LONGEST_GAP:g} s in traffic",
        f"median {median:.2f} s",
        median,
        "Check the units of range and lead speed (feet taken for metres, m/s for km/h?); swapped columns?",
    )


@CHECKS.add("unavoidable_crashes")
@needs(*CUT_INS)
def unavoidable_crashes(records: Records) -> Finding:
    """Check for records in which even full braking could not have avoided a crash.

    A constant deceleration of closing speed^2 / (2 range) is needed to avoid the crash. The number of rows in
    which it exceeds `FULL_BRAKING` is compared with the crash rate of human drivers. The verdict is ``stop``
    if there are more such rows than by chance. The number is the largest deceleration that is needed [m/s^2].
    """
    valid = records.valid
    needed = valid["closing_speed"].clip(lower=0) ** 2 / (2 * valid["range"])
    rows = needed[needed > FULL_BRAKING].sort_values(ascending=False)
    is_chance = binom.sf(len(rows) - 1, len(needed), CRASHES) >= LEVEL
    return Finding(
        FINE if rows.empty else WARNING if is_chance else STOP,
        f"rows that need more than {FULL_BRAKING:g} m/s^2, closing^2 / (2 range): these must have crashed, "
        f"and human drivers crash in at most {CRASHES:g} of the lane changes",
        f"{len(rows):,} of {len(needed):,} rows; largest {needed.max():.2f} m/s^2",
        float(needed.max()),
        "Check the units of closing speed and range (km/h taken for m/s?), and that no columns are swapped.",
        list(rows.index),
    )


@CHECKS.add("sign_of_range_rate")
@needs(*CUT_INS)
def sign_of_range_rate(records: Records) -> Finding:
    """Check the sign of the range rate, by the share of rows with a growing range and by a rank correlation.

    If the sign is wrong, the range seems to grow in most rows. If it grows in only a part of the rows, the
    rank correlation of range and closing speed decides. It is positive if the sign is right, because drivers
    who are slower than the car behind keep more distance to it. The number is the share of the rows with a
    growing range.
    """
    range_, closing = records.valid["range"], records.valid["closing_speed"]
    opening = float((closing <= 0).mean())
    verdict, seen = FINE, f"{opening:.1%} of the rows open"
    if opening > 1 - MANY:
        verdict = STOP
    elif opening > MANY:
        found = spearmanr(range_, closing)
        verdict = WARNING if found.statistic < 0 and found.pvalue < LEVEL else FINE
        seen += f"; rank correlation of range and closing speed {found.statistic:.2f}"
    return Finding(
        verdict,
        "share of rows whose gap opens; whether the closing speed increases with the range, as in traffic",
        seen,
        opening,
        "Change the sign: a range rate is negative when the gap closes (quantity: range_rate), a closing "
        "speed is positive.",
        list(closing.index[closing <= 0]) if verdict != FINE else (),
    )


@CHECKS.add("far_ranges")
@needs(*CUT_INS)
def far_ranges(records: Records) -> Finding:
    """Check for ranges above `FARTHEST` (300 m), which are beyond the reach of automotive sensors.

    If the known records show that the ranges have another unit, the advice does not mention the filter, which
    would only hide a part of the fault.
    """
    range_ = records.valid["range"]
    rows = range_[range_ > FARTHEST].sort_values(ascending=False)
    advice = "Check the unit of the range. Only if it is right, leave these rows out with filters.range_max."
    compared = Comparison.of(records) if len(rows) else None
    for _, fault in () if compared is None else compared.explanations:
        if "range" in fault.columns:
            advice = f"These are probably records with {fault.text}: {fault.remedy}."
            break
    return _outside(
        rows,
        len(range_),
        f"ranges above {FARTHEST:g} m, which no radar or camera of a car reaches",
        f"largest {range_.max():.1f} m",
        advice,
    )


@CHECKS.add("short_ranges")
@needs(*CUT_INS)
def short_ranges(records: Records) -> Finding:
    """Check for ranges below `NEAREST` (3 m), which are too short for a lane change."""
    range_ = records.valid["range"]
    return _outside(
        range_[range_ < NEAREST].sort_values(),
        len(range_),
        f"ranges under {NEAREST:g} m, which a camera behind the windscreen cannot see",
        f"smallest {range_.min():.2f} m",
        "Inspect these rows: another lane, a false target? Table data_quality has the answer without them.",
    )


def _outside(rows: pd.Series, size: int, what: str, extreme: str, advice: str) -> Finding:
    """Return the finding about rows outside of a limit; ``rows`` has their values, the worst first."""
    seen = f"{counted(len(rows), 'row')}; {extreme}"
    return Finding(by_share(len(rows), size), what, seen, len(rows), advice, list(rows.index))
