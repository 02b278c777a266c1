"""Sections of the configuration, as JSON Schema with defaults; each stands in the module that reads it.

Each key is a part of a JSON Schema: type, limits, a description with the unit, and ``default``. The schema of
the whole configuration (`study.schema.schema`), its defaults and the tables in ``config/keys.md`` are
generated from these sections.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

Schema = Mapping[str, Any]
AUTO = "auto"  # value of a limit that is derived from the records
# Elements of lists.
SHARE: Schema = {"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1}
TEXT: Schema = {"type": "string", "minLength": 1}
# Further limits of a list that may be auto.
OR_AUTO: dict[str, Any] = {"type": ["array", "string"], "pattern": f"^{AUTO}$"}
Sections = Mapping[str, Mapping[str, Any]]  # values of some sections of the configuration, by their names


@dataclass(frozen=True)
class Check:
    """A condition on the values of several keys, which a JSON Schema cannot state."""

    # With dots between the levels, such as ``columns.closing.unit``; in the checks of a section they are
    # relative to the section.
    keys: tuple[str, ...]
    holds: Callable[..., bool]  # takes the values of the keys and returns whether they are consistent
    expected: str  # what is expected of the values, for the error message


def section(**keys: Schema) -> Schema:
    """Return the schema of a mapping that has exactly the given keys, each with its own schema."""
    return {"type": "object", "additionalProperties": False, "required": [*keys], "properties": keys}


def default_of(schema: Schema) -> Any:  # noqa: ANN401
    """Return the default value of a schema; for the schema of a section, a mapping from key to default.

    KeyError is raised if a key has no default.
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
    auto: bool = False,
    kind: str = "number",
) -> Schema:
    """Return the schema of a number between two limits, of which ``low`` may be exclusive.

    The description is a sentence that says what the number is, with its unit in brackets. ``null`` and
    ``auto`` say whether null, or the text auto, is allowed as well.
    """
    others = ["null"] * null + ["string"] * auto
    return {
        "type": [kind, *others] if others else kind,
        **({"pattern": f"^{AUTO}$"} if auto else {}),
        "exclusiveMinimum" if exclusive else "minimum": low,
        "maximum": high,
        "default": default,
        "description": description,
    }


def integer(default: int | None, low: int, high: int, description: str, *, null: bool = False) -> Schema:
    """Return the schema of a whole number between two limits, which are included."""
    return number(default, low, high, description, null=null, kind="integer")


def flag(default: bool | None, description: str, *, null: bool = False) -> Schema:
    """Return the schema of true or false; ``null`` says whether null is allowed as well."""
    return {
        "type": ["boolean", "null"] if null else "boolean",
        "default": default,
        "description": description,
    }


def share(default: float, description: str, *, below: float = 1) -> Schema:
    """Return the schema of a number above 0 and below ``below``, with a default and a description."""
    return {**SHARE, "exclusiveMaximum": below, "default": default, "description": description}


def text(default: str | None, description: str, **limits: Any) -> Schema:  # noqa: ANN401
    """Return the schema of a text; ``limits`` are keywords of JSON Schema, such as ``pattern``."""
    return {**TEXT, "default": default, "description": description, **limits}


def choice(default: str, options: Iterable[str], description: str) -> Schema:
    """Return the schema of a text that is one of the ``options``, with a default and a description."""
    return {"type": "string", "enum": [*options], "default": default, "description": description}


def listed(
    default: Sequence[Any] | None,
    items: Schema,
    description: str,
    *,
    fewest: int = 1,
    **limits: Any,  # noqa: ANN401
) -> Schema:
    """Return the schema of a list of at least ``fewest`` elements, each with the schema ``items``.

    ``limits`` are keywords of JSON Schema, such as ``maxItems``.
    """
    return {
        "type": "array",
        "minItems": fewest,
        "items": items,
        "default": None if default is None else [*default],
        "description": description,
        **limits,
    }


def mapping(default: Mapping[str, Any], description: str, **limits: Any) -> Schema:  # noqa: ANN401
    """Return the schema of a mapping whose keys the user chooses; ``limits`` are keywords of JSON Schema."""
    return {"type": "object", "default": {**default}, "description": description, **limits}
