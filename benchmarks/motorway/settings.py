"""Settings of a simulated motorway: their meaning and limits, and how a file of them is read."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from numbers import Real
from types import MappingProxyType
from typing import Any

import yaml
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.tables import require_file


def limited(default: float | tuple[float, float], least: float, most: float, whole: bool = False) -> Any:
    """Return a field for numbers from ``least`` to ``most``; for two numbers if the default has two."""
    return field(default=default, metadata={"least": least, "most": most, "whole": whole})


@dataclass(frozen=True)
class Motorway:
    """Settings of a motorway; settings.yaml explains them, and was calibrated to NGSIM.

    Attributes
    ----------
    worlds
        Number of worlds, which differ in their random numbers and in their kinds of drivers.
    hours
        Hours of traffic in each world.
    recording
        Hours of further traffic in each world from which the crashes in the others are predicted.
    seed
        Root of the random numbers of all worlds.
    lanes
        Number of lanes.
    flow
        Vehicles that arrive per hour. Those that find no gap at the entry within a minute are left out.
    truck_share
        Share of lorries.
    speed_limit
        Speed limit [m/s].
    speed_spread
        Standard deviation of the desired speed, relative to the limit.
    kinds
        Number of kinds of car drivers.
    headway
        Limits of the uniform distribution of the desired time headway [s].
    imperfection
        Limits of the uniform distribution of the random slowing of drivers (sigma of the Krauss model).
    action_step
        Interval at which drivers decide [s].
    assertive
        Limits of the uniform distribution of the willingness to change into a small gap (lcAssertive).
    """

    worlds: int = limited(10, 1, 1000, whole=True)
    hours: float = limited(11.0, 0.01, 10_000)
    recording: float = limited(0.15, 0.01, 100)
    seed: int = limited(1, 0, 2_000_000, whole=True)
    lanes: int = limited(3, 2, 8, whole=True)
    flow: float = limited(4_000.0, 1, 30_000)
    truck_share: float = limited(0.12, 0, 1)
    speed_limit: float = limited(30.0, 5, 80)
    speed_spread: float = limited(0.16, 0, 0.5)
    kinds: int = limited(150, 1, 10_000, whole=True)
    headway: tuple[float, float] = limited((0.4, 1.2), 0.1, 10)
    imperfection: tuple[float, float] = limited((0.5, 1.0), 0, 1)
    action_step: float = limited(0.5, 0.1, 5)
    assertive: tuple[float, float] = limited((1.0, 6.0), 0.1, 100)

    def traffic(self) -> str:
        """Return the settings of the traffic in JSON, without those that say how much of it is simulated."""
        amounts = ("worlds", "hours", "recording", "seed")
        return json.dumps({name: value for name, value in asdict(self).items() if name not in amounts})


def read_settings(path: str, changes: Mapping[str, Any] = MappingProxyType({})) -> Motorway:
    """Return the settings of a YAML file, with some of them changed; the others have their defaults.

    Raises
    ------
    InputError
        If the file cannot be read, or has a key or value that no motorway has.
    """
    require_file(path, "Name a copy of benchmarks/motorway/settings.yaml.")
    try:
        with open(path, encoding="utf-8") as file:
            given = yaml.safe_load(file)
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        seen = " ".join(str(error).split())
        raise InputError(path, seen=seen, expected="a file in YAML", change="Correct it.") from None
    if not isinstance(given, dict | None):
        expected = "settings, such as flow: 5000"
        raise InputError(path, seen=repr(given), expected=expected, change="Correct it.")
    return motorway_of({**(given or {}), **changes}, path)


def motorway_of(given: Mapping[str, Any], where: str) -> Motorway:
    """Return the motorway with the given settings; see `read_settings`."""
    known = {each.name: each for each in fields(Motorway)}
    for name in given:
        if name not in known:
            expected = f"settings of a motorway: {', '.join(known)}"
            raise InputError(where, seen=repr(name), expected=expected, change="Correct the key.")
    return Motorway(**{name: _checked(known[name], value, where) for name, value in given.items()})


def _checked(key: Any, value: Any, where: str) -> Any:
    """Return the value of a setting, two numbers as a tuple."""
    pair = isinstance(key.default, tuple)
    numbers = value if pair else [value]
    fits = isinstance(numbers, list | tuple) and len(numbers) == 1 + pair and all(map(_is_number, numbers))
    fits = fits and all(key.metadata["least"] <= number <= key.metadata["most"] for number in numbers)
    fits = fits and list(numbers) == sorted(numbers)
    fits = fits and not (key.metadata["whole"] and any(number != int(number) for number in numbers))
    if not fits:
        kind = "a whole number" if key.metadata["whole"] else "a number"
        kind = "two numbers in increasing order, both" if pair else kind
        example = list(key.default) if pair else key.default
        expected = f"{kind} from {key.metadata['least']:g} to {key.metadata['most']:g}, such as {example}"
        raise InputError(f"{where}, {key.name}", seen=repr(value), expected=expected, change="Correct it.")
    if pair:
        return tuple(map(float, numbers))
    return int(value) if key.metadata["whole"] else float(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
