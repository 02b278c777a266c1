"""Check of the outcomes when the vehicle under test replays the recorded cut-ins."""

from accelerated_evaluation.records.checks import (
    CHECKS,
    FINE,
    MANY,
    NAMED_ROWS,
    STOP,
    WARNING,
    Finding,
    Records,
)

NEAR_TTC, NEAR_RANGE = 1.0, 1.0  # [s], [m]; the crash map defines near misses by the same limits


@CHECKS.add("replayed_crashes")
def replayed_crashes(records: Records) -> Finding:
    """Simulate the filtered rows with the vehicle under test, and report crashes and near misses.

    A near miss has a time to collision below 1 s or a range below 1 m. The verdict is ``stop`` if more than 1
    % of the rows crash, and ``warning`` if there is any crash or near miss.

    Returns
    -------
    Finding
        The verdict, the number of crashes, and the rows that crash or nearly crash.
    """
    looked_at = (
        f"rows that crash with the vehicle under test, or come to a TTC under {NEAR_TTC:g} s or a range "
        f"under {NEAR_RANGE:g} m"
    )
    if records.simulate is None or records.kept.empty:
        return Finding(FINE, looked_at, "not checked: no vehicle or no rows", 0.0)
    outcomes = records.outcomes
    crash = outcomes["crash"]
    near = ~crash & ((outcomes["min_ttc"] < NEAR_TTC) | (outcomes["min_range"] < NEAR_RANGE))
    crashes, nearly = outcomes.index[crash], outcomes[near].sort_values("min_ttc").index
    concerned = len(crashes) + len(nearly)
    return Finding(
        STOP if crash.mean() > MANY else WARNING if concerned else FINE,
        looked_at,
        f"{len(crashes):,} rows crash{_named(crashes)}, {len(nearly):,} nearly",
        len(crashes),
        "Inspect these rows with the command accelerated-evaluation replay: an error of the record, or of "
        "the vehicle? Table data_quality has the answer without the rows that crash.",
        [*crashes, *nearly],
    )


def _named(rows: list[int]) -> str:
    """Return the first few row numbers in brackets."""
    return f" ({'; '.join(map(str, rows[:NAMED_ROWS]))})" if len(rows) else ""
