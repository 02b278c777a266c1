"""The subcommands of ``accelerated-evaluation``: each is one module of this package.

Modules of this package import slow libraries only when they run, because ``--help`` imports all modules.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.numerals import number_in
from accelerated_evaluation.base.registry import Registry

if TYPE_CHECKING:  # these imports take seconds, and --help does not need them
    import pandas as pd

    from accelerated_evaluation.laws import Law
    from accelerated_evaluation.records.verdict import Verdict
    from accelerated_evaluation.scenarios import Scenario
    from accelerated_evaluation.track.law_files import InputFile

LAW = """\
A law of a study is results/STUDY/laws/answer.json (the law that the records support best) or
results/STUDY/models/two_pieces.json (the paper's). It was fitted to results/STUDY/encounters.parquet.
The law of another scenario (--scenario) is results/STUDY/laws/answer.json of its study, and needs no
encounter table. With draws of the law, which are in results/STUDY/laws/draws.json and in
results/STUDY/estimate/law.json, the intervals also contain the uncertainty of the records."""


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


def add_law(command: argparse.ArgumentParser) -> None:
    """Add the options ``--scenario``, ``--law`` and ``--encounters`` to a command; `given_law` reads them."""
    add_scenario_name(command)
    command.add_argument("--law", metavar="LAW.json", type=Path, required=True, help="law of the encounters")
    command.add_argument(
        "--encounters",
        metavar="FILE",
        type=Path,
        help="encounter table that the law of cut-ins was fitted to",
    )


@dataclass(frozen=True)
class NamedLaw:
    """The law that the options of a command name."""

    scenario: "Scenario"
    # The files ``law`` and, for a law of cut-ins, ``encounters``, with their checksums.
    sources: dict[str, "InputFile"]
    verdict: "Verdict"  # on the records of the encounter table or of the law file
    law: "Law"
    table: "pd.DataFrame | None" = None  # the encounter table; None for other scenarios


def given_law(arguments: argparse.Namespace) -> NamedLaw:
    """Return the law that is named by the options of `add_law`.

    InputError is raised if a file is missing; if there is no encounter table for a law of cut-ins, or a table
    for another law; or if a check of the records has the verdict ``stop``, which the user does not accept.
    """
    from accelerated_evaluation.laws.files import read_verdict
    from accelerated_evaluation.records.segments import read_encounters
    from accelerated_evaluation.records.verdict import verdict_on_encounters
    from accelerated_evaluation.scenarios import SCENARIOS
    from accelerated_evaluation.track.law_files import law_in, source_of

    scenario = SCENARIOS[arguments.scenario]
    if "segments" not in scenario.stages:
        refuse_options(arguments, scenario.name, "encounters")
        law = source_of(arguments.law)
        verdict = read_verdict(law.file, arguments.accept)
        return NamedLaw(scenario, {"law": law}, verdict, law_in(scenario, law, None))
    if arguments.encounters is None:
        raise InputError(
            "--encounters",
            seen="nothing",
            expected="the encounter table that the law of cut-ins was fitted to",
            change="Name the table, or name the scenario of another law by --scenario.",
        )
    sources = {name: source_of(getattr(arguments, name)) for name in ("law", "encounters")}
    table = read_encounters(arguments.encounters)
    verdict = verdict_on_encounters(table, str(arguments.encounters), arguments.accept)
    return NamedLaw(scenario, sources, verdict, law_in(scenario, **sources), table)


def refuse_options(arguments: argparse.Namespace, scenario: str, *names: str) -> None:
    """Raise InputError if an option that is only for cut-ins was given; the names have underscores."""
    from accelerated_evaluation.scenarios import DEFAULT

    for name in names:
        if getattr(arguments, name) not in (None, []):
            option = f"--{name.replace('_', '-')}"
            raise InputError(
                option, seen=f"the scenario {scenario}", expected=DEFAULT, change="Leave the option out."
            )


def add_scenario_name(command: argparse.ArgumentParser) -> None:
    """Add the option ``--scenario`` to a command."""
    from accelerated_evaluation.scenarios import DEFAULT, SCENARIOS

    command.add_argument(
        "--scenario",
        metavar="NAME",
        default=DEFAULT,
        help=f"kind of encounter: {', '.join(SCENARIOS)} (default: %(default)s)",
    )


def add_scenario(command: argparse.ArgumentParser) -> None:
    """Add the options ``--scenario`` and ``--vehicle`` to a command."""
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
    """Add the option ``--seed``, the root seed of all randomness, to a command."""
    command.add_argument("--seed", type=int, default=1, help="root seed of all randomness (default: 1)")


def add_accept(command: argparse.ArgumentParser) -> None:
    """Add the option ``--accept``, which names checks whose verdict ``stop`` is accepted, to a command."""
    command.add_argument(
        "--accept",
        metavar="CHECK",
        action="append",
        default=[],
        help="accept the verdict stop of a check of the records, such as 'speed unit'; may be repeated",
    )


def number_option(
    expected: str,
    fits: Callable[[float], bool] = lambda _: True,
    kind: type[int] | type[float] = float,
) -> Callable[[str], float]:
    """Return the type of an option that is a number, with the words for what is expected of it."""

    def read(text: str) -> float:
        try:
            value = number_in(text, kind)
        except ValueError:
            value = None
        if value is None or not fits(value):
            raise argparse.ArgumentTypeError(f"seen {text!r}; expected {expected}. Correct the value.")
        return value

    return read


# How the texts of options that have the type int or float are converted; see `cli.Parser`.
PLAIN_NUMBERS = {int: number_option("a whole number", kind=int), float: number_option("a number")}
positive_integer = number_option("a whole number of 1 or more", lambda value: value >= 1, int)


def csv_file(text: str) -> Path:
    """Return the value of an option that names a table to write; argparse reports another ending."""
    if not text.endswith(".csv"):
        raise argparse.ArgumentTypeError(
            f"seen {text!r}; expected a name that ends in .csv. Write a CSV table, and convert it afterwards."
        )
    return Path(text)


def require_seed(seed: int) -> None:
    """Raise InputError unless a seed is 0 or more."""
    if seed < 0:
        raise InputError("--seed", seen=str(seed), expected="0 or more", change="Correct the value.")
