"""The schema of the complete configuration, made of the sections that modules define, and its words."""

import json
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

from accelerated_evaluation.base.files import PROJECT
from accelerated_evaluation.base.sections import TEXT, Schema, integer, listed, section, text
from accelerated_evaluation.laws.paper.section import models_section
from accelerated_evaluation.records import named
from accelerated_evaluation.records.sources import SOURCES

WORKFLOW = PROJECT / "workflow"
LONGEST_VALUE = 1000  # largest number of characters of a value in a message
TYPES = {"boolean": "true or false", "object": "mapping"}
BOUNDS = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}

STUDY = text(
    "spmd",
    "Name of the study, a folder under results/ and figures/; letters, digits, _ and -.",
    pattern="^[A-Za-z0-9][A-Za-z0-9_-]*$",
)
MODULES = listed(
    [],
    TEXT,
    "Python files, relative to the configuration file, that add laws, distributions, scenarios, vehicles, "
    "sources, methods or checks to the study (docs/extensions.md). If a file changes, the jobs that may use "
    "it run again.",
    fewest=0,
    uniqueItems=True,
)
SEED = integer(2016, 0, 4_294_967_295, "Root seed, which determines all random numbers.")
METHODS_OF_STUDY = listed(
    ["single", "piecewise", "heuristic", "shifted", "surrogate", "crude"],
    {"type": "string"},
    "Methods that estimate the crash probability, in the order of tables and figures: the six that the "
    "notebooks compare, and any other module of workflow/accelerated_evaluation/methods.",
    fewest=6,
    uniqueItems=True,
)


@cache
def schema() -> Schema:
    """Return the JSON schema of the complete configuration, from the sections that modules define.

    The sections of sources are below ``data``, and those of methods come last.
    """
    # Imported here, because they take a second.
    from accelerated_evaluation.answer import settings
    from accelerated_evaluation.answer.consequences import criterion
    from accelerated_evaluation.crash_map import sensitivity, uncertainty
    from accelerated_evaluation.crash_map.section import crash_map_section
    from accelerated_evaluation.methods import IMPORTANCE_SAMPLING, METHODS, coverage
    from accelerated_evaluation.scenarios import record_table
    from accelerated_evaluation.vehicles import loading
    from accelerated_evaluation.vehicles.external import slow

    of_sources = {name: source.section for name, source in SOURCES.items()}
    return section(
        study=STUDY,
        modules=MODULES,
        scenario=record_table.SECTION,
        seed=SEED,
        methods=METHODS_OF_STUDY,
        data=section(**named.DATA["properties"], **of_sources),
        filters=named.FILTERS,
        segments=named.SEGMENTS,
        models=models_section(),
        vehicle=loading.SECTION,
        simulations=slow.SECTION,
        compared_vehicles=loading.COMPARED,
        importance_sampling=IMPORTANCE_SAMPLING,
        coverage=coverage.SECTION,
        crash_map=crash_map_section(),
        answer=settings.SECTION,
        criteria=criterion.CRITERIA,
        in_service=criterion.IN_SERVICE,
        sensitivity=sensitivity.SECTION,
        uncertainty=uncertainty.SECTION,
        **{name: part for method in METHODS.values() for name, part in method.settings.items()},
    )


def keys(part: Schema | None = None, prefix: str = "") -> Iterator[tuple[str, Schema]]:
    """Yield the dotted name of every key, with its part of the schema; a section comes before its keys."""
    for name, below in (schema() if part is None else part).get("properties", {}).items():
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
        size = f"list of {low}" if low == high else f"list of at least {low}" if low else "list"
        return f"{size}, each {in_words(schema['items'])}{', none twice' * schema.get('uniqueItems', False)}"
    if name in ("integer", "number"):
        return f"{name} {bounds}".rstrip()
    if name == "string":
        if schema.get("pattern") == "^auto$":
            return "auto"
        return "non-empty text" if "minLength" in schema else "text"
    if name == "object" and "properties" in schema:
        return f"mapping with keys such as {', '.join([*schema['properties']][:5])}"
    return TYPES.get(name, name)


def shown(value: Any) -> str:  # noqa: ANN401
    """Return a value of the configuration as JSON, shortened if it is long."""
    text = json.dumps(value, default=str, ensure_ascii=False)
    return text if len(text) <= LONGEST_VALUE else f"{text[:LONGEST_VALUE]}..."
