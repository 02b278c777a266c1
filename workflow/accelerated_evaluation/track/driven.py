"""The outcome of a run that was driven, or that need not be driven."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from accelerated_evaluation.scenarios.protocol import Scenario


@dataclass(frozen=True)
class DrivenOutcome:
    """The reported outcome of a run that was driven.

    Attributes
    ----------
    crash
        Whether there was a crash.
    measured
        The measured outcomes by name, such as the smallest range; those that were not measured are left out.
    note
        A remark of the people on the track.
    """

    crash: bool
    measured: Mapping[str, float] = field(default_factory=dict)
    note: str = ""


BEYOND = DrivenOutcome(False, note="beyond the limits, not to be driven")


def outcomes_of(driven: Iterable[DrivenOutcome], scenario: Scenario) -> Any:  # noqa: ANN401
    """Return reported outcomes as the outcomes of the scenario.

    Quantities that were not measured get their least dangerous value: that of contact after a crash, and
    otherwise infinity, if an event is scored by the quantity; 0 for all others. Runs on a track have ended.
    """
    rows = list(driven)
    crash = np.array([row.crash for row in rows])
    nearness = {event.scored_by for event in scenario.events}

    def column(name: str) -> np.ndarray:
        unknown = np.where(crash, 0.0, np.inf) if name in nearness else np.zeros(len(rows))
        given = zip(rows, unknown.tolist(), strict=True)
        return np.array([row.measured.get(name, value) for row, value in given])

    columns = {name: column(name) for name in scenario.measured}
    flags = {each.name: np.ones(len(rows), bool) for each in scenario.outcomes if each.is_flag}
    return scenario.outcome_type(**flags | {"crash": crash} | columns)


def outcome_in_words(driven: DrivenOutcome) -> str:
    """Return the outcome of a run as text for a message."""
    measured = [f"{name} {value:g}" for name, value in driven.measured.items()]
    return ", ".join(["crash" if driven.crash else "no crash", *measured])
