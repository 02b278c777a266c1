"""Extensions: modules outside of this library that add members to its registries.

An extension is a file that the key ``modules`` of a configuration names, or a module of an installed package
that has an entry point in the group ``accelerated_evaluation``. When the module is imported, its decorators,
such as ``@LAWS.add("mine")``, register its members. The files of a configuration are also in an environment
variable, so that the processes which a study starts, its scripts and workers, import them too.
"""

import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, partial
from importlib.metadata import EntryPoint, entry_points
from inspect import getfile
from pathlib import Path
from threading import Timer
from traceback import walk_stack
from types import ModuleType
from typing import Protocol

from accelerated_evaluation.base.errors import InputError, located
from accelerated_evaluation.base.users_code import import_file, running

GROUP = "accelerated_evaluation"
VARIABLE = "ACCELERATED_EVALUATION_MODULES"  # paths of the files, separated as in PATH
LIBRARY = "accelerated_evaluation."
EXTENSIONS: dict[str, "Extension"] = {}
_being_imported: list["Extension"] = []
# Time [s] after which an import is reported, because one that hangs would seem to be the command.
PATIENCE = 10.0
_reported: set[str] | None = None  # extensions whose faults were reported; None if a fault is an error


class Members(Protocol):
    """A registry, as far as extensions need it."""

    package: str

    def remove(self, name: str) -> None:
        """Remove a member."""


@dataclass
class Extension:
    """A module that was imported from outside of the library."""

    name: str  # path of the file, or name of the package and of its entry point
    files: list[Path] = field(default_factory=list)  # code of the module
    members: list[tuple[Members, str]] = field(default_factory=list)  # registries, and names in them
    module: ModuleType | None = None  # None while it is imported
    # Whether another process has found that no member of the library has a name of these, and started this
    # one. All members of the library would be imported for it, and most jobs need few of them.
    is_checked: bool = False

    def adds_to(self, *parts: str) -> bool:
        """Return whether the module adds a member to one of some parts of the library.

        A part is a room (package), such as ``laws``; a package in it, such as ``laws/smooth``; or one member,
        such as ``methods/crude``.
        """
        own = [(registry.package, name) for registry, name in self.members]
        places = [f"{each.replace('.', '/')}/{name}/" for each, name in own if each.startswith(LIBRARY)]
        wanted = tuple(f"{LIBRARY.replace('.', '/')}{part}/" for part in parts)
        return any(place.startswith(wanted) for place in places)


def current() -> Extension | None:
    """Return the extension whose module is being executed; None if there is none.

    While an extension is imported, it may import modules of the library for the first time. Their members are
    not its own. The innermost frame of a module shows whose code registers a member.
    """
    stack = (frame for frame, _ in walk_stack(sys._getframe(1)))
    frame = next(each for each in stack if not _being_imported or each.f_code.co_name == "<module>")
    is_ours = frame.f_globals["__name__"].split(".")[0] == LIBRARY.rstrip(".")
    return _being_imported[-1] if _being_imported and not is_ours else None


def added(package: str) -> list[str]:
    """Return the names of the members that extensions add to the registry of a package of the library."""
    members = [member for each in known().values() for member in each.members]
    return sorted(name for registry, name in members if registry.package == package)


def load_files(paths: Iterable[Path]) -> None:
    """Import files of the key ``modules`` of a configuration, also in all processes that this one starts.

    InputError is raised if a file cannot be imported, registers nothing, or registers a member that does not
    fulfil the contract of its kind.
    """
    for path in map(Path.resolve, paths):
        known = os.environ.get(VARIABLE, "").split(os.pathsep)
        if str(path) not in EXTENSIONS:
            extension = Extension(str(path), [path], is_checked=str(path) in known)
            with located("modules"):
                _add(extension, partial(import_file, path, "import"))
        if str(path) not in known:
            os.environ[VARIABLE] = os.pathsep.join([*filter(None, known), str(path)])


def load_known() -> None:
    """Import the extensions of installed packages, and those of the environment variable, once."""
    for entry in _installed():
        name = f"package {entry.dist and entry.dist.name}, entry point {entry.name}"
        if name in EXTENSIONS or name in (_reported or ()):
            continue
        try:
            _add(Extension(name), entry.load)
        except InputError as error:
            if _reported is None:
                raise
            _reported.add(name)
            print(f"warning: {error} What needs no extension continues without it.", file=sys.stderr)
    load_files(map(Path, filter(None, os.environ.get(VARIABLE, "").split(os.pathsep))))


@contextmanager
def faults_reported() -> Iterator[None]:
    """Report faults of installed packages in a ``with`` block as warnings.

    Outside of such blocks they are errors, because a result must not lack a member of a package that is
    installed.
    """
    global _reported
    _reported = set()
    try:
        yield
    finally:
        _reported = None


@cache  # because the metadata of all installed packages are read for it, at every look into a registry
def _installed() -> tuple[EntryPoint, ...]:
    """Return the entry points of installed packages."""
    return tuple(entry_points(group=GROUP))


def known() -> dict[str, Extension]:
    """Return all extensions by name, in the order of their names; those not yet imported are imported."""
    load_known()
    return dict(sorted(EXTENSIONS.items()))


def module_of(path: Path) -> ModuleType | None:
    """Return the module of a file that is an extension; None if the file is none.

    Such a file may contain a vehicle that is named by its class, and cannot be imported twice.
    """
    extension = known().get(str(path.resolve())) if os.path.exists(path) else None
    return None if extension is None else extension.module


def _add(extension: Extension, load: Callable[[], ModuleType]) -> None:
    """Import an extension; if this fails, no member of it remains."""
    EXTENSIONS[extension.name] = extension  # set first, because the module may look up a member
    _being_imported.append(extension)
    word = f"waiting: {extension.name} is being imported. Remove it, or correct it, if it does not end."
    waiting = Timer(PATIENCE, print, [word], {"file": sys.stderr, "flush": True})
    waiting.daemon = True
    waiting.start()
    try:
        with located(extension.name):
            with running("import", "a module that Python can import", "Correct it, or remove the package."):
                extension.module = load()
            extension.files = extension.files or _files_of(extension.module)
            if not extension.members:
                raise InputError(
                    "members",
                    seen="none",
                    expected='at least one decorator such as @LAWS.add("mine")',
                    change="Register something in this module, or do not name it.",
                )
    except BaseException:
        del EXTENSIONS[extension.name]
        for registry, name in extension.members:
            registry.remove(name)
        raise
    finally:
        waiting.cancel()
        _being_imported.pop()


def _files_of(module: ModuleType) -> list[Path]:
    """Return the Python files of a module, or of all modules of a package."""
    folders = [Path(folder) for folder in getattr(module, "__path__", [])]
    return sorted(file for folder in folders for file in folder.rglob("*.py")) or [Path(getfile(module))]
