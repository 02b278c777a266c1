"""The command ``accelerated-evaluation``; its subcommands: modules of `accelerated_evaluation.commands`."""

import argparse
import difflib
import os
import re
import sys
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any, NoReturn

import argcomplete

from accelerated_evaluation.base.errors import InputError, StudyError, unusable
from accelerated_evaluation.base.extensions import faults_reported
from accelerated_evaluation.base.options import PLAIN_NUMBERS, Help
from accelerated_evaluation.commands import COMMANDS

EXIT = """If the input is wrong, the command prints one message on standard error, ends with exit status 2,
and leaves no incomplete file."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command ``accelerated-evaluation`` with one of its subcommands.

    Parameters
    ----------
    argv
        Arguments of the command; None for those of the process.

    Returns
    -------
    int
        Exit status: 0, 1 for a result that the command names, 2 after bad input, or 130 if the command was
        stopped from the keyboard.
    """
    given = sys.argv[1:] if argv is None else argv
    if argv is None and not sys.stderr.isatty():
        os.environ.setdefault("TQDM_DISABLE", "1")  # a log would contain every state of a progress bar
    try:
        with faults_reported():  # of installed packages that may be of no concern to the command
            own = parser()
        argcomplete.autocomplete(own)  # if the shell asks for completions, this prints them and ends
        arguments = own.parse_args(given)
        _require_values(given)
        return int(arguments.run(arguments) or 0)
    except (StudyError, OSError) as error:
        print("error:", *str(unusable(error)).split(), file=sys.stderr)
        return 2
    except KeyboardInterrupt as stop:
        kept = f"; {stop}" if str(stop) else "; a file is written completely or not at all"
        print(f"stopped from the keyboard{kept}", file=sys.stderr)
        return 130
    return 0


def _require_values(given: Sequence[str]) -> None:
    """Raise InputError if an argument is empty, which most often is an unset variable of the shell."""
    for before, text in zip(["the command", *given], given, strict=False):
        option, _, value = text.partition("=") if text.startswith("--") and "=" in text else ("", "", text)
        if not value.strip():
            raise InputError(
                option or f"the argument after {before}",
                seen="an empty text",
                expected="a value",
                change="If the value is that of a variable of the shell, set the variable first.",
            )


class ShortHelp(argparse.Action):
    """The option ``-h`` of a subcommand: its options, without the long description of ``--help``."""

    def __init__(self, option_strings: Sequence[str], dest: str, **rest: Any) -> None:  # noqa: ANN401
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, default=argparse.SUPPRESS, **rest)

    def __call__(self, own: argparse.ArgumentParser, *_: object) -> None:
        """Print the short help and end."""
        first = re.split(r"\.\s", own.description)[0].rstrip(".")
        own.description = f"{first}.\n`--help` says more."
        own.epilog = None
        own.print_help()
        own.exit()


class Parser(argparse.ArgumentParser):
    """A parser whose options of type int and float refuse what only Python reads as a number, such as 1_0."""

    def __init__(self, *positional: Any, **named: Any) -> None:  # noqa: ANN401
        super().__init__(*positional, **{"formatter_class": Help, **named})
        for kind, read in PLAIN_NUMBERS.items():
            self.register("type", kind, read)

    def error(self, message: str) -> NoReturn:
        """Print a message and end; after a choice that does not exist, it names the most similar one."""
        given, *choices = re.findall("'([^']*)'", message) if "invalid choice" in message else [""]
        near = difflib.get_close_matches(given, choices, 1)
        super().error(f"{message}; did you mean {near[0]}?" if near else message)


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command with all subcommands."""
    own = Parser(
        prog="accelerated-evaluation",
        description="Crash probability of automated vehicles in cut-ins by accelerated evaluation.",
    )
    own.add_argument("--version", action="version", version=f"%(prog)s {version('accelerated-evaluation')}")
    commands = own.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name, command in COMMANDS.items():
        subparser = commands.add_parser(
            name,
            help=command.help,
            description=command.description,
            epilog=EXIT,
            add_help=False,
        )
        subparser.add_argument("-h", action=ShortHelp, help="show the options and exit")
        subparser.add_argument("--help", action="help", help="show the description and the options, and exit")
        command.add_arguments(subparser)
        subparser.set_defaults(run=command.run)
    return own


if __name__ == "__main__":
    sys.exit(main())
