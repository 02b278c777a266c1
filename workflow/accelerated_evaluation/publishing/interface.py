"""The interface of the workflow as one file, ``INTERFACE.yaml``: what a user brings, and what comes out.

``python -m accelerated_evaluation.publishing.interface`` writes the file again. It is made from the schema of
the configuration, the sources of records, the registries, and the tables of `Study`.
"""

import re
from collections.abc import Mapping
from functools import reduce
from inspect import getsource
from operator import getitem
from typing import Any

import yaml

from accelerated_evaluation.base.files import PROJECT, write_text
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.publishing import study
from accelerated_evaluation.publishing.study import TABLES
from accelerated_evaluation.records.sources import SOURCES
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.study.configuration import default_configuration
from accelerated_evaluation.study.schema import in_words, keys

INTERFACE = PROJECT / "INTERFACE.yaml"
HEAD = """\
# What a user of this workflow brings, what comes out, and which names are in the paths. Written by
#   python -m accelerated_evaluation.publishing.interface
"""
ENTRY = re.compile(r'((?:    # .*\n)*)    "(\w+)": "([^"]+)",')  # comments, name and path of a table
# Keys of the configuration that name files or folders of the user.
FILES = ("modules", "scenario.records", "vehicle.files", *(f"data.{name}.path" for name in SOURCES))
WILDCARDS = {
    "study": "name of the study, the key study of the configuration",
    "scope": "all, or the name of a segment of the lead speed, such as 5-15",
    "method": f"name of a method: {', '.join(METHODS)}",
    "vehicle": "name of a vehicle and a digest of its settings; studies of the same vehicle share the folder",
}


def interface() -> dict[str, Any]:
    """Return the content of ``INTERFACE.yaml``."""
    described, defaults = dict(keys()), default_configuration()
    files = {
        key: {
            "expected": in_words(described[key]),
            "default": reduce(getitem, key.split("."), defaults),
            "description": described[key]["description"],
        }
        for key in FILES
    }
    vehicle = "path/to/file.py:ClassName, or a name of the scenario"
    return {
        "configuration": {
            "files": files | {"vehicle.name": {"expected": vehicle, "description": _vehicles()}},
            "all_keys": "config/keys.md",
        },
        "scenarios": {name: each.description for name, each in SCENARIOS.items()},
        "results": {
            "tables": {
                name: {"path": f"results/{{study}}/{path}", "description": text}
                for name, (path, text) in described_tables().items()
            },
            "figures": ["figures/{study}/*.png", "figures/{study}/*.pdf", "figures/{study}/*.csv"],
            "published_tables": ["figures/{study}/tables/*.csv", "figures/{study}/tables/*.md"],
            "named_numbers": "figures/{study}/numbers.csv",
            "book": "results/{study}/book/index.html",
            "maps": "results/vehicles/{vehicle}/crash_map/full.npz",
        },
        "wildcards": WILDCARDS,
        "targets": {
            "all": "figures, tables, executed notebooks and the book (the default)",
            "figures": "all figures, each with its data",
            "tables": "all tables",
        },
    }


def _vehicles() -> str:
    """Return the names of the vehicles of each scenario as text."""
    return "; ".join(f"{name}: {', '.join(sorted(each.vehicles))}" for name, each in SCENARIOS.items()) + "."


def described_tables() -> Mapping[str, tuple[str, str]]:
    """Return path and description of each table of `TABLES`; its description is the comment before it.

    A table without a comment has that of the table before.
    """
    found, text = {}, ""
    for comment, name, path in ENTRY.findall(getsource(study).split("TABLES = {\n")[1].split("\n}\n")[0]):
        text = " ".join(line.strip().removeprefix("# ") for line in comment.splitlines()) or text
        found[name] = path, text
    return {name: found[name] for name in TABLES}


def written() -> str:
    """Return the text of ``INTERFACE.yaml``."""
    return HEAD + yaml.safe_dump(interface(), sort_keys=False, width=120, allow_unicode=True)


if __name__ == "__main__":
    write_text(INTERFACE, written())
