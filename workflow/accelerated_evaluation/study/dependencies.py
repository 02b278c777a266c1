"""The dependencies of a rule: the modules that its code imports, and the content of users' files.

Snakemake notices that a script has changed. It does not notice that an imported module has been edited, or
that a user's file has been replaced by an older one. The rules therefore name the modules as inputs, and
digests of the files as parameters.
"""

import ast
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

Paths = Iterable[str | os.PathLike]


def imported_modules(
    sources: Paths, package: str | os.PathLike, members: Mapping[str, Iterable[str]] | None = None
) -> list[Path]:
    """Return the modules of a package that some scripts or notebooks import, directly or indirectly.

    The sources are parsed and never run, so imports inside functions are found as well. A module that creates
    a `registry.Registry` imports the modules of its package when a name is looked up, and therefore depends
    on those that register a member.

    Parameters
    ----------
    sources
        Python files or notebooks.
    package
        Folder of the package; modules outside it are ignored.
    members
        The members that are looked up in the registry of a package, by the name of the package. Without an
        entry, all members of the package count.

    Returns
    -------
    list of Path
        The modules in alphabetical order; empty if none is imported.
    """
    package = Path(package)
    found: set[Path] = set()
    waiting = [module for source in sources for module in _imports(Path(source), package)]
    while waiting:
        module = waiting.pop()
        if module not in found:
            found.add(module)
            waiting += [*_imports(module, package), *_registered(module, package, members or {})]
    return sorted(found)


def in_order(value: Any) -> Any:  # noqa: ANN401
    """Return a value of the configuration with the keys of all mappings in alphabetical order.

    Snakemake compares parameters as text, so the same settings in another order would count as a change.
    """
    if isinstance(value, Mapping):
        return {key: in_order(value[key]) for key in sorted(value)}
    return [in_order(item) for item in value] if isinstance(value, list) else value


def without_unused(config: Mapping[str, Any], sources: Iterable[str]) -> dict[str, Any]:
    """Return a valid configuration, in order, without the sections of sources that the study does not use.

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


@cache
def _imports(source: Path, package: Path) -> frozenset[Path]:
    """Return the modules of the package that the code of one file imports by itself."""
    tree = ast.parse(_code(source), filename=str(source))
    names = set(_imported_names(tree, source, package))
    modules = {module for name in names for module in _modules(name, package)}
    return frozenset(modules - {source})


def _registered(module: Path, package: Path, members: Mapping[str, Iterable[str]]) -> list[Path]:
    """Return the modules that register the members of a registry.

    These are all modules of its package, or those that register one of the named members.
    """
    return [
        path
        for room in _rooms_of_registries(module, package)
        for path in room.rglob("*.py")
        if (names := _names(path)) and (room.name not in members or names & set(members[room.name]))
    ]


@cache
def _rooms_of_registries(module: Path, package: Path) -> frozenset[Path]:
    """Return the folders of the registries that a module creates: its own, or the package that it names."""
    calls = [node for node in ast.walk(ast.parse(_code(module))) if _makes_registry(node)]
    named = [getattr(call.args[1], "value", None) if len(call.args) > 1 else None for call in calls]
    return frozenset(
        package.parent.joinpath(*name.split(".")) if isinstance(name, str) else module.parent
        for name in named
    )


@cache
def _names(module: Path) -> frozenset[str]:
    """Return the names under which a module registers members.

    They are the texts that its decorators are given, and those of calls such as ``SCENARIOS.add("cut_in")``.
    """
    calls = [
        call
        for node in ast.walk(ast.parse(_code(module)))
        for call in (*getattr(node, "decorator_list", []), getattr(node, "func", None))
        if isinstance(call, ast.Call) and call.args
    ]
    values = [getattr(call.args[0], "value", None) for call in calls]
    return frozenset(value for value in values if isinstance(value, str))


def _code(source: Path) -> str:
    """Return the code of a Python file, or of the code cells of a notebook."""
    text = source.read_text(encoding="utf-8")
    if source.suffix != ".ipynb":
        return text
    cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
    return "\n".join("".join(cell["source"]) for cell in cells)


def _imported_names(tree: ast.AST, source: Path, package: Path) -> Iterator[str]:
    """Yield the dotted names of all that may be a module in the import statements of a file."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = source.relative_to(package.parent).parts[: -node.level] if node.level else ()
            module = ".".join([*above, node.module] if node.module else above)
            yield from (f"{module}.{alias.name}" for alias in node.names)


def _modules(name: str, package: Path) -> Iterator[Path]:
    """Yield the files that an import of a dotted name runs: those of the packages around it, then its own."""
    first, *parts = name.split(".")
    if first != package.name:
        return
    folder = package
    yield folder / "__init__.py"
    for part in parts:
        if (folder / f"{part}.py").is_file():
            yield folder / f"{part}.py"
        folder /= part
        if not (folder / "__init__.py").is_file():
            return  # the rest of the name is a module that was found, or what it defines
        yield folder / "__init__.py"


def _makes_registry(node: ast.AST) -> bool:
    """Tell whether a node of the syntax tree is a call of the class Registry."""
    if not isinstance(node, ast.Call):
        return False
    called = node.func
    name = called.attr if isinstance(called, ast.Attribute) else getattr(called, "id", None)
    return name == "Registry"
