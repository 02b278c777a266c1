"""What an argument of a public function may be, by the type hint of its parameter."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import UnionType
from typing import Any, Union, get_args, get_origin

import numpy as np

from accelerated_evaluation.base.arguments import A_FUNCTION, WRONG, Argument, a_number, one_of

KINDS = {"f": ("fiu", "numbers"), "i": ("iu", "whole numbers"), "b": ("b", "true and false")}
GROUPS = (Sequence, Iterable, list, tuple)
NO_GROUP = (str, bytes, Mapping)  # can be iterated over, but are no lists of values


def by_hint(hint: Any) -> Argument | None:  # noqa: ANN401
    """Return what an argument with a type hint may be; None if the hint does not say what can be checked."""
    origin, parts = get_origin(hint), get_args(hint)
    if hint is Any:
        return None
    if isinstance(hint, type) and hint in SIMPLE:
        return SIMPLE[hint]
    if origin in (Union, UnionType):
        parts = tuple(part for part in parts if os.PathLike not in parts or part is not str)  # a path is text
        found = [argument for part in parts if (argument := by_hint(part)) is not None]
        return _any_of(found) if len(found) == len(parts) else None
    if origin is np.ndarray:
        return _an_array(np.dtype(*get_args(parts[1])).kind)
    if origin in GROUPS:
        is_uniform = origin is not tuple or parts[1:] == (Ellipsis,)
        return _several(by_hint(parts[0]) if is_uniform else None, list if origin is list else tuple)
    if origin is Mapping:
        return one_of(Mapping, words="a dict")
    if origin is Callable:
        return A_FUNCTION
    if isinstance(origin or hint, type) and not getattr(hint, "_is_protocol", False):
        return one_of(origin or hint, words=f"an object of the class {(origin or hint).__name__}")
    return None


def _any_of(arguments: Sequence[Argument]) -> Argument:
    """Return an argument that fits at least one of several."""

    def take(value: Any) -> Any:  # noqa: ANN401
        for argument in arguments:
            try:
                return argument.take(value)
            except WRONG:
                continue
        raise ValueError

    return Argument(" or ".join(argument.in_words for argument in arguments), take)


def _an_array(kind: str) -> Argument:
    """Return an argument that is an array of numbers of a kind, or can be converted to one."""
    kinds, words = KINDS[kind]

    def take(value: Any) -> Any:  # noqa: ANN401
        array = np.asarray(value)
        if array.ndim == 0 or array.dtype.kind not in kinds:
            raise TypeError
        return array.astype(float, copy=False) if kind == "f" else array

    return Argument(f"an array of {words}", take)


def _several(element: Argument | None, kind: type) -> Argument:
    """Return an argument that is a list or another group of values, each as the given argument."""

    def take(value: Any) -> Any:  # noqa: ANN401
        if isinstance(value, NO_GROUP) or getattr(value, "ndim", 1) != 1:
            raise TypeError
        return kind(each if element is None else element.take(each) for each in value)

    return Argument("a list" if element is None else f"a list, each of it {element.in_words}", take)


def _path(value: str | os.PathLike) -> Path:
    """Return a path, which need not exist; an error is raised if the system does not accept its name."""
    path = Path(value)
    with suppress(FileNotFoundError, NotADirectoryError, PermissionError):
        path.stat()
    return path


A_PATH = Argument("a path that this system accepts", _path)
NOTHING = one_of(type(None), words="None")
SIMPLE: Mapping[type, Argument] = {
    bool: Argument("True or False", lambda value: bool(one_of(bool, np.bool_, words="").take(value))),
    int: a_number(whole=True),
    float: a_number(),
    str: one_of(str, words="text"),
    type: one_of(type, words="a class"),
    type(None): NOTHING,
    Path: A_PATH,
    os.PathLike: A_PATH,
    np.random.Generator: one_of(
        np.random.Generator, words="a numpy.random.Generator", change="Make one with child_generator(1)."
    ),
}
