"""The reported outcomes of runs that were driven on a proving ground."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from accelerated_evaluation.scenarios.protocol import Scenario


@dataclass(frozen=True)
class DrivenOutcome:
    """The reported outcome of a run that was driven."""

    crash: bool
    # By name, such as the smallest range; quantities that were not measured are left out.
    measured: dict[str, float] = field(default_factory=dict)
    note: str = ""  # a remark of the testers


BEYOND = DrivenOutcome(False, note="beyond the limits, not to be driven")


def outcomes_of(driven: Iterable[DrivenOutcome], scenario: Scenario) -> Any:  # noqa: ANN401
    """Convert reported outcomes to the type of outcomes that a simulation of the scenario returns.

    If an event is scored by a quantity that was not measured, the quantity gets the value 0 after a crash and
    infinity otherwise. All other quantities that were not measured are 0, or NaN if they are optional. All
    runs are marked as ended.
    """
    rows = list(driven)
    crash = np.array([row.crash for row in rows])
    nearness = {event.scored_by for event in scenario.events}

    without = {each.name: np.nan if each.optional else 0.0 for each in scenario.outcomes}

    def column(name: str) -> np.ndarray:
        unknown = np.where(crash, 0.0, np.inf) if name in nearness else np.full(len(rows), without[name])
        given = zip(rows, unknown.tolist(), strict=True)
        return np.array([row.measured.get(name, value) for row, value in given])

    columns = {name: column(name) for name in scenario.measured}
    flags = {each.name: np.ones(len(rows), bool) for each in scenario.outcomes if each.is_flag}
    return scenario.outcome_type(**flags | {"crash": crash} | columns)


def outcome_in_words(driven: DrivenOutcome) -> str:
    """Return the outcome of a run as text for a message, such as ``no crash, min_range 2.5``."""
    measured = [f"{name} {value:g}" for name, value in driven.measured.items()]
    return ", ".join(["crash" if driven.crash else "no crash", *measured])
