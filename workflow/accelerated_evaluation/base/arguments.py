"""Arguments of public functions: declared at the function, checked and converted at its call."""

import inspect
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import Any, TypeVar

import numpy as np

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.randomness import child_generator

LONGEST = 60  # characters of a wrong value in a message
Target = TypeVar("Target", bound=Callable)


@dataclass(frozen=True)
class Argument:
    """What an argument may be.

    Parameters
    ----------
    expected
        What the argument may be, in words, or a function that returns these words.
    take
        Function that returns the value which is used in place of the one that was given. For a value that is
        not allowed, it raises TypeError, ValueError or LookupError, or an `InputError` with its own message.
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
        except (TypeError, ValueError, LookupError) as error:
            expected = self.expected() if callable(self.expected) else self.expected
            raise InputError(where, seen=described(value), expected=expected, change=self.change) from error


def checked(**arguments: Argument) -> Callable[[Target], Target]:
    """Return a decorator that checks and converts the named arguments of a function or of a class.

    An argument that is equal to its default is left as it is.
    """

    def decorate(target: Target) -> Target:
        function = target.__init__ if inspect.isclass(target) else target
        signature, name = inspect.signature(function), target.__qualname__

        @wraps(function)
        def with_checks(*given: Any, **named: Any) -> Any:  # noqa: ANN401
            bound = signature.bind(*given, **named)
            for key, argument in arguments.items():
                if key in bound.arguments and bound.arguments[key] is not signature.parameters[key].default:
                    bound.arguments[key] = argument.of(bound.arguments[key], f"{name}, argument {key}")
            return function(*bound.args, **bound.kwargs)

        if not inspect.isclass(target):
            return with_checks
        target.__init__ = with_checks
        return target

    return decorate


def described(value: object) -> str:
    """Return a value that was not expected, in a few words."""
    if value is None or isinstance(value, str | int | float | bool):
        return repr(value)
    name = value.__name__ if inspect.isclass(value) or inspect.isroutine(value) else type(value).__name__
    kind = "the class" if inspect.isclass(value) else "the function" if inspect.isroutine(value) else "a"
    shape = f" of shape {value.shape}" if isinstance(value, np.ndarray) else ""
    return f"{kind} {name}{shape}"[:LONGEST]


def one_of(*kinds: type, words: str, change: str = "Correct the argument.") -> Argument:
    """Return an argument that is an instance of one of the given classes, and is used as it is."""

    def take(value: object) -> object:
        if not isinstance(value, kinds):
            raise TypeError
        return value

    return Argument(words, take, change)


def a_number(low: float = -math.inf, high: float = math.inf, *, whole: bool = False) -> Argument:
    """Return an argument that is a number from ``low`` to ``high``, a whole one if wanted."""

    def take(value: Any) -> float:  # noqa: ANN401
        number = operator.index(value) if whole else float(value)
        if isinstance(value, str | bool) or not low <= number <= high:
            raise ValueError
        return number

    ends = [f" of {low:g} or more" if high == math.inf else f" from {low:g} to {high:g}"]
    return Argument(f"a {'whole ' * whole}number{'' if low == -math.inf else ends[0]}", take)


def a_choice(names: Sequence[str]) -> Argument:
    """Return an argument that is one of a few names."""

    def take(value: object) -> str:
        if value not in names:
            raise ValueError
        return value

    return Argument(f"one of {', '.join(names)}", take)


def by_name(registry: Mapping[str, Any], kind: type, words: str) -> Argument:
    """Return an argument that is an instance of a class, or the name of one in a registry."""

    def take(value: object) -> object:
        if isinstance(value, kind):
            return value
        if isinstance(value, str):
            return registry[value]
        raise TypeError

    return Argument(lambda: f"{words}, or its name: {', '.join(sorted(registry))}", take)


def _generator(value: Any) -> np.random.Generator:  # noqa: ANN401
    if isinstance(value, np.random.Generator):
        return value
    if isinstance(value, bool) or operator.index(value) < 0:
        raise ValueError
    return child_generator(operator.index(value))


A_GENERATOR = Argument(
    "a numpy.random.Generator, or a whole number of 0 or more as its seed",
    _generator,
    "Write, for example, generator=1.",
)
