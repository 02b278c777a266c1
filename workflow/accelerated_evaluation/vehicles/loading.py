"""Load a vehicle by its name: a built-in vehicle, a command, an FMU, or a class in a user's file."""

import difflib
import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

from accelerated_evaluation.base import extensions
from accelerated_evaluation.base.arguments import described
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.sections import (
    TEXT,
    default_of,
    flag,
    listed,
    mapping,
    number,
    section,
    text,
)
from accelerated_evaluation.base.users_code import import_file, is_of_library, running
from accelerated_evaluation.scenarios import A_SCENARIO, DEFAULT, SCENARIOS
from accelerated_evaluation.scenarios.parameters import parameter_names, required_names
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.external.checked import CheckedVehicle, ForeignVehicle
from accelerated_evaluation.vehicles.protocol import VEHICLES, RandomVehicle, Vehicle

PLAIN = ["number", "boolean", "string"]
SECTION = section(
    name=text(
        "acc_aeb",
        "Car under test: a built-in vehicle (`accelerated-evaluation simulate --help` lists them), "
        "path/to/file.py:ClassName, command or fmu; docs/your_vehicle.md has examples. Scenarios other than "
        "the cut-in have their own default vehicle.",
    ),
    parameters=mapping(
        {},
        "Parameters of the vehicle that differ from their defaults, by name.",
        additionalProperties={
            "type": [*PLAIN, "null", "array", "object"],
            "minItems": 0,
            "items": {"type": PLAIN},
        },
    ),
    files=listed(
        [],
        TEXT,
        "Further files that the vehicle depends on, such as modules that its class imports. If their "
        "contents change, the vehicle counts as another one and is simulated again.",
        fewest=0,
    ),
    deterministic=flag(
        None,
        "Whether the same encounter always has the same outcomes; false for a vehicle that depends on "
        "chance. With null, 350 repeated runs and 300 draws of the law decide. Built-in vehicles repeat "
        "themselves.",
        null=True,
    ),
    host_speed_max=number(
        None,
        1,
        200,
        "Largest speed of the vehicle [m/s] at the beginning of an encounter, such as the limit of its "
        "operational design domain. Encounters with a faster vehicle do not happen to it, and every answer "
        "is about the others (docs/law_of_cut_ins.md).",
        null=True,
    ),
)
COMPARED = mapping(
    {"acc_only": {}, "cc_human": {}, "reg157": {}, "rss": {}, "fsm": {}, "human": {}},
    "Vehicles that are compared with the car under test, under the laws that the records support. The key of "
    "an entry is its label in tables and figures. Its value has name, parameters, files and deterministic as "
    "in vehicle. An entry without a name is the built-in vehicle that its label names. In a scenario other "
    "than the cut-in, the default is all of its built-in vehicles.",
    propertyNames={"type": "string", "pattern": "^[A-Za-z][A-Za-z0-9_]{0,39}$"},
    additionalProperties={
        "type": "object",
        "additionalProperties": False,
        "properties": {
            **{key: each for key, each in SECTION["properties"].items() if key != "host_speed_max"},
            "name": text(
                None, "As in vehicle.name; by default the built-in vehicle with the name of the label."
            ),
        },
    },
)
ANY_SCENARIO = ("command",)  # vehicles that simulate the encounters of every scenario


@checked(scenario=A_SCENARIO)
def vehicles_of(scenario: Scenario) -> Mapping[str, type[Vehicle]]:
    """Return the classes of the vehicles of a scenario by name; ``command`` is any program of the user.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> sorted(ae.vehicles_of("left_turn"))
    ['acc_aeb', 'command']
    """
    return dict(sorted({**scenario.vehicles, **{name: VEHICLES[name] for name in ANY_SCENARIO}}.items()))


@checked(scenario=A_SCENARIO)
def load_vehicle(name: str, scenario: Scenario = SCENARIOS[DEFAULT], /, **parameters: Any) -> Vehicle:  # noqa: ANN401
    """Return the vehicle with a given name and given parameters.

    Parameters
    ----------
    name
        A name in `vehicles_of`: a built-in vehicle, or ``command`` or ``fmu`` for a program of the user. Or
        ``path/to/file.py:ClassName`` for a class of the user with a method ``simulate`` as in `Vehicle`.
    scenario
        The scenario whose encounters the vehicle simulates, or its name.
    **parameters
        Parameters that are passed to the class of the vehicle, whose documentation lists them.

    Returns
    -------
    Vehicle
        The vehicle. A vehicle of the user is a `CheckedVehicle`.

    Raises
    ------
    InputError
        If there is no such vehicle, file, class or parameter, or if the class cannot be used.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> car = ae.load_vehicle("acc_aeb")
    >>> car.simulate([20.0, 20.0], [5.0, 50.0], [18.0, 8.0]).crash
    array([ True, False])
    """
    if ":" in name or name.endswith(".py"):
        return _load_user_vehicle(name, scenario, parameters)
    vehicles = vehicles_of(scenario)
    if name not in vehicles:
        others = [each.name for each in SCENARIOS.values() if name in each.vehicles]
        raise InputError(
            "vehicle",
            seen=f"{name!r}{', a vehicle of the scenario ' + others[0] if others else ''}",
            expected=f"{', '.join(vehicles)} or path/to/file.py:ClassName",
            change=_nearest(name, vehicles) or "Name one of these.",
        )
    known = parameter_names(vehicles[name])
    for parameter in parameters:
        if parameter not in known:
            raise InputError(
                f"vehicle {name}",
                seen=f"parameter {parameter!r}",
                expected=f"one of {', '.join(known)}",
                change=_nearest(parameter, known) or "Remove it.",
            )
    missing = [parameter for parameter in required_names(vehicles[name]) if parameter not in parameters]
    if missing:
        raise InputError(
            f"vehicle {name}",
            seen=f"no parameter {missing[0]!r}",
            expected=f"its parameters {', '.join(missing)}",
            change="State them in vehicle.parameters; docs/your_vehicle.md has examples.",
        )
    vehicle = vehicles[name](**parameters)
    if not isinstance(vehicle, ForeignVehicle):
        return vehicle
    vehicle.scenario = scenario
    return CheckedVehicle(vehicle, vehicle.name, scenario)


@dataclass(frozen=True)
class FunctionVehicle:
    """A function of the variables of a scenario as a vehicle."""

    simulate: Callable[..., Any]


def as_vehicle(vehicle: Any, scenario: Scenario, where: str) -> Vehicle:  # noqa: ANN401
    """Return a vehicle that is given by its name, by an object with a method simulate, or by such a function.

    ``where`` names the argument in an error.
    """
    if isinstance(vehicle, str):
        return load_vehicle(vehicle, scenario)
    if callable(getattr(vehicle, "simulate", None)) and not inspect.isclass(vehicle):
        return vehicle
    if callable(vehicle) and not inspect.isclass(vehicle):
        return FunctionVehicle(vehicle)
    raise InputError(
        where,
        seen=described(vehicle),
        expected=f"an object with a method simulate({', '.join(scenario.names)}), such a function, or a name",
        change=f"Write {vehicle.__name__}()." if inspect.isclass(vehicle) else "Pass the vehicle.",
    )


def checked_vehicle(vehicle: Vehicle, scenario: Scenario) -> Vehicle:
    """Return a vehicle whose outcomes are checked, which those of a user's own class or function need.

    Vehicles that have a crash map although their outcomes are random are left as they are.
    """
    own = vehicle.simulate if isinstance(vehicle, FunctionVehicle) else type(vehicle)
    if is_of_library(own) or isinstance(vehicle, RandomVehicle):
        return vehicle
    return CheckedVehicle(vehicle, own.__qualname__, scenario)


def identity_of(vehicle: Vehicle) -> str | None:
    """Return the class of a vehicle with those parameters that differ from their defaults; None if unknown.

    It is known for frozen dataclasses whose parameters are numbers, texts, True, False or None, as those of
    built-in vehicles. Only their outcomes certainly depend on nothing else.
    """
    own = vehicle.vehicle if isinstance(vehicle, CheckedVehicle) else vehicle
    if not is_dataclass(own) or not own.__dataclass_params__.frozen:
        return None
    values = {each.name: getattr(own, each.name) for each in fields(own)}
    if not all(value is None or isinstance(value, str | int | float) for value in values.values()):
        return None
    changed = [each.name for each in fields(own) if values[each.name] != each.default]
    parameters = (f"{name}={_plain(values[name])}" for name in changed)
    return f"{type(own).__qualname__}({', '.join(parameters)})"


def _plain(value: str | float | None) -> str:
    """Return a value as text, in which 2 and 2.0 are equal."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return repr(float(value)) if is_number else repr(value)


def section_of(name: str, given: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the complete section of a vehicle, with defaults for the keys that are not given."""
    return default_of(SECTION) | {"name": name} | dict(given or {})


def _load_user_vehicle(name: str, scenario: Scenario, parameters: dict[str, Any]) -> CheckedVehicle:
    path, _, class_name = name.rpartition(":")
    if not path:
        raise _load_error(name, "no class", "path/to/file.py:ClassName", f"Write {name}:ClassName.")
    module = extensions.module_of(Path(path)) or import_file(Path(path), f"vehicle {name}")
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
        names = ", ".join("range_" if each == "range" else each for each in scenario.names)
        signature = f"a method simulate({names})"
        raise _load_error(name, "no method simulate", signature, "Add it to the class.")
    expected = f"{class_name} made from {parameters}"
    with running(f"vehicle {name}", expected, "Correct the class or the vehicle's parameters."):
        return CheckedVehicle(vehicle_class(**parameters), name, scenario)


def _load_error(name: str, seen: str, expected: str, change: str) -> InputError:
    return InputError(f"vehicle {name}", seen=seen, expected=expected, change=change)


def _nearest(name: str, known: Iterable[str]) -> str:
    """Return a suggestion with the known name that is most similar to ``name``; empty if none is similar."""
    matches = difflib.get_close_matches(name, known, n=1)
    return f"Did you mean {matches[0]}?" if matches else ""
