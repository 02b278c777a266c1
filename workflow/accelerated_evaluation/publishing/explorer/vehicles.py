"""The vehicles of the explorer: their sliders, and the parameters of the simulation at each position.

Python computes, for every position of every slider, which of the numbers that the simulation reads are
changed. The page only inserts these numbers. No two sliders of a vehicle may change the same number, which is
checked.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from accelerated_evaluation.base.errors import StudyError
from accelerated_evaluation.publishing.tables.display import NAMES
from accelerated_evaluation.scenarios.crossing import kernel as crossing
from accelerated_evaluation.scenarios.parameters import parameter_names
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.builtin.driver_numbers import Driver
from accelerated_evaluation.vehicles.builtin.kernel import Car
from accelerated_evaluation.vehicles.protocol import Vehicle

# Name of the simulation in `simulator.js` that reads each kind of numbers.
KERNELS = {Car: "car", Driver: "driver", crossing.CarParameters: "turn"}


@dataclass(frozen=True)
class Slider:
    """A slider of the page, which changes a parameter of a vehicle."""

    parameter: str
    label: str
    unit: str
    stops: tuple[float, ...]  # values that a reader can choose, in increasing order

    def parameters(self, base: Mapping[str, Any], value: float | None) -> dict[str, Any]:
        """Return the parameters of the vehicle with one changed; None is the published TTC of the AEB.

        If the TTC at which the AEB begins is increased above the TTC at which it is released, the latter is
        increased to the same value.
        """
        changed = {self.parameter: value}
        if self.parameter == "aeb_ttc" and value is not None:
            changed["aeb_release_ttc"] = max(base["aeb_release_ttc"], value)
        return dict(base) | changed

    def values(self, start: float | None, published: tuple[float, float]) -> list[float | None]:
        """Return the values of the slider in increasing order, with the vehicle's own value ``start`` added.

        None stands for the ``published`` TTC of the AEB, which depends on the speed. Its place in the order
        is that of the largest TTC.
        """
        others = [value for value in self.stops if start is None or not math.isclose(value, start)]
        return sorted([*others, start], key=lambda value: published[1] if value is None else value)


def _steps(first: float, last: float, step: float) -> tuple[float, ...]:
    return tuple(np.round(np.arange(first, last + step / 2, step), 6).tolist())


REACTION = Slider("reaction_time", "Reaction time", "s", _steps(0.1, 2.0, 0.1))
BRAKING = Slider("deceleration", "Largest deceleration", "m/s²", _steps(3, 10, 0.5))
HEADWAY = Slider("headway", "Headway of the ACC", "s", _steps(0.8, 3.0, 0.1))
GROWTH = Slider("jerk", "Build-up of braking", "m/s³", _steps(4, 40, 2))
SLIDERS: dict[str, tuple[Slider, ...]] = {
    "acc_aeb": (
        Slider("aeb_ttc", "Emergency braking begins at a TTC of", "s", _steps(0.3, 3.0, 0.1)),
        Slider("aeb_deceleration", "Deceleration of emergency braking", "m/s²", _steps(3, 10, 0.5)),
        Slider("aeb_jerk", "Build-up of emergency braking", "m/s³", _steps(4, 40, 2)),
        HEADWAY,
    ),
    "acc_only": (HEADWAY,),
    "cc_human": (
        REACTION,
        BRAKING,
        GROWTH,
        Slider("critical_ttc", "Danger is seen at a TTC of", "s", _steps(1, 4, 0.2)),
    ),
    "reg157": (REACTION, BRAKING),
    "rss": (REACTION, BRAKING, GROWTH),
    "fsm": (REACTION, GROWTH),
}
TITLES = {name: NAMES[name][0].upper() + NAMES[name][1:] for name in SLIDERS}


def described_vehicles(scenario: Scenario, tested: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Describe every vehicle of a scenario that the page can simulate, for its JSON data.

    The sliders of the vehicle under test, section ``vehicle`` of the configuration, start at its parameters,
    and those of the others at their defaults. ``kernel`` is car, driver or turn. ``striped`` means that
    crashes lie in such narrow stripes that a few lines are not enough. ``numbers`` are those that the
    simulation reads, by name, and each stop of a slider has the ``changes`` to them.
    """
    return [
        _described(name, scenario.vehicles[name], tested["parameters"] if name == tested["name"] else {})
        for name in SLIDERS
        if name in scenario.vehicles
    ]


def other_vehicles(names: Iterable[str], tested: str) -> list[dict[str, Any]]:
    """Describe the vehicles of the study that the page shows without simulating them, for its JSON data."""
    others = [name for name in names if name not in SLIDERS and name not in (tested, "under test")]
    titles = [NAMES.get(name, name) for name in others]
    return [
        {"name": name, "title": title[0].upper() + title[1:], "sliders": []}
        for name, title in zip(others, titles, strict=True)
    ]


def _described(name: str, vehicle_class: Callable[..., Any], parameters: Mapping[str, Any]) -> dict[str, Any]:
    vehicle = vehicle_class(**parameters)
    base = {field: getattr(vehicle, field) for field in parameter_names(vehicle_class)}
    sliders = [_stops(vehicle_class, base, slider) for slider in SLIDERS[name]]
    _require_own_numbers(name, sliders)
    return {
        "name": name,
        "title": TITLES[name],
        "kernel": KERNELS[type(vehicle.compiled())],
        "striped": getattr(vehicle, "striped", False),
        "numbers": as_texts(vehicle.compiled()),
        "sliders": sliders,
    }


def _stops(vehicle_class: Callable[..., Any], base: Mapping[str, Any], slider: Slider) -> dict[str, Any]:
    """Return a slider for the page, with the changes of the numbers at each of its stops."""
    start, published = base[slider.parameter], getattr(vehicle_class, "published_ttc", (0.0, 0.0))
    values = slider.values(start, published)
    original = as_texts(vehicle_class(**base).compiled())
    stops = []
    for value in values:
        numbers = as_texts(vehicle_class(**slider.parameters(base, value)).compiled())
        changes = {name: text for name, text in numbers.items() if text != original[name]}
        label = f"{published[0]:g}–{published[1]:g}" if value is None else f"{value:.3g}"
        stops.append(
            {"value": "published" if value is None else f"{value:g}", "label": label, "changes": changes}
        )
    return {
        "name": slider.parameter,
        "label": slider.label,
        "unit": slider.unit,
        "start": values.index(start),
        "stops": stops,
    }


def _require_own_numbers(name: str, sliders: Sequence[Mapping[str, Any]]) -> None:
    """Raise StudyError if two sliders of a vehicle change the same number."""
    seen: set[int] = set()
    for slider in sliders:
        own = {number for stop in slider["stops"] for number in stop["changes"]}
        if own & seen:
            raise StudyError(f"Two sliders of {name} change the same number; {slider['name']} is one.")
        seen |= own


def as_texts(numbers: Car | Driver | crossing.CarParameters) -> dict[str, str]:
    """Return a simulation's numbers by name, as texts from which JavaScript reads exactly the same floats."""
    return {
        name: "Infinity" if number == math.inf else repr(float(number))
        for name, number in numbers._asdict().items()
    }


def pilots(scenario: Scenario) -> list[Vehicle]:
    """Return the vehicles of a scenario on the page, with default parameters and each slider at its ends.

    The page needs lines where these vehicles crash. Vehicles whose crashes form narrow stripes are left out.
    """
    vehicles = []
    for name, sliders in SLIDERS.items():
        if name not in scenario.vehicles or getattr(scenario.vehicles[name], "striped", False):
            continue
        vehicle_class = scenario.vehicles[name]
        vehicle = vehicle_class()
        base = {field: getattr(vehicle, field) for field in parameter_names(vehicle_class)}
        ends = [
            slider.parameters(base, end) for slider in sliders for end in (slider.stops[0], slider.stops[-1])
        ]
        vehicles += [vehicle_class(**parameters) for parameters in (base, *ends)]
    return vehicles
