"""The subcommands of ``accelerated-evaluation``: a new one is one new module of this package.

Modules import here what is light alone, and the rest when they run, because ``--help`` imports every one.
"""

import argparse
from typing import Protocol

from accelerated_evaluation.registry import Registry


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
        """Run it; raise StudyError or OSError, whose text the user reads, where it cannot go on."""


COMMANDS: Registry[Command] = Registry("command", __name__, __path__)
