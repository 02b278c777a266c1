"""Inputs and outputs of each notebook, determined from its code and its texts without running them.

The workflow needs them before any job runs, and again in every job. The code is therefore parsed and never
imported, which is faster. A notebook shows figures and tables by ``show(study, function)``. The names of the
function's parameters are properties of `Study`, and the code of `Study` says which files each property reads.
A notebook may also read a table of results by the name of its file, ``study.table("file.csv")``.
"""

import ast
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from pathlib import Path

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.publishing.book.texts import attributes

PACKAGE = Path(__file__).resolve().parents[2]
READER = ("study.py", "study_tables.py")  # modules that define `Study` and its tables
READERS = ("path", "table", "_law")  # methods of `Study` that are called with the name of a file to read
FOLDERS = ("results", "figures")  # attributes of `Study` that are folders, and read no file


@dataclass(frozen=True)
class Contents:
    """The inputs and outputs of a notebook.

    Attributes
    ----------
    reads
        Files that the notebook reads, as paths relative to the folder of the results.
    figures, tables
        Names of the published figures and tables that the notebook makes.
    """

    reads: tuple[str, ...]
    figures: tuple[str, ...]
    tables: tuple[str, ...]


@dataclass(frozen=True)
class Registered:
    """A registered figure or table.

    Attributes
    ----------
    kind
        ``"figure"`` or ``"table"``.
    name
        Its published name.
    parameters
        Parameters of its function, which are properties of `Study`.
    """

    kind: str
    name: str
    parameters: tuple[str, ...]


def read_contents(notebook: Path) -> Contents:
    """Return the inputs and outputs of a notebook.

    Raises
    ------
    InputError
        If the notebook shows a figure or table that is not registered, or not imported by
        ``from ... import ...``, or uses an attribute that `Study` does not have.
    """
    code = ast.parse(_source(notebook, "code"), filename=str(notebook))
    imported = dict(_imported_names(code))
    in_text = attributes(_source(notebook, "markdown"), "study")
    reads, made = {*_attributes(code, "study"), *in_text} - set(FOLDERS), []
    for call in _calls(code, "show"):
        shown = _registered(imported, call, notebook)
        reads |= {"source", *shown.parameters} - {keyword.arg for keyword in call.keywords}
        made.append(shown)
    _require_known(reads, notebook)
    kinds = {kind: tuple(one.name for one in made if one.kind == kind) for kind in ("figure", "table")}
    files = {file for name in reads for file in _files(name)} | _literals(code, "study")
    return Contents(tuple(sorted(files)), kinds["figure"], kinds["table"])


def require_captions(names: Iterable[str], folder: Path) -> None:
    """Check that every figure and table has a caption, and that no name occurs twice.

    Parameters
    ----------
    names
        Names of all figures and tables that the notebooks show.
    folder
        Folder with the captions, ``<name>.rst``.

    Raises
    ------
    InputError
        If a caption is missing, or a name occurs twice.
    """
    seen = set()
    for name in names:
        caption = folder / f"{name}.rst"
        if not caption.is_file():
            raise InputError(
                str(caption), seen="no such file", expected=f"the caption of {name}", change="Write it."
            )
        if name in seen:
            raise InputError(
                name, seen="two uses", expected="a single notebook that shows it", change="Show it once."
            )
        seen.add(name)


def _require_known(names: Iterable[str], notebook: Path) -> None:
    """Raise InputError if `Study` has no property or table of one of the names."""
    for name in sorted(names):
        known = [*_study(), *_tables()]
        if name not in known:
            near = get_close_matches(name, known, n=1)
            raise InputError(
                str(notebook),
                seen=f"study.{name}, or a parameter {name} of what it shows",
                expected="a property of accelerated_evaluation.publishing.study.Study",
                change=f"Did you mean {near[0]}?"
                if near
                else "Add it there, or give it in the call of show.",
            )


def _source(notebook: Path, kind: str) -> str:
    """Return the text of all cells of one kind, ``"code"`` or ``"markdown"``, of a notebook."""
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    return "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == kind)


def _imported_names(code: ast.AST) -> Iterator[tuple[str, Path]]:
    """Yield the names that are imported from modules of this package, and the files of these modules."""
    for node in ast.walk(code):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(f"{PACKAGE.name}."):
            module = PACKAGE.parent.joinpath(*node.module.split(".")).with_suffix(".py")
            yield from ((alias.asname or alias.name, module) for alias in node.names)


def _attributes(code: ast.AST, owner: str) -> Iterator[str]:
    """Yield the attributes of the variable ``owner`` that the code uses."""
    for node in ast.walk(code):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == owner:
            yield node.attr


def _calls(code: ast.AST, function: str) -> Iterator[ast.Call]:
    """Yield the calls of a function in the order of the code."""
    calls = [node for node in ast.walk(code) if isinstance(node, ast.Call)]
    calls = [call for call in calls if isinstance(call.func, ast.Name) and call.func.id == function]
    yield from sorted(calls, key=lambda call: call.lineno)


def _registered(imported: dict[str, Path], call: ast.Call, notebook: Path) -> Registered:
    """Return the registered figure or table that a call of ``show`` shows."""
    shown = call.args[1].id if len(call.args) > 1 and isinstance(call.args[1], ast.Name) else "no name"
    module = imported.get(shown)
    if module is None or not module.is_file() or shown not in _register(module):
        raise InputError(
            f"{notebook}, show(study, {shown})",
            seen=f"{shown}, which is not a registered figure or table",
            expected="a function with the decorator @figure or @table, or a result_table",
            change="Import it by name from its module, and register it there.",
        )
    return _register(module)[shown]


@cache
def _register(module: Path) -> dict[str, Registered]:
    """Return the registered figures and tables of a module by the names of their functions."""
    registered = {}
    for node in ast.parse(module.read_text(encoding="utf-8"), filename=str(module)).body:
        for decorator in getattr(node, "decorator_list", []):
            called = decorator.func if isinstance(decorator, ast.Call) else decorator
            if isinstance(called, ast.Name) and called.id in ("figure", "table"):
                name = decorator.args[0].value if isinstance(decorator, ast.Call) else node.name
                parameters = tuple(argument.arg for argument in (*node.args.args, *node.args.kwonlyargs))
                registered[node.name] = Registered(called.id, name, parameters)
        if isinstance(node, ast.Assign) and any(_calls(node.value, "result_table")):
            name = node.value.args[0].value
            registered[node.targets[0].id] = Registered("table", name, (name,))
    return registered


@cache
def _reader() -> ast.Module:
    """Return the code of the two modules `READER` as one syntax tree."""
    sources = [(PACKAGE / "publishing" / name).read_text(encoding="utf-8") for name in READER]
    return ast.parse("\n".join(sources))


@cache
def _study() -> dict[str, ast.FunctionDef]:
    """Return the methods and properties of `Study` by name, as code."""
    (study,) = [node for node in _reader().body if isinstance(node, ast.ClassDef)]
    return {node.name: node for node in study.body if isinstance(node, ast.FunctionDef)}


@cache
def _tables() -> dict[str, str]:
    """Return the files of the tables of `Study`, by name."""
    assigned = [node for node in _reader().body if isinstance(node, ast.Assign)]
    return next(ast.literal_eval(node.value) for node in assigned if node.targets[0].id == "TABLES")


@cache
def _files(name: str) -> frozenset[str]:
    """Return the files that a property or method of `Study` reads, directly or through other properties."""
    if name in _tables():
        return frozenset({_tables()[name]})
    if name not in _study():
        return frozenset()
    method = _study()[name]
    others = (other for other in _attributes(method, "self") if other != name)
    return _literals(method, "self").union(*map(_files, others))


def _literals(code: ast.AST, owner: str) -> frozenset[str]:
    """Return the constant arguments in calls of the methods `READERS` of ``owner``, a `Study`."""
    calls = [node for node in ast.walk(code) if isinstance(node, ast.Call)]
    read = [
        part
        for call in calls
        if isinstance(call.func, ast.Attribute)
        and isinstance(call.func.value, ast.Name)
        and call.func.value.id == owner
        and call.func.attr in READERS
        for part in call.args
        if isinstance(part, ast.Constant)
    ]
    return frozenset(part.value for part in read)
