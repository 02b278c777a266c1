"""The subcommands of ``accelerated-evaluation``: each is one module of this package.

Modules of this package import slow libraries only when they run, because ``--help`` imports all modules.
"""

import argparse
from pathlib import Path
from typing import Protocol

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.registry import Registry


class Command(Protocol):
    """A subcommand."""

    help: str
    """One line for the list of commands."""
    description: str
    """What ``--help`` says of it, printed as it stands."""

    @staticmethod
    def add_arguments(command: argparse.ArgumentParser) -> None:
        """Add its arguments to the parser of the subcommand."""

    @staticmethod
    def run(arguments: argparse.Namespace) -> None:
        """Run the subcommand.

        Raise StudyError or OSError with a message for the user if it cannot continue.
        """


COMMANDS: Registry[Command] = Registry("command", __name__, __path__)
LAW = """\
A law of a study is results/STUDY/laws/answer.json (the law that the records support best) or
results/STUDY/models/two_pieces.json (the paper's). Its encounter table: results/STUDY/encounters.parquet."""


def add_law(command: argparse.ArgumentParser) -> None:
    """Add the arguments for the law of cut-ins and for the table to which it was fitted."""
    command.add_argument("--law", metavar="LAW.json", type=Path, required=True, help="law of the cut-ins")
    command.add_argument(
        "--encounters",
        metavar="FILE",
        type=Path,
        required=True,
        help="encounter table that the law was fitted to",
    )


def add_scenario(command: argparse.ArgumentParser) -> None:
    """Add the arguments for the scenario and the vehicle."""
    from accelerated_evaluation.scenarios import SCENARIOS
    from accelerated_evaluation.vehicles.loading import vehicles_of

    command.add_argument(
        "--scenario",
        metavar="NAME",
        default="cut_in",
        help=f"kind of encounter: {', '.join(SCENARIOS)} (default: %(default)s)",
    )
    names = "; ".join(f"{name}: {', '.join(vehicles_of(each))}" for name, each in SCENARIOS.items())
    defaults = dict.fromkeys(each.default_vehicle for each in SCENARIOS.values())
    command.add_argument(
        "--vehicle",
        metavar="NAME",
        help=f"vehicle of the scenario ({names}), or path/to/file.py:ClassName for your own (default: "
        f"{' or '.join(defaults)})",
    )


def add_seed(command: argparse.ArgumentParser) -> None:
    """Add the argument for the root seed of all randomness."""
    command.add_argument("--seed", type=int, default=1, help="root of all randomness (default: 1)")


def add_accept(command: argparse.ArgumentParser) -> None:
    """Add the checks of the records whose verdict ``stop`` the user accepts."""
    command.add_argument(
        "--accept",
        metavar="CHECK",
        action="append",
        default=[],
        help="accept the verdict stop of a check of the records, such as 'speed unit'; repeat it for others",
    )


def require_seed(seed: int) -> None:
    """Raise InputError unless a seed is 0 or more."""
    if seed < 0:
        raise InputError("--seed", seen=str(seed), expected="0 or more", change="Correct it.")
