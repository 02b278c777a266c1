"""Arguments of commands, each stated once: as a field of a dataclass, with its help, type and default."""

import argparse
import re
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import MISSING, field, fields
from pathlib import Path
from types import NoneType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from accelerated_evaluation.base.arguments import WRONG, Argument, a_number
from accelerated_evaluation.base.numerals import number_in

Kind = TypeVar("Kind")
COMMAND = r"^ +(accelerated-evaluation |echo |make |--)|\\$"  # a line of a command
WHOLE: dict[str, Any] = {"break_long_words": False, "break_on_hyphens": False}


class Help(argparse.RawDescriptionHelpFormatter):
    """Help at the width of the terminal: words are not broken, and columns of descriptions are kept."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return wrapped(text, width)

    def _split_lines(self, text: str, width: int) -> list[str]:
        return textwrap.wrap(" ".join(text.split()), width, **WHOLE)


def wrapped(text: str, width: int) -> str:
    """Return paragraphs and two columns of text at a width; lines with a command stay as they are.

    A column begins after two or more spaces, and a further line of a paragraph in the same column.
    """
    found: list[tuple[int, str]] = []  # the column of the text, and the paragraph
    for line in text.splitlines():
        column = len(re.sub(r"( *(\S.*?  +)?).*", r"\1", line))
        goes_on = found and found[-1][0] == column and line.strip() and not line[:column].strip()
        if goes_on and found[-1][1].strip() and not re.search(COMMAND, found[-1][1] + line):
            found[-1] = (column, f"{found[-1][1]} {line.strip()}")
        else:
            found.append((column, line))
    return "\n".join(
        line
        if re.search(COMMAND, line)
        else textwrap.fill(line, width, subsequent_indent=" " * column, **WHOLE)
        for column, line in found
    )


def argument(metavar: str, words: str, **rest: Any) -> Any:  # noqa: ANN401
    """Return a field that is an argument of a command without a name; see `option`."""
    return field(kw_only=True, metadata={"metavar": metavar, "help": words, **rest})


def option(metavar: Any, words: str, default: Any = None, **rest: Any) -> Any:  # noqa: ANN401
    """Return a field that is an option of a command.

    ``metavar`` stands for its value in the help, which is ``words``. ``rest`` has further arguments of
    `argparse`; ``flag``, if the option does not have the name of the field; and ``group``, title and
    description of a group of options. The type of the option follows from the type hint of the field: a
    sequence may be given several times, or has ``nargs``.
    """
    return field(default=default, metadata={"metavar": metavar, "help": words, **rest})


def switch(words: str, **rest: Any) -> Any:  # noqa: ANN401
    """Return a field that is an option without a value."""
    return field(default=False, metadata={"action": "store_true", "help": words, **rest})


def add_options(command: argparse.ArgumentParser, kind: type) -> None:
    """Add the fields of a dataclass to a command, as its arguments and options."""
    hints = get_type_hints(kind)
    groups: dict[Any, Any] = {}
    for each in fields(kind):
        given, hint = dict(each.metadata), hints[each.name]
        group, flag = given.pop("group", None), given.pop("flag", f"--{each.name.replace('_', '-')}")
        if group not in groups:
            groups[group] = command.add_argument_group(*group) if group else command
        place = groups[group]
        if (read := next(one for one in get_args(hint) or [hint] if one is not NoneType)) not in (bool, str):
            given.setdefault("type", read)
        if each.default is MISSING:
            place.add_argument(each.name, **given)
            continue
        default = each.default
        if get_origin(hint) is Sequence and "nargs" not in given:
            given["action"], default = "append", list(default)
        place.add_argument(flag, dest=each.name, default=default, **given)


def options_in(given: object, kind: type[Kind]) -> Kind:
    """Return a dataclass of this kind, with its fields from the attributes of an object."""
    names = [each.name for each in fields(kind)]  # type: ignore[arg-type]  # every kind is a dataclass
    return kind(**{name: getattr(given, name) for name in names})


def read_from(argument: Argument, kind: type[int] | type[float] = float) -> Callable[[str], float]:
    """Return the type of an option whose text states a number that an argument of a function may be."""

    def read(text: str) -> float:
        try:
            return argument.take(number_in(text, kind))
        except WRONG as error:
            words = f"seen {text!r}; expected {argument.in_words}. Correct the value."
            raise argparse.ArgumentTypeError(words) from error

    return read


# How the texts of options that have the type int or float are converted; see `cli.Parser`.
PLAIN_NUMBERS = {int: read_from(a_number(whole=True), int), float: read_from(a_number())}
positive_integer = read_from(a_number(1, whole=True), int)


def csv_file(text: str) -> Path:
    """Return the value of an option that names a table to write; argparse reports another ending."""
    if not text.endswith(".csv"):
        raise argparse.ArgumentTypeError(
            f"seen {text!r}; expected a name that ends in .csv. Write a CSV table, and convert it afterwards."
        )
    return Path(text)
