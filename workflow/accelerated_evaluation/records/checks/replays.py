"""Check of the outcomes when a vehicle replays the recorded encounters."""

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
# Largest share of crashes in records of other scenarios than the cut-in. Their vehicles are less careful than
# the recorded drivers: the vehicle of the left turn crashes in 2 % of the records of the project.
MANY_CRASHES = 0.1


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
