"""A vehicle that is an FMU: the study moves both cars, and the FMU returns the acceleration of the host."""

import itertools
import math
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import located
from accelerated_evaluation.laws.motion import STEP
from accelerated_evaluation.scenarios.cut_in import CUT_IN, Outcomes
from accelerated_evaluation.scenarios.parameters import check_parameters, parameter_error
from accelerated_evaluation.vehicles.builtin.traces import COLUMNS
from accelerated_evaluation.vehicles.external.checked import ForeignVehicle
from accelerated_evaluation.vehicles.external.fmi import HostAndLead, Model
from accelerated_evaluation.vehicles.moving import checked_lead_speeds
from accelerated_evaluation.vehicles.protocol import VEHICLES

INPUTS = ("range", "range_rate", "host_speed")
MOST_STEPS = 100_000  # largest number of steps of an encounter; a larger number is a wrong unit


@VEHICLES.add("fmu")
@dataclass
class Fmu(ForeignVehicle):
    """A vehicle that is a Functional Mock-up Unit for co-simulation, FMI 2.0 or 3.0.

    The library moves both cars. The lead vehicle keeps its speed, or has given speeds over time. In every
    step h, the FMU receives its inputs, advances by h, and returns the acceleration a of the host for this
    step. The new speed of the host is v_new = max(v + a h, 0), and the new range is R_new = R + (v_L - (v +
    v_new) / 2) h, where v_L is the mean lead speed in the step. An encounter ends with a crash when the range
    is 0 or less. It ends without a crash when the host stands still or the time is over. The smallest range
    and the smallest time to collision are those at the beginnings of the steps; the smallest range also
    includes the end of the encounter. InputError is raised if the file is not an FMU that can be run on this
    machine, if it lacks a variable, or if a parameter is wrong.
    """

    file: str  # a file that ends in .fmu
    # Quantities that the FMU receives: ``range``, ``range_rate``, ``closing_speed`` (minus the range rate),
    # ``host_speed`` or ``lead_speed``; each with the ``name`` of the variable of the FMU and its ``unit``. By
    # default they are range, range_rate and host_speed, with these names, in SI units.
    inputs: Mapping[str, Mapping[str, str]] = field(default_factory=lambda: {name: {} for name in INPUTS})
    # ``name`` and ``unit`` of the output variable with the acceleration of the host.
    acceleration: Mapping[str, str] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)  # initial values of other variables, by name
    step: float = 0.1  # h [s]
    duration: float = 8.0  # of an encounter [s], rounded to whole steps

    def __post_init__(self) -> None:
        check_parameters(self)
        if not 1 <= self.duration / self.step <= MOST_STEPS:
            raise parameter_error("duration", self.duration, f"1 to {MOST_STEPS:,} steps of {self.step:g} s")
        self._model = Model(self.file, self.inputs, self.acceleration, self.start)
        self._warn_of_step(self._model.step)

    def _warn_of_step(self, declared: float | None) -> None:
        """Warn if the step is no multiple of the step that the FMU declares [s]."""
        steps = self.step / declared if declared else 1.0
        if not math.isclose(steps, max(round(steps), 1), rel_tol=1e-6):
            warnings.warn(
                f"{self.file}: the step of {self.step:g} s is no multiple of {declared:g} s, the step that "
                "the FMU declares. Some FMUs then return the values of another time. Set parameters.step "
                "to a multiple.",
                stacklevel=3,
            )

    @property
    def name(self) -> str:
        """Path of the FMU."""
        return self.file

    @property
    def files(self) -> list[Path]:
        """The file of the FMU."""
        return [Path(self.file)]

    def simulate(self, lead_speed: ArrayLike, range_: ArrayLike, closing_speed: ArrayLike) -> Outcomes:
        """Return the outcomes of n cut-ins, each simulated with a new instance of the FMU.

        InputError is raised if the FMU cannot be instantiated, refuses a step, or returns an acceleration
        that is not finite.
        """
        encounters = CUT_IN.checked(lead_speed, range_, closing_speed)
        return self._outcomes(encounters, itertools.repeat(None))

    def simulate_moving(
        self, lead_speed: ArrayLike, range_: ArrayLike, closing_speed: ArrayLike, lead_speeds: ArrayLike
    ) -> Outcomes:
        """Return the outcomes of n cut-ins with lead speeds [m/s] at 0, 0.1, ... s, shape (n, states).

        Between 0, 0.1, ... s the lead speed is interpolated linearly. The inputs of the FMU are computed from
        the lead speed at the beginning of each step.
        """
        encounters = CUT_IN.checked(lead_speed, range_, closing_speed)
        return self._outcomes(encounters, checked_lead_speeds(lead_speeds, encounters[0]))

    def trace(self, lead_speed: float, range_: float, closing_speed: float) -> pd.DataFrame:
        """Simulate one encounter with a constant lead speed, and return its states over time.

        The arguments are lead speed [m/s], range [m] and closing speed [m/s] at the start. The table has one
        row for each step and the columns `traces.COLUMNS`. The acceleration in a row is
        that of the step before, and "emergency" is always 0.
        """
        rows, before = [], 0.0
        for time, state, acceleration in self._states(lead_speed, range_, closing_speed):
            lead, ttc = range_ + lead_speed * time, math.inf
            if state.closing_speed > 0 and state.range > 0:
                ttc = state.range / state.closing_speed
            speeds = lead_speed, state.host_speed
            rows.append((time, lead, lead - state.range, 0.0, *speeds, before, state.range, ttc, 0.0))
            before = acceleration
        return pd.DataFrame(rows, columns=list(COLUMNS))

    def _outcomes(self, encounters: Array, motions: Iterable[Array | None]) -> Outcomes:
        outcomes = np.empty((len(CUT_IN.outcomes), encounters.shape[1]))
        for k, (encounter, motion) in enumerate(zip(encounters.T, motions, strict=False)):
            with located(f"vehicle {self.name}, {CUT_IN.described(encounter)}"):
                outcomes[:, k] = self._follow(*encounter.tolist(), motion)
        return CUT_IN.outcomes_of(outcomes)

    def _follow(
        self, lead_speed: float, range_: float, closing_speed: float, motion: Array | None
    ) -> tuple[float, ...]:
        """Return the outcomes of one encounter."""
        *states, (_, last, _) = self._states(lead_speed, range_, closing_speed, motion)
        closing = [state for _, state, _ in states if state.closing_speed > 0]
        min_ttc = min((state.range / state.closing_speed for state in closing), default=math.inf)
        min_range = min(state.range for state in (*(state for _, state, _ in states), last))
        crash = last.range <= 0
        return float(crash), min_range, min_ttc, max(last.closing_speed, 0.0) if crash else 0.0

    def _states(
        self, lead_speed: float, range_: float, closing_speed: float, motion: Array | None = None
    ) -> Iterator[tuple[float, HostAndLead, float]]:
        """Yield time, state and acceleration at the beginning of each step, and at the end."""
        speeds = np.array([lead_speed]) if motion is None else motion
        state = HostAndLead(range_, lead_speed + closing_speed, lead_speed)
        instance, time = self._model.started(state), 0.0
        for step in range(round(self.duration / self.step)):
            time = step * self.step
            acceleration = instance.advance(time, self.step, state)
            yield time, state, acceleration
            lead = float(np.interp((step + 1) * self.step, STEP * np.arange(speeds.size), speeds))
            state = state.after(acceleration, self.step, lead)
            if state.range <= 0 or state.host_speed <= 0:
                break
        instance.end()
        yield time + self.step, state, 0.0
