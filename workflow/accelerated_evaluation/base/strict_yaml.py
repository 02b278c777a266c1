"""Read YAML as its authors mean it, where YAML 1.1 would silently read another value."""

import re
from collections.abc import Hashable
from typing import Any

import yaml

INT, FLOAT, TIMESTAMP = (f"tag:yaml.org,2002:{name}" for name in ("int", "float", "timestamp"))
MERGE = "tag:yaml.org,2002:merge"  # the tag of the key <<, which may be repeated
WHOLE = re.compile(r"[-+]?(0|[1-9]\d*|0x[0-9a-fA-F]+)$")
NUMBER = re.compile(
    r"[-+]?(\d+\.\d*|\.\d+|\d+(?=[eE]))([eE][-+]?\d+)?$|[-+]?\.(inf|Inf|INF)$|\.(nan|NaN|NAN)$"
)


class _Loader(yaml.SafeLoader):
    """A YAML loader without the surprises of YAML 1.1.

    A number such as 1e9 is a number, although it has no point. Dates are texts, and so are 017, 1:30 and 1_0,
    which YAML 1.1 reads as 15, 90 and 10. A key that a mapping has twice is an error.
    """

    yaml_implicit_resolvers = {  # noqa: RUF012
        first: [(tag, pattern) for tag, pattern in resolvers if tag not in (INT, FLOAT, TIMESTAMP)]
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


for _tag, _pattern in ((INT, WHOLE), (FLOAT, NUMBER)):
    _Loader.add_implicit_resolver(_tag, _pattern, list("-+.0123456789"))


def load(text: str) -> Any:  # noqa: ANN401
    """Return the content of a YAML text; ``yaml.YAMLError`` is raised if it has none."""
    return yaml.load(text, Loader=_Loader)  # a safe loader
