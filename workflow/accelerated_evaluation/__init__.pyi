"""The types of what callers give to the public functions, which convert names, texts and seeds.

Inside of the library, an argument has the type that it is converted to. A test compares the parameters.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Self

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.ways.answer import Answer as Answer, Crashes as Crashes, Replayed as Replayed, Way as _Way
from accelerated_evaluation.answer.ways.by_few_runs import FewRuns as FewRuns
from accelerated_evaluation.answer.ways.by_map import Map as _Map
from accelerated_evaluation.answer.ways.by_scan import Scan as Scan
from accelerated_evaluation.answer.ways.by_simulations import Simulations as Simulations
from accelerated_evaluation.answer.ways.comparison import compare as compare
from accelerated_evaluation.answer.estimation import Estimated as Estimated
from accelerated_evaluation.answer.ways.extrapolation import extrapolation as extrapolation
from accelerated_evaluation.answer.candidates.fitted_records import FittedRecords as _FittedRecords
from accelerated_evaluation.answer.candidates.law_study import LawStudy as _LawStudy
from accelerated_evaluation.answer.ways.posterior import Posterior as Posterior, SampledPosterior as SampledPosterior
from accelerated_evaluation.answer.ways.request import Request as Request
from accelerated_evaluation.base.arrays import Array as _Array
from accelerated_evaluation.base.errors import InputError as InputError, StudyError as StudyError
from accelerated_evaluation.base.randomness import child_generator as child_generator
from accelerated_evaluation.crash_map.maps import CrashMap as _CrashMap, Grid as Grid
from accelerated_evaluation.laws import LAWS as LAWS
from accelerated_evaluation.laws.draws import DrawnLaws as DrawnLaws, Draws as Draws, OneLaw as OneLaw, as_draws as as_draws
from accelerated_evaluation.laws.files import read_law as read_law, write_law as write_law
from accelerated_evaluation.laws.joint import JointLaw as JointLaw
from accelerated_evaluation.laws.protocol import Box as Box, Law as Law
from accelerated_evaluation.laws.smooth.support import Support as _Support
from accelerated_evaluation.laws.strata import StratifiedLaw as StratifiedLaw
from accelerated_evaluation.methods import Stopping as Stopping
from accelerated_evaluation.methods.problem import Problem as _Problem
from accelerated_evaluation.records.checks import Records as _Records
from accelerated_evaluation.records.sources import SOURCES as SOURCES
from accelerated_evaluation.records.verdict import Verdict as Verdict
from accelerated_evaluation.scenarios import SCENARIOS as SCENARIOS
from accelerated_evaluation.scenarios.cut_in import CUT_IN as CUT_IN, Outcomes as Outcomes
from accelerated_evaluation.scenarios.events import Event as Event
from accelerated_evaluation.scenarios.outcomes import Outcome as Outcome, outcome as outcome
from accelerated_evaluation.scenarios.protocol import Scenario as Scenario
from accelerated_evaluation.scenarios.variables import Variable as Variable
from accelerated_evaluation.study.door import load as load
from accelerated_evaluation.vehicles import VEHICLES as VEHICLES
from accelerated_evaluation.vehicles.protocol import Vehicle as Vehicle

_Scenario = Scenario | str
_Vehicle = Vehicle | str | Callable[..., Any]
_Config = Mapping[str, Any] | str | PathLike[str]
_Generator = np.random.Generator | int

class FittedRecords(_FittedRecords):
    @classmethod
    def of(
        cls,
        scenario: _Scenario,
        table: pd.DataFrame,
        support: _Support | None = None,
        exposure: Mapping[str, float | None] = ...,
    ) -> Self: ...

class LawStudy(_LawStudy):
    @classmethod
    def of(
        cls,
        records: _FittedRecords,
        size: int,
        streams: Callable[[str], np.random.Generator] | int,
        store: Path | None = None,
        closing_speed_max: float = ...,
    ) -> Self: ...

class Map(_Map):
    def __init__(self, crash_map: _CrashMap, records: _FittedRecords | _Array) -> None: ...

class Problem(_Problem):
    def __init__(
        self,
        scenario: _Scenario,
        vehicle: _Vehicle,
        event: Event | str | None = None,
        law: Law | None = None,
        graded: bool = True,
    ) -> None: ...

def choose_draws(choice: str, records: _FittedRecords, config: _Config | None = None) -> Draws: ...
def estimate(config: _Config, request: Request = ...) -> Estimated: ...
def evaluate(
    problem: _Problem,
    draws: Draws | Law,
    by: _Way,
    events: Sequence[Event | str] = (),
    *,
    generator: _Generator,
) -> Answer: ...
def event_named(text: str, scenario: _Scenario = ..., where: str = "--event") -> Event: ...
def fit_paper_law(name: str, records: _FittedRecords, config: _Config | None = None) -> StratifiedLaw: ...
def load_vehicle(name: str, scenario: _Scenario = ..., /, **parameters: Any) -> Vehicle: ...
def map_crashes(
    vehicle: _Vehicle, grid: Grid, events: Iterable[Event | str], generator: _Generator
) -> _CrashMap: ...
def read_records(config: _Config, check: Callable[[_Records], None] | None = None) -> FittedRecords: ...
def vehicles_of(scenario: _Scenario) -> Mapping[str, type[Vehicle]]: ...
