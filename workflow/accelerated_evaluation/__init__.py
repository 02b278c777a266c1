"""Accelerated evaluation of automated vehicles: from records of encounters to a crash probability.

The names below are the public interface; docs/interface.md has an example of each.
"""

from importlib import import_module
from typing import Any

# The module of each public name. It is imported when the name is first used, because the compiler (numba) and
# the laws take a second.
_HOME = {
    # Configuration, randomness and errors.
    "InputError": "base.errors",
    "StudyError": "base.errors",
    "child_generator": "base.randomness",
    "load": "study.door",
    # Scenarios and records.
    "CUT_IN": "scenarios.cut_in",
    "Event": "scenarios.events",
    "FittedRecords": "answer.candidates.fitted_records",
    "Outcome": "scenarios.outcomes",
    "SCENARIOS": "scenarios",
    "SOURCES": "records.sources",
    "Scenario": "scenarios.protocol",
    "Variable": "scenarios.variables",
    "Verdict": "records.verdict",
    "event_named": "vehicles.protocol",
    "outcome": "scenarios.outcomes",
    "read_records": "study.door",
    # Laws of the encounters.
    "Box": "laws.protocol",
    "Draws": "laws.draws",
    "DrawnLaws": "laws.draws",
    "JointLaw": "laws.joint",
    "LAWS": "laws",
    "Law": "laws.protocol",
    "LawStudy": "answer.candidates.law_study",
    "OneLaw": "laws.draws",
    "StratifiedLaw": "laws.strata",
    "as_draws": "laws.draws",
    "choose_draws": "study.door",
    "fit_paper_law": "study.door",
    "read_law": "laws.files",
    "write_law": "laws.files",
    # Vehicles, and what is asked about them.
    "Outcomes": "scenarios.cut_in",
    "Problem": "methods.problem",
    "VEHICLES": "vehicles",
    "Vehicle": "vehicles.protocol",
    "load_vehicle": "vehicles.loading",
    "vehicles_of": "vehicles.loading",
    # The answer, in three ways.
    "Answer": "answer.ways.answer",
    "Crashes": "answer.ways.answer",
    "FewRuns": "answer.ways.by_few_runs",
    "Grid": "crash_map.maps",
    "Map": "answer.ways.by_map",
    "Posterior": "answer.ways.posterior",
    "Replayed": "answer.ways.answer",
    "SampledPosterior": "answer.ways.posterior",
    "Scan": "answer.ways.by_scan",
    "Simulations": "answer.ways.by_simulations",
    "Stopping": "methods",
    "compare": "answer.ways.comparison",
    "evaluate": "answer.ways.answer",
    "extrapolation": "answer.ways.extrapolation",
    "map_crashes": "crash_map.mapping",
    # The command `estimate` as a function.
    "Estimated": "answer.estimation",
    "Request": "answer.ways.request",
    "estimate": "study.door",
}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:  # noqa: ANN401
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = found  # also in place of a package of the same name, which its import has put here
    return found


def __dir__() -> list[str]:
    return __all__
