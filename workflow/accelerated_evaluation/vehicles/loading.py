"""Find a vehicle by its name: one of the built-in ones, or a class in a user's own file."""

import difflib
import importlib.util
import inspect
import sys
from dataclasses import dataclass, fields
from pathlib import Path
from types import ModuleType
from typing import Any

from numpy.typing import ArrayLike

from accelerated_evaluation.errors import InputError, StudyError
from accelerated_evaluation.vehicles.acc_aeb import AccAeb
from accelerated_evaluation.vehicles.checks import checked_encounters, checked_outcomes, outcome_error
from accelerated_evaluation.vehicles.protocol import Outcomes, Vehicle

BUILT_IN = {"acc_aeb": {}, "acc_only": {"aeb": False}}  # name: parameters of AccAeb that the name fixes


@dataclass(frozen=True)
class CheckedVehicle:
    """A user's vehicle whose inputs and outcomes are checked against the protocol.

    Attributes
    ----------
    vehicle
        The user's own.
    name
        Its name in messages, ``path/to/file.py:ClassName``.
    """

    vehicle: Vehicle
    name: str

    def simulate(self, lead_speed: ArrayLike, range_: ArrayLike, closing_speed: ArrayLike) -> Outcomes:
        """Simulate n cut-ins; see `Vehicle`.

        Raises
        ------
        InputError
            If the encounters are not valid, the user's code raises, or its outcomes break the protocol.
        """
        encounters = checked_encounters(lead_speed, range_, closing_speed)
        try:
            outcomes = self.vehicle.simulate(*encounters.copy())
        except StudyError:
            raise
        except Exception as error:
            raise outcome_error(self.name, "simulate", _told(error), "outcomes") from error
        return checked_outcomes(outcomes, encounters.shape[1], encounters[1], vehicle=self.name)


def load_vehicle(name: str, **parameters: Any) -> Vehicle:  # noqa: ANN401
    """Return the vehicle called ``name``.

    Parameters
    ----------
    name
        ``acc_aeb``, the study's car; ``acc_only``, the same without AEB; or ``path/to/file.py:ClassName``, a
        class with a method ``simulate`` as in `Vehicle`.
    **parameters
        Passed to the class: for the built-in ones the attributes of `AccAeb`.

    Raises
    ------
    InputError
        If there is no such vehicle, file, class or parameter, or the class cannot be used.
    """
    if ":" in name or name.endswith(".py"):
        return _load_user_vehicle(name, parameters)
    if name not in BUILT_IN:
        raise InputError(
            "vehicle",
            seen=repr(name),
            expected=f"{', '.join(BUILT_IN)} or path/to/file.py:ClassName",
            change=_nearest(name, BUILT_IN) or "Name one of these.",
        )
    fixed = BUILT_IN[name]
    known = [field.name for field in fields(AccAeb) if field.name not in fixed]
    for parameter in parameters:
        if parameter not in known:
            raise InputError(
                f"vehicle {name}",
                seen=f"parameter {parameter!r}",
                expected=f"one of {', '.join(known)}",
                change=_nearest(parameter, known) or "Remove it.",
            )
    return AccAeb(**fixed, **parameters)


def _load_user_vehicle(name: str, parameters: dict[str, Any]) -> CheckedVehicle:
    path, _, class_name = name.rpartition(":")
    if not path:
        raise _load_error(name, "no class", "path/to/file.py:ClassName", f"Write {name}:ClassName.")
    module = _load_module(name, Path(path))
    vehicle_class = getattr(module, class_name, None)
    if not inspect.isclass(vehicle_class):
        own = [
            key
            for key, value in vars(module).items()
            if inspect.isclass(value) and value.__module__ == module.__name__
        ]
        seen = f"no class {class_name!r}"
        change = _nearest(class_name, own) or "Correct the name after the colon."
        raise _load_error(name, seen, f"one of its classes: {', '.join(own) or 'it has none'}", change)
    if not callable(getattr(vehicle_class, "simulate", None)):
        signature = "a method simulate(lead_speed, range_, closing_speed)"
        raise _load_error(name, "no method simulate", signature, "Add it to the class.")
    try:
        return CheckedVehicle(vehicle_class(**parameters), name)
    except StudyError:
        raise
    except Exception as error:
        change = "Correct the class or the vehicle's parameters."
        raise _load_error(name, _told(error), f"{class_name} made from {parameters}", change) from error


def _load_module(name: str, path: Path) -> ModuleType:
    """Import the user's file under a name of its own, which dataclasses and pickle look up again."""
    if not path.is_file():
        raise _load_error(name, f"no file {path}", "a Python file", "Correct the path before the colon.")
    module_name = f"accelerated_evaluation_user_{path.stem}_{abs(hash(path.resolve())):x}"
    spec = importlib.util.spec_from_file_location(module_name, path)
    if spec is None or spec.loader is None:
        raise _load_error(name, f"file {path}", "a name that ends in .py", "Rename the file.")
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[module_name]
        raise _load_error(name, _told(error), "a file that Python can import", "Correct the file.") from error
    return module


def _load_error(name: str, seen: str, expected: str, change: str) -> InputError:
    return InputError(f"vehicle {name}", seen=seen, expected=expected, change=change)


def _nearest(name: str, known: Any) -> str:  # noqa: ANN401
    """Suggest the known name nearest to a mistyped one; empty if none is near."""
    matches = difflib.get_close_matches(name, known, n=1)
    return f"Did you mean {matches[0]}?" if matches else ""


def _told(error: Exception) -> str:
    """Return an exception on one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
