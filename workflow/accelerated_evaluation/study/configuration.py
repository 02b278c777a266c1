"""The configuration: loaded, validated and documented against ``workflow/schemas/config.schema.yaml``.

``python -m accelerated_evaluation.study.configuration`` updates the table of keys in ``config/README.md``.
"""

import json
import math
import os
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from functools import cache, reduce
from operator import eq, getitem
from pathlib import Path
from typing import Any

import yaml

from accelerated_evaluation.base.errors import InputError, StudyError
from accelerated_evaluation.base.files import write_text
from accelerated_evaluation.records.limits import AUTO, AUTOMATIC, with_limits, with_values
from accelerated_evaluation.study.consistency import CHECKS
from accelerated_evaluation.study.imports import without

with without("rfc3987_syntax"):
    from jsonschema import Draft202012Validator, ValidationError, validators

WORKFLOW = Path(__file__).resolve().parents[2]
SCHEMA = WORKFLOW / "schemas" / "config.schema.yaml"
DEFAULTS = WORKFLOW.parent / "config" / "config.yaml"
README = WORKFLOW.parent / "config" / "README.md"
MARKS = ("<!-- parameters: made from the schema -->\n", "<!-- end of parameters -->\n")

LARGEST = 1_000_000  # bytes of a file; to read more takes minutes, and no configuration has as many
LONGEST = 1000  # characters of a value that a message shows
TYPES = {"boolean": "true or false", "object": "mapping"}
BOUNDS = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}


# YAML knows .nan and .inf, and jsonschema takes 5.0 for an integer: neither is of use here
_NUMBERS = Draft202012Validator.TYPE_CHECKER.redefine_many(
    {
        "integer": lambda _, value: type(value) is int,
        "number": lambda _, value: type(value) in (int, float) and -math.inf < value < math.inf,
    }
)
StrictValidator = validators.extend(Draft202012Validator, type_checker=_NUMBERS)


class ConfigurationError(StudyError):
    """Everything that is wrong with a configuration; ``args`` has one line for each violation."""

    def __str__(self) -> str:
        """Return all lines."""
        return "\n  ".join(("The configuration cannot be used:", *self.args))


def load(paths: Sequence[str | os.PathLike] = (), given: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Load the configuration as Snakemake does with ``--configfile``, and validate it.

    Parameters
    ----------
    paths
        Files that state what differs from ``config/config.yaml``; a later one overrules an earlier one.
    given
        Further keys and values, which overrule all files.

    Returns
    -------
    dict
        The complete configuration.

    Raises
    ------
    InputError
        If a file is missing or is not a YAML mapping.
    ConfigurationError
        If the configuration is not valid.
    """
    config: dict[str, Any] = {}
    for part in (*map(read_yaml, map(Path, paths)), given or {}):
        config = _merged(config, part)
    config = completed(config)
    validate(config)
    return config


def completed(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return a configuration with the keys that it does not state as ``config/config.yaml`` states them.

    The limits there are those of its source. For another source they are `limits.AUTO`, and are read off the
    records (`limits.with_limits`).
    """
    defaults = read_yaml(DEFAULTS)
    data = config.get("data")
    if (
        isinstance(data, Mapping)
        and data.get("source", defaults["data"]["source"]) != defaults["data"]["source"]
    ):
        defaults = with_values(defaults, dict.fromkeys(AUTOMATIC, AUTO))
    return _merged(defaults, config)


def resolved(
    config: Mapping[str, Any], files: Sequence[str] = (), kept: Path | None = None, *, trust: bool = False
) -> dict[str, Any]:
    """Return a complete configuration with the limits of its records in place of ``auto``, checked.

    Parameters
    ----------
    config
        As `completed` returns it.
    files, kept, trust
        As in `limits.with_limits`.

    Raises
    ------
    ConfigurationError
        If it is not valid.
    InputError
        If the records cannot be read.
    """
    validate(config)
    found = with_limits(config, files, kept, trust=trust)
    validate(found)
    return found


def validate(config: Mapping[str, Any]) -> None:
    """Check a complete configuration against the schema and the conditions that tie keys together.

    Raises
    ------
    ConfigurationError
        With all violations, one line each.
    """
    validator = StrictValidator(_schema())
    violations = [violation for error in validator.iter_errors(config) for violation in _violations(error)]
    lines = [line for _, line in violations]
    for check in CHECKS:
        paths = [key.split(".") for key in check.keys]
        if any(all(map(eq, path, wrong)) for path in paths for wrong, _ in violations):
            continue
        values = [reduce(getitem, path, config) for path in paths]
        if any(isinstance(value, str) and value == AUTO for value in values):
            continue  # which is looked at again when the records have told the value
        if not check.holds(*values):
            lines.append(
                f"{', '.join(check.keys)}: seen {', '.join(map(_shown, values))}; expected {check.expected}"
            )
    if lines:
        raise ConfigurationError(*dict.fromkeys(lines))


def parameter_table() -> str:
    """Return the Markdown table of all keys: default, what is allowed, meaning."""
    defaults = read_yaml(DEFAULTS)
    rows = ["| key | default | allowed | meaning |", "| --- | --- | --- | --- |"]
    for key, schema in _nodes(_schema()):
        if "properties" in schema:
            continue
        default = reduce(getitem, key.split("."), defaults)
        cells = (f"`{key}`", f"`{_shown(default)}`", _expected(schema), schema["description"])
        rows.append(f"| {' | '.join(cell.replace('|', '&#124;') for cell in cells)} |")
    return "\n".join(rows) + "\n"


class _StrictLoader(yaml.SafeLoader):
    """Loads YAML, and refuses a key that a mapping has twice, of which the second would silently win."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        keys = set()
        for key_node, _ in node.value:
            if key_node.tag == "tag:yaml.org,2002:merge":  # <<, of which there may be several
                continue
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, Hashable) and key in keys:
                raise yaml.MarkedYAMLError(problem=f"key {key!r} twice", problem_mark=key_node.start_mark)
            keys |= {key} if isinstance(key, Hashable) else set()
        return super().construct_mapping(node, deep)


def read_yaml(path: Path) -> dict[str, Any]:
    """Read a configuration file by itself.

    Raises
    ------
    InputError
        If it is missing, not UTF-8, no YAML, has a key twice, or holds anything but keys and values.
    """
    try:
        if path.stat().st_size > LARGEST:
            raise ValueError(f"{path.stat().st_size:,} bytes, more than {LARGEST:,}")
        config = yaml.load(path.read_text(encoding="utf-8"), Loader=_StrictLoader)  # a safe one
    except (OSError, ValueError, yaml.YAMLError, RecursionError) as error:
        seen = " ".join(str(error).replace('in "<unicode string>", ', "in ").split())
        raise InputError(
            str(path), seen=seen, expected="a YAML file", change="Correct the path or mend the file."
        ) from error
    if not isinstance(config, Mapping):
        raise InputError(
            str(path), seen=_shown(config), expected="keys and values", change="See config/config.yaml."
        )
    return dict(config)


def _merged(base: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``base`` with ``change`` over it, mapping by mapping, as snakemake.utils.update_config does."""
    merged = dict(base)
    for key, value in change.items():
        if isinstance(value, Mapping):
            below = merged.get(key)
            value = _merged(below if isinstance(below, Mapping) else {}, value)
        merged[key] = value
    return merged


@cache
def _schema() -> dict[str, Any]:
    return yaml.safe_load(SCHEMA.read_text(encoding="utf-8"))


def _nodes(schema: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield every key of the schema, sections before what is in them, with its part of the schema."""
    for name, part in schema.get("properties", {}).items():
        if "$ref" in part:
            part = _schema()["$defs"][part["$ref"].rsplit("/", 1)[1]]
        yield prefix + name, part
        yield from _nodes(part, f"{prefix}{name}.")


def _violations(error: ValidationError) -> Iterator[tuple[list, str]]:
    """Yield the path and the line of each violation that an error of jsonschema stands for."""
    path = list(error.absolute_path)
    if error.validator == "additionalProperties":
        known = error.schema["properties"]
        for name in sorted(map(str, error.instance.keys() - known)):
            seen = f"seen an unknown key; expected one of {', '.join(known)}"
            yield [*path, name], f"{_key([*path, name])}: {seen}{_suggestion(path, name, known)}"
    elif error.validator == "required":
        for name in error.validator_value:
            if name not in error.instance:
                expected = _expected(dict(_nodes(_schema()))[_key([*path, name])])
                yield [*path, name], f"{_key([*path, name])}: seen nothing; expected {expected}"
    else:
        seen, expected = _shown(error.instance), _expected(error.schema)
        yield path, f"{_key(path) or 'top level'}: seen {seen}; expected {expected}"


def _key(path: Sequence[str | int]) -> str:
    """Write a path as in ``models.inverse_range.two_pieces.values[0]``."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path).removeprefix(".")


def _suggestion(path: Sequence[str | int], name: str, siblings: Iterable[str]) -> str:
    """Name the nearest known key, of the same section if one is near, else of any."""
    near = [_key([*path, sibling]) for sibling in get_close_matches(name, siblings, n=1)]
    elsewhere = {key.rsplit(".", 1)[-1]: key for key, _ in _nodes(_schema())}
    near += [elsewhere[match] for match in get_close_matches(name, elsewhere, n=1)]
    return f"; nearest known key: {near[0]}" if near else ""


def _expected(schema: Mapping[str, Any]) -> str:
    """Say in words what a part of the schema allows."""
    if "enum" in schema:
        return f"one of {', '.join(schema['enum'])}"
    if schema.get("type") == "string" and "pattern" in schema:
        return f"text matching `{schema['pattern']}`"
    types = [schema["type"]] if isinstance(schema["type"], str) else schema["type"]
    bounds = " and ".join(f"{sign} {schema[bound]:,}" for bound, sign in BOUNDS.items() if bound in schema)
    return " or ".join(_expected_type(name, schema, bounds) for name in types)


def _expected_type(name: str, schema: Mapping[str, Any], bounds: str) -> str:
    if name == "array":
        low, high = schema["minItems"], schema.get("maxItems")
        size = f"list of {low if low == high else f'at least {low}'}"
        return f"{size}, each {_expected(schema['items'])}{', none twice' * schema.get('uniqueItems', False)}"
    if name in ("integer", "number"):
        return f"{name} {bounds}".rstrip()
    if name == "string":
        if schema.get("pattern") == "^auto$":
            return "auto"
        return "non-empty text" if "minLength" in schema else "text"
    return TYPES.get(name, name)


def _shown(value: Any) -> str:  # noqa: ANN401
    text = json.dumps(value, default=str, ensure_ascii=False)
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."


def main() -> None:
    """Write the table of keys into ``config/README.md`` anew."""
    before, rest = README.read_text(encoding="utf-8").split(MARKS[0])
    after = rest.split(MARKS[1])[1]
    write_text(README, before + MARKS[0] + parameter_table() + MARKS[1] + after)


if __name__ == "__main__":
    main()
