"""A toy: a check of records that counts large speeds of the vehicle under test."""

from accelerated_evaluation.records.checks import CHECKS, FINE, Finding, Records, needs


@CHECKS.add("toy_check")
@needs("speed_mps")
def toy_check(records: Records) -> Finding:
    """Count speeds above 15 m/s; the verdict is always fine."""
    fast = int((records.valid["speed_mps"] > 15).sum())
    return Finding(FINE, "speeds above 15 m/s", f"{fast} of them", fast)
