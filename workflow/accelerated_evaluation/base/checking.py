"""The decorator that checks the arguments of public functions and classes at their call."""

import inspect
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache, wraps
from typing import Any, TypeVar, get_type_hints

from accelerated_evaluation.base.arguments import Argument
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.hints import by_hint

Target = TypeVar("Target", bound=Callable)


def checked(**arguments: Argument) -> Callable[[Target], Target]:
    """Return a decorator that checks and converts the arguments of a function or of a class.

    Each argument is checked as stated by the keyword of its name, or otherwise by its type hint
    (`base.hints`). The default of an argument is left as it is.
    """

    def decorate(target: Any) -> Any:  # noqa: ANN401
        is_class = inspect.isclass(target)
        function = target.__init__ if is_class else target
        signature, name = inspect.signature(function), target.__qualname__

        @cache  # and not before the first call, because a hint may name a class that is defined later
        def all_arguments() -> list[tuple[int, str, Any, Argument]]:
            hints, found = get_type_hints(target), []
            for number, (key, each) in enumerate(signature.parameters.items()):
                is_single = each.kind not in (each.VAR_POSITIONAL, each.VAR_KEYWORD)
                argument = arguments.get(key) or (by_hint(hints[key]) if is_single and key in hints else None)
                if argument is not None:
                    place = sys.maxsize if each.kind is each.KEYWORD_ONLY else number
                    found.append((place, key, each.default, argument))
            return found

        @wraps(function)
        def with_checks(*given: Any, **named: Any) -> Any:  # noqa: ANN401
            values = list(given)
            group: Any
            at: Any
            for place, key, default, argument in all_arguments():
                group, at = (values, place) if place < len(values) else (named, key)
                if (group is values or key in named) and group[at] is not default:
                    group[at] = argument.of(group[at], f"{name}, argument {key}")
            try:
                return function(*values, **named)
            except TypeError:
                _require_fit(name, signature, given, named)
                raise

        if not is_class:
            return with_checks
        target.__init__ = with_checks
        return target

    return decorate


def _require_fit(
    name: str, signature: inspect.Signature, given: Sequence[Any], named: Mapping[str, Any]
) -> None:
    """Raise InputError if a function of this signature cannot be called with these arguments."""
    try:
        signature.bind(*given, **named)
    except TypeError as error:
        names = ", ".join(key for key in signature.parameters if key not in ("self", "cls"))
        change = "Correct the names and the number of the arguments."
        raise InputError(name, seen=str(error), expected=f"{name}({names})", change=change) from error
