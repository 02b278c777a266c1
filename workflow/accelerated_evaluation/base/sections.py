"""Sections of the configuration that a module of the library owns, as JSON Schema with defaults.

A source of records and a method state the keys of their section in their own module. Each key is a part of a
JSON Schema: its type, its limits, a description with the unit, and its ``default``. The schema of the whole
configuration, its defaults and the table in ``config/README.md`` are put together from these sections.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

Schema = Mapping[str, Any]


@dataclass(frozen=True)
class Check:
    """A condition on the values of several keys, which a schema cannot state.

    Attributes
    ----------
    keys
        The keys, with dots between the levels; those of a section's own checks begin inside of the section.
    holds
        Takes their values, and returns whether they fit together.
    expected
        What is expected of them, for the message.
    """

    keys: tuple[str, ...]
    holds: Callable[..., bool]
    expected: str


def section(**keys: Schema) -> Schema:
    """Return the schema of a mapping that has exactly these keys."""
    return {"type": "object", "additionalProperties": False, "required": [*keys], "properties": keys}


def default_of(schema: Schema) -> Any:  # noqa: ANN401
    """Return the default of a key, or of a section: a mapping of the defaults of its keys.

    Raises
    ------
    KeyError
        If a key has no default.
    """
    if "properties" in schema:
        return {key: default_of(part) for key, part in schema["properties"].items()}
    return deepcopy(schema["default"])


def number(
    default: float | None,
    low: float,
    high: float,
    description: str,
    *,
    exclusive: bool = False,
    null: bool = False,
    kind: str = "number",
) -> Schema:
    """Return the schema of a number between two limits.

    Parameters
    ----------
    default
        Its default.
    low, high
        The smallest and the largest value that are allowed.
    description
        What the number is, with its unit in brackets; a sentence.
    exclusive
        Whether ``low`` itself is not allowed.
    null
        Whether ``null`` is allowed as well.
    kind
        ``"number"`` or ``"integer"``.
    """
    return {
        "type": [kind, "null"] if null else kind,
        "exclusiveMinimum" if exclusive else "minimum": low,
        "maximum": high,
        "default": default,
        "description": description,
    }


def integer(default: int, low: int, high: int, description: str) -> Schema:
    """Return the schema of a whole number; see `number`."""
    return number(default, low, high, description, kind="integer")


def share(default: float, description: str, *, below: float = 1) -> Schema:
    """Return the schema of a number above 0 and below 1, or below another limit."""
    return {
        "type": "number",
        "exclusiveMinimum": 0,
        "exclusiveMaximum": below,
        "default": default,
        "description": description,
    }


def text(default: str | None, description: str, **limits: Any) -> Schema:  # noqa: ANN401
    """Return the schema of a text; ``limits`` are keywords of JSON Schema, such as ``pattern``."""
    return {"type": "string", "minLength": 1, "default": default, "description": description, **limits}


def choice(default: str, options: Iterable[str], description: str) -> Schema:
    """Return the schema of one of several words."""
    return {"type": "string", "enum": [*options], "default": default, "description": description}


def listed(default: Sequence[Any], items: Schema, description: str, *, fewest: int = 1) -> Schema:
    """Return the schema of a list of ``items``, of which there are at least ``fewest``."""
    return {
        "type": "array",
        "minItems": fewest,
        "items": items,
        "default": [*default],
        "description": description,
    }
