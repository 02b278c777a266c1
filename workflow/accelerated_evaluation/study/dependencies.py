"""The dependencies of a rule: the modules that its code imports, and the contents of users' files.

Snakemake detects that a script has changed. It does not detect that an imported module has been edited, or
that a user's file has been replaced by an older one. The rules therefore name the modules as inputs, and
digests of the files as parameters.
"""

import ast
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

Paths = Iterable[str | os.PathLike]
BLOCKS = (ast.stmt, ast.excepthandler, ast.match_case)  # nodes that may contain statements


def imported_modules(
    sources: Paths, package: str | os.PathLike, members: Mapping[str, Iterable[str]] | None = None
) -> list[Path]:
    """Return the modules that some scripts or notebooks import from a package or from packages next to it.

    The sources are parsed but never run, so imports inside functions are found as well. A module that creates
    a `registry.Registry` imports the modules of its package when a name is looked up. It therefore depends on
    the modules that register a member.

    Parameters
    ----------
    sources
        Python files or notebooks.
    package
        Folder of the package; modules outside it and of the packages in the same folder are ignored.
    members
        Names of the members that are looked up in the registry of a package, by the name of the package. For
        a package without an entry, all members are dependencies.

    Returns
    -------
    list of Path
        The modules in alphabetical order; empty if none is imported.
    """
    package = Path(package)
    found: set[Path] = set()
    waiting = [module for source in sources for module in _facts(Path(source), package).imports]
    while waiting:
        module = waiting.pop()
        if module not in found:
            found.add(module)
            waiting += [*_facts(module, package).imports, *_registered(module, package, members or {})]
    return sorted(found)


def in_order(value: Any) -> Any:  # noqa: ANN401
    """Return a value of the configuration with the keys of all mappings in alphabetical order.

    Snakemake compares parameters as text, so equal settings in a different order would count as a change.
    """
    if isinstance(value, Mapping):
        return {key: in_order(value[key]) for key in sorted(value)}
    return [in_order(item) for item in value] if isinstance(value, list) else value


def without_unused(config: Mapping[str, Any], sources: Iterable[str]) -> dict[str, Any]:
    """Return a configuration without the sections of data sources that the study does not use.

    The keys of all mappings are in alphabetical order.

    Editing an unused section must not cause any job to run again.

    Parameters
    ----------
    config
        A valid configuration.
    sources
        Names of all sources.
    """
    unused = set(sources) - {config["data"]["source"]}
    data = {key: value for key, value in config["data"].items() if key not in unused}
    return in_order({**config, "data": data})


@dataclass(frozen=True)
class _Facts:
    """The relations of the code of one file to other files.

    Attributes
    ----------
    imports
        Modules of the package that the file imports directly.
    rooms
        Folders of the registries that the file creates: the folder of the file, or the package that is named.
    names
        Names under which the file registers members: the text arguments of its decorators, and of calls such
        as ``SCENARIOS.add("cut_in")(...)``.
    """

    imports: frozenset[Path]
    rooms: frozenset[Path]
    names: frozenset[str]


@cache
def _facts(source: Path, package: Path) -> _Facts:
    """Parse a file, and return its relations. Registries and members are only found at its top level."""
    tree = ast.parse(_code(source), filename=str(source))
    named = (name for block in _blocks(tree) for name in _imported_names(block, source, package))
    imports = {module for name in named for module in _modules(name, package)}
    calls, decorators = _top_calls(tree)
    rooms = (_room(call, source, package) for call in calls if _makes_registry(call))
    adding = [*decorators, *(call.func for call in calls)]
    values = [
        getattr(call.args[0], "value", None) for call in adding if isinstance(call, ast.Call) and call.args
    ]
    names = frozenset(value for value in values if isinstance(value, str))
    return _Facts(frozenset(imports - {source}), frozenset(rooms), names)


def _registered(module: Path, package: Path, members: Mapping[str, Iterable[str]]) -> list[Path]:
    """Return the modules that register the members of a registry.

    These are all modules of its package, or those that register one of the named members.
    """
    return [
        path
        for room in _facts(module, package).rooms
        for path in _files(room)
        if (names := _facts(path, package).names)
        and (room.name not in members or names & set(members[room.name]))
    ]


@cache
def _files(room: Path) -> list[Path]:
    """Return the Python files in a folder and in its subfolders."""
    return sorted(room.rglob("*.py"))


def _code(source: Path) -> str:
    """Return the code of a Python file, or of the code cells of a notebook."""
    text = source.read_text(encoding="utf-8")
    if source.suffix != ".ipynb":
        return text
    cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
    return "\n".join("".join(cell["source"]) for cell in cells)


def _blocks(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield all statements of a module, including those inside functions and other statements."""
    waiting: list[ast.AST] = list(tree.body)
    while waiting:
        block = waiting.pop()
        yield block
        waiting += [node for node in ast.iter_child_nodes(block) if isinstance(node, BLOCKS)]


def _top_calls(tree: ast.Module) -> tuple[list[ast.Call], list[ast.expr]]:
    """Return the calls in assignments and expressions at the top level of a module, and its decorators."""
    values = [statement.value for statement in tree.body if getattr(statement, "value", None)]
    calls = [node for value in values for node in ast.walk(value) if isinstance(node, ast.Call)]
    return calls, [each for statement in tree.body for each in getattr(statement, "decorator_list", [])]


def _imported_names(statement: ast.AST, source: Path, package: Path) -> Iterator[str]:
    """Yield the dotted names in an import statement that may be modules."""
    if isinstance(statement, ast.Import):
        yield from (alias.name for alias in statement.names)
    elif isinstance(statement, ast.ImportFrom):
        level = statement.level
        above = source.relative_to(package.parent).parts[:-level] if level else ()
        module = ".".join([*above, statement.module] if statement.module else above)
        yield from (f"{module}.{alias.name}" for alias in statement.names)


def _modules(name: str, package: Path) -> Iterator[Path]:
    """Yield the files that the import of a dotted name runs: those of its packages, then the module."""
    first, *parts = name.split(".")
    folder = package.parent / first
    if not (folder / "__init__.py").is_file():
        return
    yield folder / "__init__.py"
    for part in parts:
        if (folder / f"{part}.py").is_file():
            yield folder / f"{part}.py"
        folder /= part
        if not (folder / "__init__.py").is_file():
            return  # the rest of the name is a module that was found, or a name that the module defines
        yield folder / "__init__.py"


def _makes_registry(call: ast.Call) -> bool:
    """Return whether a call creates a `Registry`."""
    called = call.func
    name = called.attr if isinstance(called, ast.Attribute) else getattr(called, "id", None)
    return name == "Registry"


def _room(call: ast.Call, source: Path, package: Path) -> Path:
    """Return the folder of a registry: the package that its call names, or the folder of the file."""
    name = getattr(call.args[1], "value", None) if len(call.args) > 1 else None
    return package.parent.joinpath(*name.split(".")) if isinstance(name, str) else source.parent
