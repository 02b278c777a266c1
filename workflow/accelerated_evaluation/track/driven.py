"""The outcome of a run that was driven, or that need not be driven."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from accelerated_evaluation.vehicles.protocol import Outcomes


@dataclass(frozen=True)
class DrivenOutcome:
    """The reported outcome of a run that was driven.

    Attributes
    ----------
    crash
        Whether the cars touched.
    min_range, min_ttc, impact_speed
        Smallest range [m], smallest time to collision [s] and closing speed at the crash [m/s]; None if not
        measured.
    note
        A remark of the people on the track.
    """

    crash: bool
    min_range: float | None = None
    min_ttc: float | None = None
    impact_speed: float | None = None
    note: str = ""


BEYOND = DrivenOutcome(False, note="beyond the limits, not to be driven")


def outcomes_of(driven: Iterable[DrivenOutcome]) -> Outcomes:
    """Return reported outcomes as `Outcomes`.

    Quantities that were not measured get their least dangerous value.
    """
    rows = list(driven)
    crash = np.array([row.crash for row in rows])

    def column(name: str, unknown: Any) -> np.ndarray:  # noqa: ANN401
        values = [getattr(row, name) for row in rows]
        return np.where([value is None for value in values], unknown, np.array(values, dtype=float))

    return Outcomes(
        crash,
        column("min_range", np.where(crash, 0.0, np.inf)),
        column("min_ttc", np.where(crash, 0.0, np.inf)),
        column("impact_speed", 0.0),
    )


def outcome_in_words(driven: DrivenOutcome) -> str:
    """Return the outcome of a run as text for a message."""
    words = ["crash" if driven.crash else "no crash"]
    for name in ("min_range", "min_ttc", "impact_speed"):
        if getattr(driven, name) is not None:
            words.append(f"{name} {getattr(driven, name):g}")
    return ", ".join(words)
