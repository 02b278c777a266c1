"""Read YAML as its authors mean it, where YAML 1.1 would silently read another value."""

import re
from collections.abc import Hashable
from datetime import date
from typing import Any

import yaml

INT, FLOAT, TIMESTAMP = (f"tag:yaml.org,2002:{name}" for name in ("int", "float", "timestamp"))
MERGE = "tag:yaml.org,2002:merge"  # the tag of the key <<, which may be repeated
POWER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)[eE][-+]?\d+$")  # a number such as 1e9 or 2.5E-3
# Octal numbers, numbers to the base 60, as for times, and numbers with underscores.
UNEXPECTED = re.compile(r"[-+]?0[0-7]+$|.*[:_]")


class _Loader(yaml.SafeLoader):
    """A YAML loader without the surprises of YAML 1.1.

    A number such as 1e9 is a number, although it has no point, and a date is a text. Numbers such as 017,
    1:30 and 1_0, which YAML 1.1 reads as 15, 90 and 10, are errors, and so is a key that a mapping has twice.
    """

    yaml_implicit_resolvers = {  # noqa: RUF012
        first: [(tag, pattern) for tag, pattern in resolvers if tag != TIMESTAMP]
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        keys = set()
        for key_node, _ in node.value:
            if key_node.tag == MERGE:
                continue
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, Hashable) and key in keys:
                raise yaml.MarkedYAMLError(problem=f"key {key!r} twice", problem_mark=key_node.start_mark)
            keys |= {key} if isinstance(key, Hashable) else set()
        return super().construct_mapping(node, deep)

    def construct_number(self, node: yaml.ScalarNode) -> float:
        is_whole = node.tag == INT
        value = (self.construct_yaml_int if is_whole else self.construct_yaml_float)(node)
        if UNEXPECTED.match(node.value):
            problem = f"{node.value}, which YAML reads as {value:g}; write the number without leading zeros"
            problem += ", colons and underscores, or put a text in quotation marks"
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark)
        return value


_Loader.add_implicit_resolver(FLOAT, POWER, list("-+.0123456789"))
for _tag in (INT, FLOAT):
    _Loader.add_constructor(_tag, _Loader.construct_number)


def load(text: str) -> Any:  # noqa: ANN401
    """Return the content of a YAML text; ``yaml.YAMLError`` is raised if it has none, or an ambiguous one."""
    return yaml.load(text, Loader=_Loader)  # a safe loader


def restored(value: Any, read: Any) -> Any:  # noqa: ANN401
    """Correct a value that another program has read from YAML, to what `load` would have read.

    Programs that follow YAML 1.1, such as Snakemake, read a number such as 1e9 as a text, and a text such as
    2024-01-01 as a date. ``read`` is what `load` returns for the same files.
    """
    if isinstance(value, dict):
        known = read if isinstance(read, dict) else {}
        return {key: restored(part, known.get(key)) for key, part in value.items()}
    if isinstance(value, list):
        parts = read if isinstance(read, list) and len(read) == len(value) else [None] * len(value)
        return [restored(*pair) for pair in zip(value, parts, strict=True)]
    if isinstance(value, date):
        return value.isoformat()
    is_number = isinstance(read, float) and isinstance(value, str) and POWER.match(value)
    return read if is_number and float(value) == read else value
