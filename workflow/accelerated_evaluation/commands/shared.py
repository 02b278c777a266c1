"""What several subcommands share: their common options, and the law that these name."""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.options import add_options, option, options_in
from accelerated_evaluation.scenarios import DEFAULT, SCENARIOS, Scenario
from accelerated_evaluation.vehicles.loading import vehicles_of

if TYPE_CHECKING:  # these imports take seconds, and --help does not need them
    import pandas as pd

    from accelerated_evaluation.laws import Law
    from accelerated_evaluation.records.verdict import Verdict
    from accelerated_evaluation.track.law_files import InputFile

LAW = """\
A law of a study is results/STUDY/laws/answer.json (the law that the records support best) or
results/STUDY/models/two_pieces.json (the paper's). It was fitted to results/STUDY/encounters.parquet.
The law of another scenario (--scenario) is results/STUDY/laws/answer.json of its study, and needs no
encounter table. With draws of the law, which are in results/STUDY/laws/draws.json and in
results/STUDY/estimate/law.json, the intervals also contain the uncertainty of the records."""
VEHICLES = "; ".join(f"{name}: {', '.join(vehicles_of(each))}" for name, each in SCENARIOS.items())
DEFAULT_VEHICLES = " or ".join(dict.fromkeys(each.default_vehicle for each in SCENARIOS.values()))


class Command:
    """A subcommand that is a dataclass: its arguments are its fields (`base.options`).

    Its docstring is the line in the list of subcommands, and ``description`` is the text of its ``--help``.
    """

    help: ClassVar[str]
    description: ClassVar[str]

    def __init_subclass__(cls, description: str = "") -> None:
        """Take the help from the docstring, which begins with a capital letter and ends with a full stop."""
        words = cls.__doc__ or ""
        cls.help, cls.description = words[:1].lower() + words[1:].removesuffix("."), description

    @classmethod
    def add_arguments(cls, command: argparse.ArgumentParser) -> None:
        """Add the fields to the parser."""
        add_options(command, cls)

    @classmethod
    def run(cls, arguments: argparse.Namespace) -> int | None:
        """Run the subcommand with its arguments."""
        return options_in(arguments, cls).start()

    def start(self) -> int | None:
        """Run the subcommand; see `Subcommand.run`."""
        raise NotImplementedError


@dataclass(frozen=True)
class Seeded(Command):
    """A subcommand that draws random numbers."""

    seed: int = option(None, "root seed of all randomness (default: %(default)s)", 1)

    def __post_init__(self) -> None:
        """Raise InputError unless the seed is 0 or more."""
        if self.seed < 0:
            raise InputError("--seed", seen=str(self.seed), expected="0 or more", change="Correct the value.")


@dataclass(frozen=True)
class Accepting(Command):
    """A subcommand that checks records."""

    accept: Sequence[str] = option(
        "CHECK",
        "accept the verdict stop of a check of the records, such as 'speed unit'; may be repeated",
        (),
    )


@dataclass(frozen=True)
class OfScenario(Command):
    """A subcommand for encounters of one scenario."""

    scenario: str = option(
        "NAME", f"kind of encounter: {', '.join(SCENARIOS)} (default: %(default)s)", DEFAULT
    )


@dataclass(frozen=True)
class OfVehicle(OfScenario):
    """A subcommand that simulates a vehicle in one scenario."""

    vehicle: str | None = option(
        "NAME",
        f"vehicle of the scenario ({VEHICLES}), or path/to/file.py:ClassName for your own (default: "
        f"{DEFAULT_VEHICLES})",
    )


@dataclass(frozen=True)
class OfLaw(Seeded, Accepting, OfScenario):
    """A subcommand for a law of encounters, which `given_law` returns."""

    law: Path = option("LAW.json", "law of the encounters", required=True)
    encounters: Path | None = option("FILE", "encounter table that the law of cut-ins was fitted to")


@dataclass(frozen=True)
class NamedLaw:
    """The law that the options of a command name."""

    scenario: Scenario
    # The files ``law`` and, for a law of cut-ins, ``encounters``, with their checksums.
    sources: dict[str, "InputFile"]
    verdict: "Verdict"  # on the records of the encounter table or of the law file
    law: "Law"
    table: "pd.DataFrame | None" = None  # the encounter table; None for other scenarios


def given_law(arguments: OfLaw) -> NamedLaw:
    """Return the law that is named by the options of `OfLaw`.

    InputError is raised if a file is missing; if there is no encounter table for a law of cut-ins, or a table
    for another law; or if a check of the records has the verdict ``stop``, which the user does not accept.
    """
    from accelerated_evaluation.laws.files import read_verdict
    from accelerated_evaluation.records.segments import read_encounters
    from accelerated_evaluation.records.verdict import verdict_on_encounters
    from accelerated_evaluation.track.law_files import law_in, source_of

    scenario = SCENARIOS[arguments.scenario]
    if not scenario.has_support:
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


def refuse_options(arguments: OfScenario, scenario: str, *names: str) -> None:
    """Raise InputError if an option that is only for cut-ins was given; the names have underscores."""
    for name in names:
        if getattr(arguments, name) not in (None, []):
            option = f"--{name.replace('_', '-')}"
            raise InputError(
                option, seen=f"the scenario {scenario}", expected=DEFAULT, change="Leave the option out."
            )
