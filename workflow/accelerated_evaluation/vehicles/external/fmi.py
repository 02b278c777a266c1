"""Functional Mock-up Units (FMUs): inputs, outputs and steps, through the library FMPy."""

import math
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from accelerated_evaluation.base.arrays import ACCELERATION, LENGTH, SPEED
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import begins_in
from accelerated_evaluation.base.users_code import error_in_words

# For each quantity, the factors of the possible units to the SI unit; the SI unit is the first one.
INPUT_UNITS = {
    "range": LENGTH,
    "range_rate": SPEED,
    "closing_speed": SPEED,
    "host_speed": SPEED,
    "lead_speed": SPEED,
}
# Exponents of the base units of the SI units, as in the unit definitions of an FMU.
EXPONENTS = {"m": {"m": 1}, "m/s": {"m": 1, "s": -1}, "m/s^2": {"m": 1, "s": -2}}
BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
LARGEST = 200_000_000  # largest number of bytes of all files of an FMU, which each worker unpacks
REAL = {"2.0": "Real", "3.0": "Float64"}


class HostAndLead(NamedTuple):
    """The state of host and lead vehicle: range [m], and both speeds [m/s]."""

    range: float
    host_speed: float
    lead_speed: float

    @property
    def range_rate(self) -> float:
        """Rate at which the range increases [m/s]."""
        return self.lead_speed - self.host_speed

    @property
    def closing_speed(self) -> float:
        """Rate at which the range decreases [m/s]."""
        return self.host_speed - self.lead_speed

    def after(self, acceleration: float, step: float, lead_speed: float) -> "HostAndLead":
        """Return the state after a step [s] with a constant acceleration of the host [m/s^2].

        The host does not drive backwards, and the lead speed [m/s] changes linearly to the given value.
        """
        speed = max(self.host_speed + acceleration * step, 0.0)
        lead = self.lead_speed if lead_speed == self.lead_speed else (self.lead_speed + lead_speed) / 2
        range_ = self.range + (lead - (self.host_speed + speed) / 2) * step
        return HostAndLead(range_, speed, lead_speed)


@dataclass(frozen=True)
class FmuVariable:
    """A variable of an FMU."""

    quantity: str
    reference: int  # number of the variable in the FMU (value reference)
    # Value in SI units = factor * value of the variable + offset.
    factor: float
    offset: float


class Model:
    """An FMU file and its variables.

    ``inputs`` has the ``name`` and ``unit`` of the input variables by quantity, ``acceleration`` those of the
    output variable, and ``start`` the initial values of others. InputError is raised if the file is not an
    FMU that can be run on this machine, or if it lacks a variable or a unit.
    """

    def __init__(
        self,
        file: str,
        inputs: Mapping[str, Mapping[str, str]],
        acceleration: Mapping[str, str],
        start: Mapping[str, Any],
    ) -> None:
        self.file, self.start = file, dict(start)
        self.description = _read(file)
        self.is_old = self.description.fmiVersion == "2.0"
        self._variables = {each.name: each for each in self.description.modelVariables}
        self.inputs = [self._variable("inputs", *item, INPUT_UNITS) for item in inputs.items()]
        outputs = {"acceleration": ACCELERATION}
        self.acceleration = self._variable("parameters", "acceleration", acceleration, outputs)
        for name in self.start:
            self._require(f"start.{name}", name, self._variables)

    @property
    def step(self) -> float | None:
        """Step with which the FMU says that it is run [s], None if it says nothing."""
        of_slave, experiment = self.description.coSimulation, self.description.defaultExperiment
        declared = getattr(of_slave, "fixedInternalStepSize", None) or getattr(experiment, "stepSize", None)
        return float(declared) if declared else None

    def started(self, state: HostAndLead) -> "Instance":
        """Return a new instance of the FMU that is initialised with a state and ready for its first step."""
        return Instance(self, state)

    @cached_property
    def folder(self) -> str:
        """Folder of the unpacked FMU, which is deleted together with this object."""
        from fmpy import extract

        self._unpacked = TemporaryDirectory(prefix="accelerated_evaluation_")
        return extract(self.file, self._unpacked.name)

    def _variable(
        self, where: str, quantity: str, mapped: Mapping[str, str], known: Mapping[str, Mapping[str, float]]
    ) -> FmuVariable:
        """Return the variable of a quantity, by its name and unit in the configuration."""
        self._require(where, quantity, known)
        where = f"{where}.{quantity}"
        if not isinstance(mapped, Mapping):
            raise self._error(where, repr(mapped), "a name and a unit, as in {name: gap, unit: m}")
        for key in mapped:
            self._require(where, key, ("name", "unit"))
        name = mapped.get("name", quantity)
        self._require(f"{where}.name", name, self._variables)
        variable = self._variables[name]
        if variable.type != (real := REAL[self.description.fmiVersion]):
            raise self._error(
                f"{where}.name", f"{name} of type {variable.type}", f"a variable of type {real}"
            )
        if getattr(variable, "dimensions", ()):
            raise self._error(f"{where}.name", f"{name}, which is an array", "a variable with one value")
        declared = variable.unit or (variable.declaredType.unit if variable.declaredType else None)
        units = {unit: (factor, 0.0) for unit, factor in known[quantity].items()}
        where, of_fmu = f"{where}.unit", self._of_fmu(f"{where}.unit", declared, units)
        if "unit" not in mapped and declared and of_fmu is None:
            raise self._error(
                where,
                f"none here, and for {name} the unit {declared} without a definition in the FMU",
                f"one of {', '.join(units)}",
                "State the unit of this variable.",
            )
        if of_fmu is not None:
            units[declared] = of_fmu
        unit = mapped.get("unit", declared or next(iter(units)))
        self._require(where, unit, units)
        if of_fmu is not None and not np.allclose(units[unit], of_fmu, rtol=1e-6, atol=1e-12):
            raise self._error(where, unit, f"{declared}, as the FMU declares for {name}")
        return FmuVariable(quantity, variable.valueReference, *units[unit])

    def _of_fmu(
        self, where: str, unit: str | None, units: Mapping[str, tuple[float, float]]
    ) -> tuple[float, float] | None:
        """Return factor and offset of a unit that the FMU declares, from its definition there if it has one.

        The result is None if the unit is not known. ``units`` are the known ones, the SI unit first.
        """
        defined = (each.baseUnit for each in self.description.unitDefinitions if each.name == unit)
        if (base := next(defined, None)) is None:
            return units.get(unit)
        exponents = {name: power for name in BASE_UNITS if (power := getattr(base, name))}
        if exponents != (wanted := EXPONENTS[next(iter(units))]):
            raise self._error(where, f"{unit} of {exponents} in the FMU", f"a unit of {wanted}")
        return base.factor, base.offset

    def _require(self, where: str, name: object, known: Iterable[str]) -> None:
        known = [*known]
        if name not in known:
            near = get_close_matches(str(name), known, n=1)
            shown = ", ".join(known[:20]) + (", ..." if len(known) > 20 else "")
            change = f"Did you mean {near[0]}?" if near else "Name one of these."
            raise self._error(where, repr(name), f"one of {shown}", change)

    def _error(
        self, where: str, seen: str, expected: str, change: str = "Correct vehicle.parameters."
    ) -> InputError:
        return InputError(f"vehicle {self.file}, {where}", seen=seen, expected=expected, change=change)


class Instance:
    """An instance of an FMU for one encounter; it must not be used any more after an error."""

    def __init__(self, model: Model, state: HostAndLead) -> None:
        self._model = model
        with _naming_the_fmu("its start"):
            from fmpy import instantiate_fmu
            from fmpy.simulation import apply_start_values

            fmu = self._fmu = instantiate_fmu(model.folder, model.description, "CoSimulation")
            apply_start_values(fmu, model.description, model.start)
            if model.is_old:
                fmu.setupExperiment(startTime=0.0)
            fmu.enterInitializationMode()
            self._set(state)
            fmu.exitInitializationMode()

    def advance(self, time: float, step: float, state: HostAndLead) -> float:
        """Set the inputs of the FMU, make one step, and return the acceleration of the host [m/s^2].

        The step [s] begins at the given time and state. InputError is raised if the FMU refuses the step,
        ends the simulation, or returns a value that is not finite.
        """
        output, fmu = self._model.acceleration, self._fmu
        with _naming_the_fmu(f"its step at {time:g} s"):
            self._set(state)
            ended = fmu.doStep(currentCommunicationPoint=time, communicationStepSize=step)
            read = fmu.getReal if self._model.is_old else fmu.getFloat64
            acceleration = read([output.reference])[0] * output.factor + output.offset
        if isinstance(ended, tuple) and ended[1]:  # FMUs of FMI 3.0 may request the end of the simulation
            raise _fault(f"its step at {time:g} s", "a request to end the simulation")
        if not math.isfinite(acceleration):
            raise _fault(f"its step at {time:g} s", f"an acceleration of {acceleration}")
        return acceleration

    def end(self) -> None:
        """Terminate the instance, and free its memory."""
        with _naming_the_fmu("its end"):
            self._fmu.terminate()
            self._fmu.freeInstance()

    def _set(self, state: HostAndLead) -> None:
        inputs = self._model.inputs
        values = [(getattr(state, each.quantity) - each.offset) / each.factor for each in inputs]
        write = self._fmu.setReal if self._model.is_old else self._fmu.setFloat64
        write([each.reference for each in inputs], values)


@contextmanager
def _naming_the_fmu(what: str) -> Iterator[None]:
    """Convert an error of FMPy in the ``with`` block to an `InputError`."""
    try:
        yield
    except Exception as error:  # FMPy raises various errors
        raise _fault(what, error_in_words(error)) from error


def _fault(what: str, seen: str) -> InputError:
    return InputError(what, seen=seen, expected="an FMU that can be run", change="Correct the FMU.")


def _read(file: str) -> Any:  # noqa: ANN401
    """Return the model description of an FMU that can be run on this machine; FMPy is an optional package."""
    try:
        import fmpy
    except ImportError as error:
        change = "Install the extra: pip install 'accelerated-evaluation[fmu]'."
        raise InputError(f"vehicle {file}", seen="no package fmpy", expected="FMPy", change=change) from error

    def refused(seen: str, expected: str, change: str) -> InputError:
        return InputError(f"vehicle {file}", seen=seen, expected=expected, change=change)

    if not Path(file).is_file() or not zipfile.is_zipfile(file):
        seen = "a file that is no ZIP archive" if Path(file).is_file() else "no such file"
        begun = "" if Path(file).is_file() else begins_in(file)
        raise refused(seen, "an FMU", f"Correct vehicle.parameters.file.{begun}")
    with zipfile.ZipFile(file) as archive:
        size = sum(part.file_size for part in archive.infolist())
    if size > LARGEST:
        seen = f"an archive whose files take {size / 1e6:,.0f} MB"
        raise refused(seen, f"at most {LARGEST / 1e6:,.0f} MB", "Leave out sources and documentation.")
    try:
        description, platforms = fmpy.read_model_description(file), fmpy.supported_platforms(file)
    except Exception as fault:  # FMPy raises various errors
        raise refused(error_in_words(fault), "a valid FMU", "Export it again.") from fault
    if description.fmiVersion not in REAL or description.coSimulation is None:
        kind = "" if description.coSimulation else ", not for co-simulation"
        seen = f"FMI {description.fmiVersion}{kind}"
        raise refused(seen, "FMI 2.0 or 3.0 for co-simulation", "Export it as such.")
    if fmpy.platform not in platforms:
        seen = f"binaries for {', '.join(platforms) or 'no platform'}"
        raise refused(seen, f"one for {fmpy.platform}", "Export or compile it for this platform.")
    return description
