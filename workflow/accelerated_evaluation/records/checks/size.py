"""Checks whether enough records are left: within the limits, in each segment, and in its tail."""

import numpy as np

from accelerated_evaluation.records.checks import (
    CHECKS,
    CUT_INS,
    FINE,
    MANY,
    STOP,
    WARNING,
    Finding,
    Records,
    needs,
)
from accelerated_evaluation.records.segments import MINIMUM_ROWS

TAIL = 0.05  # share of the rows above the knot of TTC^-1
ENOUGH, FEW = 100, 10  # rows in a tail; the standard error of its rate is then 10 % and 30 %
CELL = (5.0, 10.0)  # [m/s], [m]: size of a cell of lead speed and range


@CHECKS.add("rows_outside_limits")
def rows_outside_limits(records: Records) -> Finding:
    """Check how many records the limits of the study exclude, and how many of these are impossible.

    Only cut-ins in which the gap closes are counted. Impossible rows are counted because limits that are
    derived from the records (``auto``) exclude them without the user noticing. The number is the share of the
    records that is excluded.
    """
    considered = records.valid[records.valid["closing_speed"] > 0] if records.are_cut_ins else records.valid
    rows = considered.index.difference(records.kept.index)
    share = len(rows) / max(len(considered), 1)
    left_out = considered.loc[rows]
    impossible = {name: ~left_out[name].between(*limits) for name, limits in records.limits.items()}
    count = int(np.any(list(impossible.values()), axis=0).sum())
    named = [
        f"{flags.sum():,} with {name} not from {low:g} to {high:g} {records.units[name]}"
        for (name, flags), (low, high) in zip(impossible.items(), records.limits.values(), strict=True)
        if flags.any()
    ]
    return Finding(
        FINE if len(rows) == 0 else STOP if share > 0.5 or count > MANY * len(considered) else WARNING,
        "rows outside of the limits of the variables; of cut-ins, rows that close outside of filters",
        f"{len(rows):,} of {len(considered):,} rows ({share:.1%}){': ' if named else ''}{', '.join(named)}",
        share,
        "Correct the units and signs if rows are impossible. Otherwise widen the limits (of cut-ins, in "
        "filters, or set them to auto); the result is valid only inside the limits.",
        list(rows),
    )


@CHECKS.add("sample_size")
@needs(*CUT_INS)
def sample_size(records: Records) -> Finding:
    """Check whether each segment has enough distinct rows.

    Rows in cells of lead speed and range are counted as well, without an influence on the verdict.

    The verdict is ``stop`` if the smallest segment has fewer than `MINIMUM_ROWS` rows, and ``warning`` if 5 %
    of its rows, the share in a tail, are fewer than that. The number is that of the rows of the smallest
    segment.
    """
    counts = {name: len(rows) for name, rows in records.segments.items()}
    smallest = min(counts, key=counts.get)
    kept = records.kept
    cells = kept.groupby([(kept["lead_speed"] // CELL[0]), (kept["range"] // CELL[1])]).size()
    thin = int((cells < MINIMUM_ROWS).sum())
    size = counts[smallest]
    return Finding(
        STOP if size < MINIMUM_ROWS else WARNING if TAIL * size < MINIMUM_ROWS else FINE,
        "distinct rows by segment of lead speed, and in cells of 5 m/s by 10 m",
        f"{'; '.join(f'{name} m/s: {count:,}' for name, count in counts.items())}; "
        f"{thin} of {len(cells)} cells with rows have fewer than {MINIMUM_ROWS}",
        size,
        "Join segments (segments.lead_speed_edges), or add records there.",
    )


@CHECKS.add("size_of_tail")
@needs(*CUT_INS)
def size_of_tail(records: Records) -> Finding:
    """Check the number of rows to which the tail of TTC^-1 is fitted, in the segment with the fewest.

    The tail consists of the largest values of a segment, a share `TAIL` of its distinct rows. The verdict is
    ``stop`` below `FEW` rows, and ``warning`` below `ENOUGH`.
    """
    sizes = {
        name: int((rows["inverse_ttc"] > np.quantile(rows["inverse_ttc"], 1 - TAIL)).sum())
        for name, rows in records.segments.items()
        if len(rows)
    }
    size = min(sizes.values(), default=0)
    error = f", so its rate is known within {1 / np.sqrt(size):.0%}" if size else ""
    return Finding(
        STOP if size < FEW else WARNING if size < ENOUGH else FINE,
        f"distinct rows in the uppermost {TAIL:.0%} of TTC^-1, to which its tail is fitted, by segment",
        f"{'; '.join(f'{name} m/s: {count:,}' for name, count in sizes.items())}; the smallest has "
        f"{size:,}{error}",
        size,
        "Add records, join segments, or lower the knot (models.inverse_ttc.knots).",
    )
