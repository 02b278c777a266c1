"""Load, validate and document the configuration by the sections that modules state.

``python -m accelerated_evaluation.study.configuration`` updates the tables of keys in ``config/keys.md``.
"""

import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import date
from difflib import get_close_matches
from functools import reduce
from operator import eq
from pathlib import Path
from typing import Any

import yaml

from accelerated_evaluation.base import strict_yaml
from accelerated_evaluation.base.errors import InputError, StudyError
from accelerated_evaluation.base.extensions import load_files
from accelerated_evaluation.base.files import project_file, write_text
from accelerated_evaluation.base.sections import default_of
from accelerated_evaluation.records.limits import AUTO, AUTOMATIC
from accelerated_evaluation.study.consistency import conditions
from accelerated_evaluation.study.jobs import without
from accelerated_evaluation.study.limits import value_of, with_limits, with_values
from accelerated_evaluation.study.schema import WORKFLOW, in_words, keys, schema, shown

with without("rfc3987_syntax"):
    from jsonschema import Draft202012Validator, ValidationError, validators

DEFAULTS = WORKFLOW.parent / "config" / "config.yaml"
PAGE_OF_KEYS = WORKFLOW.parent / "config" / "keys.md"
MARKS = ("<!-- parameters: made from the schema -->\n", "<!-- end of parameters -->\n")

LARGEST = 1_000_000  # largest size of a file in bytes; reading more would take minutes

# YAML allows .nan and .inf, and jsonschema accepts 5.0 as an integer. None of these is allowed here.
_NUMBERS = Draft202012Validator.TYPE_CHECKER.redefine_many(
    {
        "integer": lambda _, value: type(value) is int,
        "number": lambda _, value: type(value) in (int, float) and -math.inf < value < math.inf,
    }
)
StrictValidator = validators.extend(Draft202012Validator, type_checker=_NUMBERS)


class ConfigurationError(StudyError):
    """Error for a configuration that is not valid; ``args`` contains one line for each violation."""

    def __str__(self) -> str:
        """Return a heading and the lines of all violations."""
        return "\n  ".join(("The configuration cannot be used:", *self.args))


def load(paths: Sequence[str | os.PathLike] = (), given: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Load the configuration as Snakemake does with ``--configfile``, and validate it.

    Parameters
    ----------
    paths
        Configuration files with the keys that differ from ``config/config.yaml``. A later file has precedence
        over an earlier one.
    given
        Further keys and values, which have precedence over all files.

    Returns
    -------
    dict
        The complete configuration. If the records are a file of the project, their path is that of this
        file, from whatever folder they are read.

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
    config["modules"] = load_modules(config, paths)
    config = completed(config)
    validate(config)
    source = config["data"][config["data"]["source"]]
    source["path"] = str(project_file(source["path"]))
    return config


def load_modules(config: Mapping[str, Any], paths: Iterable[str | os.PathLike]) -> list[str]:
    """Import the modules that the key ``modules`` of a configuration names, and return their paths.

    ``paths`` are the configuration files. A relative path of a module begins in the folder of one of them,
    the last one first, or in the working directory, and the returned paths begin in the latter. InputError is
    raised if the key is not a list of files that exist, or if a module cannot be used.
    """
    named = config.get("modules", [])
    if not isinstance(named, list) or not all(isinstance(each, str) for each in named):
        raise InputError(
            "modules",
            seen=shown(named),
            expected="a list of Python files",
            change="Write, for example, modules: [my_laws.py].",
        )
    folders = [*(Path(path).parent for path in reversed(list(map(str, paths)))), Path()]
    files = []
    for name in named:
        found = [folder / name for folder in folders if os.path.isfile(folder / name)]
        if not found:
            raise InputError(
                "modules",
                seen=f"no file {name} in {' or '.join(dict.fromkeys(map(str, folders)))}",
                expected="a Python file, relative to the configuration file",
                change=f"Correct the path. The working folder . is {Path.cwd()}.",
            )
        files.append(found[0])
    load_files(files)
    schema.cache_clear()  # a module may add the section of a source or method
    return [
        name if Path(name).is_absolute() else os.path.relpath(file)
        for name, file in zip(named, files, strict=True)
    ]


def default_configuration() -> dict[str, Any]:
    """Return the defaults of all sections, with the values in ``config/config.yaml``."""
    return _merged(default_of(schema()), read_yaml(DEFAULTS))


def read_again(config: Mapping[str, Any], paths: Iterable[str | os.PathLike]) -> dict[str, Any]:
    """Return a configuration that Snakemake has read with the values that its author means.

    Values from files are those that `read_yaml` reads. All other values are from the command line, where
    Snakemake reads the elements of mappings and lists as texts. They are numbers, true, false or null where
    the schema does not allow such a text. The errors are those of `read_yaml`.
    """
    read = reduce(_merged, map(read_yaml, map(Path, paths)), {})
    return _converted(config, read, schema())


def _converted(value: Any, read: Any, part: Mapping[str, Any]) -> Any:  # noqa: ANN401
    """Return a value with its texts converted to the types of its schema, unless files contain the value."""
    if value == read:
        return value
    if isinstance(read, str) and not isinstance(value, str):
        with suppress(yaml.YAMLError):
            value = read if yaml.safe_load(read) == value else value  # 017, 1:30 and dates, in YAML 1.1
    if isinstance(value, date):
        return value.isoformat()
    if isinstance(value, Mapping):
        known, others = read if isinstance(read, Mapping) else {}, part.get("additionalProperties") or {}
        below = part.get("properties", {})
        return {key: _converted(each, known.get(key), below.get(key, others)) for key, each in value.items()}
    if isinstance(value, list):
        return [_converted(each, None, part.get("items", {})) for each in value]
    types = part.get("type", "string")
    others = {types} - {"string"} if isinstance(types, str) else {*types} - {"string"}
    if isinstance(value, str) and others:
        with suppress(yaml.YAMLError):
            meant = strict_yaml.load(value)
            return meant if StrictValidator({"type": [*others]}).is_valid(meant) else value
    return value


def completed(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return a configuration in which missing keys have their default values.

    The defaults are those of ``config/config.yaml``, with three exceptions. The limits in that file are only
    for its source of records. For another source, missing limits are `limits.AUTO`, and are later derived
    from the records (`limits.with_limits`). The vehicles in that file are only for its scenario; another
    scenario has its own default vehicle, and is compared with all of its vehicles but the one under test. In
    a study of a slow vehicle, the outcomes of a Python class are stored, too.
    """
    defaults = default_configuration()
    data = config.get("data")
    if (
        isinstance(data, Mapping)
        and data.get("source", defaults["data"]["source"]) != defaults["data"]["source"]
    ):
        defaults = with_values(defaults, dict.fromkeys(AUTOMATIC, AUTO))
    complete = _merged(defaults | _vehicles_of_scenario(config, defaults), config)
    simulations = complete["simulations"]
    if isinstance(simulations, Mapping) and simulations.get("slow") is True:
        complete["simulations"] = simulations | {"keep_class": True}
    return complete


def _vehicles_of_scenario(config: Mapping[str, Any], defaults: Mapping[str, Any]) -> dict[str, Any]:
    """Return the default sections of vehicles for another scenario than that of the defaults."""
    from accelerated_evaluation.scenarios import SCENARIOS

    scenario = config.get("scenario")
    name = scenario.get("name") if isinstance(scenario, Mapping) else None
    if not isinstance(name, str) or name == defaults["scenario"]["name"] or name not in SCENARIOS:
        return {}
    tested, given = defaults["vehicle"] | {"name": SCENARIOS[name].default_vehicle}, config.get("vehicle")
    own = tested | dict(given) if isinstance(given, Mapping) else tested
    return {
        "vehicle": tested,
        "compared_vehicles": {
            each: {} for each in SCENARIOS[name].vehicles if tested | {"name": each} != own
        },
    }


def resolved(
    config: Mapping[str, Any], files: Sequence[str] = (), kept: Path | None = None, *, trust: bool = False
) -> dict[str, Any]:
    """Validate a complete configuration, and replace limits that are ``auto`` by values from the records.

    Parameters
    ----------
    config
        A configuration from `completed`.
    files
        The files of the records. Limits that were saved earlier are reused only if the contents are
        unchanged.
    kept
        File in which the limits are saved; None to derive them from the records every time.
    trust
        Whether to use the saved limits without checking that they belong to these records.

    Returns
    -------
    dict
        The configuration with a value for each limit.

    Raises
    ------
    ConfigurationError
        If the configuration is not valid.
    InputError
        If the records cannot be read.
    """
    validate(config)
    found = with_limits(config, files, kept, trust=trust)
    validate(found)
    return found


def validate(config: Mapping[str, Any]) -> None:
    """Check a complete configuration against the schema and against conditions between keys.

    ConfigurationError is raised with all violations, one line each.
    """
    validator = StrictValidator(schema())
    violations = [violation for error in validator.iter_errors(config) for violation in _violations(error)]
    lines = [line for _, line in violations]
    for check in conditions():
        paths = [key.split(".") for key in check.keys]
        if any(all(map(eq, path, wrong)) for path in paths for wrong, _ in violations):
            continue
        values = [value_of(config, key) for key in check.keys]
        if any(isinstance(value, str) and value == AUTO for value in values):
            continue  # the key is checked again after its value has been derived from the records
        if not check.holds(*values):
            lines.append(
                f"{', '.join(check.keys)}: seen {', '.join(map(shown, values))}; expected {check.expected}"
            )
    if lines:
        raise ConfigurationError(*dict.fromkeys(lines))


def tables_of_keys() -> str:
    """Return Markdown with a table for each section: its keys, their defaults, allowed values and meanings.

    Links to the sections come first.
    """
    defaults = default_configuration()
    rows: dict[str, list[str]] = {}
    for key, part in keys():
        if "properties" in part:
            continue
        default = value_of(defaults, key)
        cells = (f"`{key}`", f"`{shown(default)}`", in_words(part), part["description"])
        row = f"| {' | '.join(cell.replace('|', '&#124;') for cell in cells)} |"
        rows.setdefault(_section(key), []).append(row)
    head = ["| key | default | allowed | meaning |", "| --- | --- | --- | --- |"]
    links = [f"- [{section}](#{section.replace('.', '')})" for section in rows]
    tables = ["\n".join([f"## {section}\n", *head, *found]) for section, found in rows.items()]
    return "\n\n".join(["\n".join(links), *tables]) + "\n"


def _section(key: str) -> str:
    """Return the section under which a key is listed; each source of records has a section of its own."""
    top, *below = key.split(".")
    if not below:
        return "general"
    return f"{top}.{below[0]}" if top == "data" and len(below) > 1 else top


def read_yaml(path: Path) -> dict[str, Any]:
    """Read a single configuration file.

    InputError is raised if the file is missing or too large, is not YAML in UTF-8, contains a key twice, or
    is not a mapping of keys to values.
    """
    try:
        if path.is_dir():
            raise ValueError("a folder")
        if path.stat().st_size > LARGEST:
            raise ValueError(f"{path.stat().st_size:,} bytes, more than {LARGEST:,}")
        config = strict_yaml.load(path.read_text(encoding="utf-8"))
        json.dumps(config, default=str, skipkeys=True)  # ValueError for a part that holds itself by an alias
    except (OSError, ValueError, yaml.YAMLError, RecursionError) as error:
        seen = " ".join(str(error).replace('in "<unicode string>", ', "in ").split())
        raise InputError(
            str(path), seen=seen, expected="a YAML file", change="Correct the path or correct the file."
        ) from error
    if not isinstance(config, Mapping):
        raise InputError(
            str(path),
            seen=shown(config),
            expected="keys and values",
            change="State keys as in config/config.yaml.",
        )
    return dict(config)


def _merged(base: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """Merge ``change`` into a copy of ``base``, mapping by mapping, as snakemake.utils.update_config does."""
    merged = dict(base)
    for key, value in change.items():
        if isinstance(value, Mapping):
            below = merged.get(key)
            value = _merged(below if isinstance(below, Mapping) else {}, value)
        merged[key] = value
    return merged


def _violations(error: ValidationError) -> Iterator[tuple[list, str]]:
    """Yield the path and the message of each violation that an error of jsonschema contains."""
    path = list(error.absolute_path)
    if error.validator == "additionalProperties":
        known = error.schema["properties"]
        for name in sorted(map(str, error.instance.keys() - known)):
            seen = f"seen an unknown key; expected one of {', '.join(known)}"
            yield [*path, name], f"{_key([*path, name])}: {seen}{_suggestion(path, name, known)}"
    elif error.validator == "required":
        for name in error.validator_value:
            if name not in error.instance:
                expected = in_words(dict(keys())[_key([*path, name])])
                yield [*path, name], f"{_key([*path, name])}: seen nothing; expected {expected}"
    else:
        seen, expected = shown(error.instance), in_words(error.schema)
        is_text = error.schema.get("type") == "string" and not isinstance(error.instance, str | dict | list)
        hint = " in quotation marks" if is_text and error.instance is not None else ""
        yield path, f"{_key(path) or 'top level'}: seen {seen}; expected {expected}{hint}"


def _key(path: Sequence[str | int]) -> str:
    """Return a path as text, such as ``models.inverse_range.two_pieces.values[0]``."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path).removeprefix(".")


def _suggestion(path: Sequence[str | int], name: str, siblings: Iterable[str]) -> str:
    """Return a hint with a similar known key, preferably of the same section; empty if there is none."""
    near = [_key([*path, sibling]) for sibling in get_close_matches(name, siblings, n=1)]
    elsewhere = {key.rsplit(".", 1)[-1]: key for key, _ in keys()}
    near += [elsewhere[match] for match in get_close_matches(name, elsewhere, n=1)]
    return f"; nearest known key: {near[0]}" if near else ""


def main() -> None:
    """Update the tables of keys in ``config/keys.md``."""
    before, rest = PAGE_OF_KEYS.read_text(encoding="utf-8").split(MARKS[0])
    after = rest.split(MARKS[1])[1]
    write_text(PAGE_OF_KEYS, before + MARKS[0] + tables_of_keys() + MARKS[1] + after)


if __name__ == "__main__":
    main()
