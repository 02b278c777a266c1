"""Settings of a simulated motorway: their meaning and limits, and how a file of them is read."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.sections import number
from accelerated_evaluation.study.configuration import StrictValidator, read_yaml
from accelerated_evaluation.study.schema import in_words, shown


def limited(default: float | tuple[float, float], least: float, most: float) -> Any:
    """Return a field for numbers from ``least`` to ``most``; for two numbers if the default has two."""
    if isinstance(default, tuple):
        items = number(None, least, most, "")
        schema = {"type": "array", "items": items, "minItems": 2, "maxItems": 2}
    else:
        schema = number(None, least, most, "", kind="integer" if isinstance(default, int) else "number")
    return field(default=default, metadata={"schema": schema})


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

    worlds: int = limited(10, 1, 1000)
    hours: float = limited(11.0, 0.01, 10_000)
    recording: float = limited(0.15, 0.01, 100)
    seed: int = limited(1, 0, 2_000_000)
    lanes: int = limited(3, 2, 8)
    flow: float = limited(4_000.0, 1, 30_000)
    truck_share: float = limited(0.12, 0, 1)
    speed_limit: float = limited(30.0, 5, 80)
    speed_spread: float = limited(0.16, 0, 0.5)
    kinds: int = limited(150, 1, 10_000)
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
    return motorway_of({**read_yaml(Path(path)), **changes}, path)


def motorway_of(given: Mapping[str, Any], where: str) -> Motorway:
    """Return the motorway with the given settings; see `read_settings`."""
    known = {each.name: each for each in fields(Motorway)}
    for name, value in given.items():
        if name not in known:
            expected = f"settings of a motorway: {', '.join(known)}"
            raise InputError(where, seen=repr(name), expected=expected, change="Correct the key.")
        schema = known[name].metadata["schema"]
        if not StrictValidator(schema).is_valid(value) or (isinstance(value, list) and value[0] > value[1]):
            expected = in_words(schema) + ", in increasing order" * (schema["type"] == "array")
            raise InputError(f"{where}, {name}", seen=shown(value), expected=expected, change="Correct it.")
    # Whole numbers in a file may stand for others: 30 for 30.0.
    return Motorway(
        **{
            name: tuple(value) if isinstance(value, list) else type(known[name].default)(value)
            for name, value in given.items()
        }
    )
