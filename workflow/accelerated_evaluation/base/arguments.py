"""What one argument may be, and how a value that it may not be is reported."""

import inspect
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np

from accelerated_evaluation.base.errors import InputError

LONGEST = 60  # characters of a wrong value in a message
# Errors of `take` for a value that is not allowed.
WRONG = (ArithmeticError, LookupError, OSError, TypeError, ValueError)


@dataclass(frozen=True)
class Argument:
    """What an argument may be.

    Parameters
    ----------
    expected
        What the argument may be, in words, or a function that returns these words.
    take
        Function that returns the value which is used in place of the one that was given. For a value that is
        not allowed, it raises an error of `WRONG`, or an `InputError` with its own message.
    change
        What the user can do about a value that is not allowed.
    """

    expected: str | Callable[[], str]
    take: Callable[[Any], Any]
    change: str = "Correct the argument."

    def of(self, value: object, where: str) -> Any:  # noqa: ANN401
        """Return the value that is used; ``where`` names the function and the argument in an error."""
        try:
            return self.take(value)
        except WRONG as error:
            raise InputError(
                where, seen=described(value), expected=self.in_words, change=self.change
            ) from error

    @property
    def in_words(self) -> str:
        """What the argument may be, in words."""
        return self.expected() if callable(self.expected) else self.expected


def described(value: object) -> str:
    """Return a value that was not expected, in a few words."""
    listed = value if isinstance(value, list | tuple) else [value]
    if all(each is None or isinstance(each, str | int | float | bool | PurePath) for each in listed):
        return text if len(text := repr(value)) <= LONGEST else f"{text[: LONGEST - 3]}..."
    if isinstance(value, np.ndarray):
        has_nan = value.dtype.kind == "f" and np.isnan(value).any()
        return f"an array of shape {value.shape}{' with NaN' * bool(has_nan)}"
    name = value.__name__ if inspect.isclass(value) or inspect.isroutine(value) else type(value).__name__
    kind = "the class" if inspect.isclass(value) else "the function" if inspect.isroutine(value) else "a"
    columns = f" with the columns {', '.join(map(str, value.columns))}" if hasattr(value, "columns") else ""
    return f"{kind} {name}{columns}"[:LONGEST]


def if_it(fits: Callable[[Any], bool]) -> Callable[[Any], Any]:
    """Return the function `Argument.take` of an argument that is used as it is, if it fits."""

    def take(value: object) -> object:
        if not fits(value):
            raise TypeError
        return value

    return take


def one_of(*kinds: type, words: str, change: str = "Correct the argument.") -> Argument:
    """Return an argument that is an instance of one of the given classes, and is used as it is."""
    return Argument(words, if_it(lambda value: isinstance(value, kinds)), change)


def a_number(low: float = -math.inf, high: float = math.inf, *, whole: bool = False) -> Argument:
    """Return an argument that is a number from ``low`` to ``high``, a whole one if wanted."""

    def take(value: Any) -> float:  # noqa: ANN401
        number = operator.index(value) if whole else float(value)
        if isinstance(value, str | bool) or not low <= number <= high:
            raise ValueError
        return number

    ends = [f" of {low:g} or more" if high == math.inf else f" from {low:g} to {high:g}"]
    return Argument(f"a {'whole ' * whole}number{'' if low == -math.inf else ends[0]}", take)


A_FUNCTION = Argument("a function", if_it(lambda value: callable(value) and not isinstance(value, type)))


def a_choice(names: Sequence[str]) -> Argument:
    """Return an argument that is one of a few names."""
    return Argument(f"one of {', '.join(names)}", if_it(lambda value: value in names))


def by_name(registry: Mapping[str, Any], kind: type, words: str) -> Argument:
    """Return an argument that is an instance of a class, or the name of one in a registry."""

    def take(value: object) -> object:
        if isinstance(value, kind):
            return value
        if isinstance(value, str):
            return registry[value]
        raise TypeError

    return Argument(lambda: f"{words}, or its name: {', '.join(sorted(registry))}", take)
