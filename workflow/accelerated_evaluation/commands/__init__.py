"""The subcommands of ``accelerated-evaluation``: each is one module of this package.

Modules of this package import slow libraries only when they run, because ``--help`` imports all modules.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.registry import Registry

if TYPE_CHECKING:  # takes seconds, which --help can do without
    import pandas as pd

    from accelerated_evaluation.laws import Law
    from accelerated_evaluation.laws.joint import JointLaw
    from accelerated_evaluation.records.verdict import Verdict
    from accelerated_evaluation.scenarios import Scenario
    from accelerated_evaluation.track.sources import Source


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
results/STUDY/models/two_pieces.json (the paper's). Its encounter table: results/STUDY/encounters.parquet.
The law of another scenario (--scenario) is results/STUDY/scenario/law.json; it needs no encounter table."""


def add_law(command: argparse.ArgumentParser) -> None:
    """Add the arguments for the scenario, its law, and the table to which a law of cut-ins was fitted."""
    add_scenario_name(command)
    command.add_argument("--law", metavar="LAW.json", type=Path, required=True, help="law of the encounters")
    command.add_argument(
        "--encounters",
        metavar="FILE",
        type=Path,
        help="encounter table that the law of cut-ins was fitted to",
    )


@dataclass(frozen=True)
class GivenLaw:
    """The law that a command was given.

    Attributes
    ----------
    scenario
        Its scenario.
    sources
        The law file, and the encounter table of a law of cut-ins, by name.
    verdict
        Verdict on the records of this table; None for other scenarios.
    table
        This table; None for other scenarios.
    """

    scenario: "Scenario"
    sources: dict[str, "Source"]
    verdict: "Verdict | None" = None
    table: "pd.DataFrame | None" = None

    def read(self) -> "tuple[Law | JointLaw, str]":
        """Return the law and its description."""
        from accelerated_evaluation.track.sources import law_in

        return law_in(self.scenario, self.sources["law"], self.sources.get("encounters"))

    def stop_lines(self) -> list[str]:
        """Return a line for each check of the records that says ``stop``, which the user accepts."""
        return [] if self.verdict is None else self.verdict.stop_lines()

    def lines(self) -> list[str]:
        """Return the verdict on the records in lines of text."""
        return [] if self.verdict is None else self.verdict.lines()


def given_law(arguments: argparse.Namespace) -> GivenLaw:
    """Return the law that `add_law` was given.

    Raises
    ------
    InputError
        If a file is missing, a law of cut-ins has no encounter table or another one has, or the records of
        the table have a fault that the user does not accept.
    """
    from accelerated_evaluation.laws.files import read_law, require_shares
    from accelerated_evaluation.records.encounter_table import read_encounters
    from accelerated_evaluation.records.verdict import verdict_on_encounters
    from accelerated_evaluation.scenarios import SCENARIOS
    from accelerated_evaluation.scenarios.cut_in import CUT_IN
    from accelerated_evaluation.track.sources import source_of

    scenario = SCENARIOS[arguments.scenario]
    if scenario is not CUT_IN:
        refuse_options(arguments, scenario.name, "encounters", "accept")
        return GivenLaw(scenario, {"law": source_of(arguments.law)})
    if arguments.encounters is None:
        raise InputError(
            "--encounters",
            seen="nothing",
            expected="the encounter table that the law of cut-ins was fitted to",
            change="Name it, or name the scenario of another law (--scenario).",
        )
    sources = {name: source_of(getattr(arguments, name)) for name in ("law", "encounters")}
    table = read_encounters(arguments.encounters)
    verdict = verdict_on_encounters(table, str(arguments.encounters), arguments.accept)
    require_shares(arguments.law, read_law(arguments.law, table), table)
    return GivenLaw(scenario, sources, verdict, table)


def refuse_options(arguments: argparse.Namespace, scenario: str, *names: str) -> None:
    """Raise InputError if an option that is for cut-ins alone is given with another scenario."""
    for name in names:
        if getattr(arguments, name) not in (None, []):
            option = f"--{name.replace('_', '-')}"
            raise InputError(
                option, seen=f"the scenario {scenario}", expected="cut_in", change="Leave it out."
            )


def add_scenario_name(command: argparse.ArgumentParser) -> None:
    """Add the argument for the scenario."""
    from accelerated_evaluation.scenarios import SCENARIOS

    command.add_argument(
        "--scenario",
        metavar="NAME",
        default="cut_in",
        help=f"kind of encounter: {', '.join(SCENARIOS)} (default: %(default)s)",
    )


def add_scenario(command: argparse.ArgumentParser) -> None:
    """Add the arguments for the scenario and the vehicle."""
    from accelerated_evaluation.scenarios import SCENARIOS
    from accelerated_evaluation.vehicles.loading import vehicles_of

    add_scenario_name(command)
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
