"""The schema of the configuration, which is combined from a file and parts that modules define."""

import json
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

import yaml

from accelerated_evaluation.base.files import PROJECT
from accelerated_evaluation.base.sections import Schema
from accelerated_evaluation.records.sources import SOURCES

WORKFLOW = PROJECT / "workflow"
SCHEMA = WORKFLOW / "schemas" / "config.schema.yaml"
LONGEST = 1000  # largest number of characters of a value in a message
TYPES = {"boolean": "true or false", "object": "mapping"}
BOUNDS = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}


def own_sections() -> dict[str, dict[str, Schema]]:
    """Return the schemas of the sections that modules define, by their parent section and by name.

    The sections of sources are below ``data``. The sections of methods are on the top level, which has the
    name ``""``.
    """
    from accelerated_evaluation.methods import METHODS  # imported here, because it takes a second

    of_methods = {name: part for method in METHODS.values() for name, part in method.settings.items()}
    return {"data": {name: source.section for name, source in SOURCES.items()}, "": of_methods}


@cache
def schema() -> dict[str, Any]:
    """Return the JSON schema of the complete configuration."""
    whole = yaml.safe_load(SCHEMA.read_text(encoding="utf-8"))
    for place, sections in own_sections().items():
        part = whole["properties"][place] if place else whole
        part["properties"] |= sections
        part["required"] += sections
    return whole


def keys(part: Schema | None = None, prefix: str = "") -> Iterator[tuple[str, Schema]]:
    """Yield the dotted name of every key, with its part of the schema; a section comes before its keys."""
    for name, below in (schema() if part is None else part).get("properties", {}).items():
        if "$ref" in below:
            below = schema()["$defs"][below["$ref"].rsplit("/", 1)[1]]
        yield prefix + name, below
        yield from keys(below, f"{prefix}{name}.")


def in_words(schema: Mapping[str, Any]) -> str:
    """Return a description of the values that a part of the schema allows, such as ``integer >= 1``."""
    if "enum" in schema:
        return f"one of {', '.join(schema['enum'])}"
    if schema.get("type") == "string" and "pattern" in schema:
        return f"text matching `{schema['pattern']}`"
    types = [schema["type"]] if isinstance(schema["type"], str) else schema["type"]
    bounds = " and ".join(f"{sign} {schema[bound]:,}" for bound, sign in BOUNDS.items() if bound in schema)
    return " or ".join(_type_in_words(name, schema, bounds) for name in types)


def _type_in_words(name: str, schema: Mapping[str, Any], bounds: str) -> str:
    if name == "array":
        low, high = schema["minItems"], schema.get("maxItems")
        size = f"list of {low if low == high else f'at least {low}'}"
        return f"{size}, each {in_words(schema['items'])}{', none twice' * schema.get('uniqueItems', False)}"
    if name in ("integer", "number"):
        return f"{name} {bounds}".rstrip()
    if name == "string":
        if schema.get("pattern") == "^auto$":
            return "auto"
        return "non-empty text" if "minLength" in schema else "text"
    return TYPES.get(name, name)


def shown(value: Any) -> str:  # noqa: ANN401
    """Return a value of the configuration as JSON, shortened if it is long."""
    text = json.dumps(value, default=str, ensure_ascii=False)
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."
