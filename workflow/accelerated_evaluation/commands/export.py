"""The subcommand ``export``, which writes a weighted set of scenarios."""

import argparse
from pathlib import Path

from accelerated_evaluation.commands import (
    COMMANDS,
    LAW,
    add_accept,
    add_law,
    add_seed,
    given_law,
    refuse_options,
    require_seed,
)

SAFE = 1.5  # [m/s^2], cut-ins that need a smaller deceleration are assumed to be safe
DESCRIPTION = f"""\
Write a weighted set of concrete scenarios, from which anyone can compute a vehicle's crash probability.

FOLDER contains the scenarios as OpenSCENARIO XML 1.2 with their OpenDRIVE road, scenarios.csv with the
weights, and README.md, which explains how to compute the crash probability and its interval from the outcomes
of a vehicle. For scenarios other than the cut-in (--scenario), there are no OpenSCENARIO files. If the law
has draws, weights.csv has the weights under at most 100 of them.

{LAW}

example, after `make study`:
  accelerated-evaluation export cut_ins \\
      --law results/spmd/laws/draws.json --encounters results/spmd/encounters.parquet"""


@COMMANDS.add("export")
class Export:
    """Write a weighted set of scenarios with instructions."""

    help = "write a weighted set of scenarios for others to drive"
    description = DESCRIPTION

    @staticmethod
    def add_arguments(command: argparse.ArgumentParser) -> None:
        """Add the arguments to the parser: the folder, the law, and the properties of the scenario set."""
        command.add_argument("folder", metavar="FOLDER", type=Path, help="new folder for the set")
        add_law(command)
        command.add_argument(
            "--size", type=int, default=300, metavar="N", help="largest number of scenarios (default: 300)"
        )
        command.add_argument(
            "--safe-deceleration",
            type=float,
            metavar="A",
            help=f"cut-ins that this deceleration avoids are assumed to be safe [m/s^2] (default: {SAFE})",
        )
        command.add_argument(
            "--motion",
            choices=["ngsim"],
            help="for cut-ins, let the other car change its speed as in the recordings of NGSIM (default: it "
            "keeps its speed)",
        )
        add_seed(command)
        add_accept(command)

    @staticmethod
    def run(arguments: argparse.Namespace) -> None:
        """Draw the set, write it, and print its path."""
        from accelerated_evaluation.base.errors import InputError
        from accelerated_evaluation.base.randomness import child_generator
        from accelerated_evaluation.laws.motion import MOTIONS
        from accelerated_evaluation.track.export import with_motion, write_set
        from accelerated_evaluation.track.scenarios import NOT_WRITTEN
        from accelerated_evaluation.track.weighted_set import draw_scored_set, draw_weighted_set

        require_seed(arguments.seed)
        given = given_law(arguments)
        scenario, law = given.scenario, given.law
        generator, data = child_generator(arguments.seed, "export"), {}
        if given.table is None:
            refuse_options(arguments, scenario.name, "safe_deceleration", "motion")
        else:
            data["data"] = given.table.attrs.get("description", "not described")
        safe = arguments.safe_deceleration
        if law.strata:
            drawn = draw_weighted_set(law, arguments.size, SAFE if safe is None else safe, generator)
        elif safe is None:
            drawn = draw_scored_set(scenario, law, arguments.size, generator)
        else:
            raise InputError(
                "--safe-deceleration",
                seen=f"a law without strata ({law.description})",
                expected="a law of cut-ins in strata of the lead speed",
                change="Leave the option out. No cut-in is then assumed to be safe.",
            )
        if arguments.motion:
            drawn = with_motion(drawn, MOTIONS[arguments.motion](), child_generator(arguments.seed, "motion"))
            data["lead motion"] = (
                f"{arguments.motion}; cut-ins are assumed to be safe as with a constant lead speed"
            )
        origin = {
            f"law of {scenario.noun}s": law.description,
            **data,
            **{f"{name}, SHA-256": source.sha256 for name, source in given.sources.items()},
            "seed": str(arguments.seed),
            **dict(line.split(": ", 1) for line in given.verdict.lines()),
        }
        write_set(arguments.folder, drawn, origin, scenario)
        for line in [*given.verdict.lines(), *([NOT_WRITTEN] if given.table is None else [])]:
            print(line)
        print(f"{len(drawn.table)} scenarios: {arguments.folder}; read {arguments.folder / 'README.md'}")
