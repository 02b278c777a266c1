"""Import and run code of users, such that a fault in it ends in a message and changes nothing else."""

import importlib.util
import inspect
import os
import sys
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial, wraps
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, Self, get_type_hints

from accelerated_evaluation.base.arguments import Argument, described
from accelerated_evaluation.base.errors import InputError, StudyError, located
from accelerated_evaluation.base.files import begins_in
from accelerated_evaluation.base.hints import NOTHING, by_hint


@contextmanager
def running(where: str, expected: str, change: str) -> Iterator[None]:
    """Run a user's code in a ``with`` block; InputError is raised if it fails or exits.

    The arguments are as in `InputError`: ``where`` names the code, and ``expected`` what it should do or
    return. A `StudyError` of the code is raised unchanged.
    """
    try:
        yield
    except (StudyError, KeyboardInterrupt):
        raise
    except BaseException as error:  # code that calls sys.exit must not end the study without a message
        if isinstance(error, ModuleNotFoundError):
            change = "Install the module, or add its folder to the environment variable PYTHONPATH."
        raise InputError(where, seen=error_in_words(error), expected=expected, change=change) from error


def is_of_library(member: Callable) -> bool:
    """Return whether a function or class is defined in this library."""
    member = member.func if isinstance(member, partial) else member
    return member.__module__.partition(".")[0] == __name__.partition(".")[0]


def call(function: Callable, *given: Any, where: str, returns: Argument, **named: Any) -> Any:  # noqa: ANN401
    """Call a function of an extension, and return its checked value.

    InputError, with the place ``where`` and the file of the function, is raised if a function that is not of
    this library fails, exits, or does not return what is expected. Functions of this library are called
    without checks, so that their faults have a traceback.
    """
    own = inspect.unwrap(function)
    wrapper, file = (
        getattr(getattr(each, "__code__", None), "co_filename", each.__module__) for each in (function, own)
    )
    if (
        is_of_library(function) or wrapper == __file__
    ):  # a method of `guard`, which is called from here anyway
        return function(*given, **named)
    where = f"{where}, {described(function)} in {file}"
    with running(where, f"a function that returns {returns.in_words}", returns.change), located(where):
        value = function(*given, **named)
    return returns.of(value, f"{where}, value that it returned")


def guard(kind: type, contracts: Iterable[type], where: str) -> None:
    """Let `call` make all calls of the methods of a user's class, with the place ``where``.

    These are the methods that the class overrides of a contract, or of a class of this library from which it
    derives. What they may return follows from the type hint there. Methods that return nothing, or anything,
    stay as they are, and so does ``from_content``, whose errors show that a file has another content.
    """
    bases = [*contracts, *filter(is_of_library, kind.__mro__)]
    own = (each for each in kind.__mro__ if not is_of_library(each))
    for owner, name, member in [(each, *pair) for each in own for pair in vars(each).items()]:
        function = getattr(member, "__func__", member)
        base = next((base for base in bases if inspect.isroutine(getattr(base, name, None))), None)
        if not inspect.isfunction(function) or base is None or name.startswith(("_", "from_content")):
            continue
        hint = _returned(getattr(base, name))
        returns = by_hint(base if hint is Self else hint)
        if returns not in (None, NOTHING) and not hasattr(function, "__wrapped__"):
            checked = _called(function, where, replace(returns, change="Correct this function."))
            setattr(owner, name, checked if member is function else type(member)(checked))


def _returned(function: Callable) -> Any:  # noqa: ANN401
    """Return the type hint of what a function returns; other hints may be known to type checkers only."""
    own = SimpleNamespace(
        __annotations__={"return": getattr(function, "__annotations__", {}).get("return", Any)}
    )
    return get_type_hints(own, vars(sys.modules[function.__module__]))["return"]


def _called(function: Callable, where: str, returns: Argument) -> Callable:
    """Return a function that makes its calls by `call`."""

    @wraps(function)
    def called(*given: Any, **named: Any) -> Any:  # noqa: ANN401
        return call(function, *given, where=where, returns=returns, **named)

    return called


def error_in_words(error: BaseException) -> str:
    """Return the type and the message of an exception on one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def import_file(path: Path, where: str) -> ModuleType:
    """Import a user's file as a module with a unique name, by which dataclasses and pickle find it.

    InputError, with the place ``where``, is raised if the file cannot be imported. A `StudyError` of the file
    is raised unchanged.
    """
    if not os.path.isfile(path):
        raise InputError(
            where,
            seen=f"no file {path}",
            expected="a Python file",
            change=f"Correct the path of the file.{begins_in(path)}",
        )
    name = f"accelerated_evaluation_user_{path.stem}_{zlib.crc32(str(path.resolve()).encode()):x}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise InputError(
            where, seen=f"file {path}", expected="a name that ends in .py", change="Rename the file."
        )
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        with running(where, "a file that Python can import", "Correct the file."):
            spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module
