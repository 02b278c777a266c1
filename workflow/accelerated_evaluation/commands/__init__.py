"""The subcommands of ``accelerated-evaluation``: each is one module of this package.

Modules of this package import slow libraries only when they run, because ``--help`` imports all modules.
"""

import argparse
from typing import Protocol

from accelerated_evaluation.base.registry import Registry


class Subcommand(Protocol):
    """A subcommand of ``accelerated-evaluation``."""

    help: str
    """One line for the list of subcommands."""
    description: str
    """Text that ``--help`` of the subcommand prints without changing its layout."""

    @staticmethod
    def add_arguments(command: argparse.ArgumentParser) -> None:
        """Add the arguments of the subcommand to its parser."""

    @staticmethod
    def run(arguments: argparse.Namespace) -> int | None:
        """Run the subcommand.

        If it cannot continue, it raises StudyError or OSError, whose message is printed for the user.
        """


COMMANDS: Registry[Subcommand] = Registry("command", __name__, __path__, contract=[Subcommand])
