"""The subcommand ``export``."""

import argparse
from pathlib import Path

from accelerated_evaluation.commands import COMMANDS, LAW, add_accept, add_law, add_seed, require_seed

DESCRIPTION = f"""\
Write a weighted set of concrete scenarios, from which anyone can compute a vehicle's crash probability.

FOLDER holds the scenarios as OpenSCENARIO XML 1.2 with their OpenDRIVE road, scenarios.csv with the weights,
and README.md, which says how to compute the crash probability and its interval from one's own outcomes.

{LAW}"""


@COMMANDS.add("export")
class Export:
    """Write a weighted set of scenarios."""

    help = "write a weighted set of scenarios for others to drive"
    description = DESCRIPTION

    @staticmethod
    def add_arguments(command: argparse.ArgumentParser) -> None:
        """Add the folder, the law and what the set should be like."""
        command.add_argument("folder", metavar="FOLDER", type=Path, help="folder to make")
        add_law(command)
        command.add_argument(
            "--size", type=int, default=300, metavar="N", help="at most so many scenarios (default: 300)"
        )
        command.add_argument(
            "--safe-deceleration",
            type=float,
            default=1.5,
            metavar="A",
            help="cut-ins that this deceleration avoids are assumed to be safe [m/s^2] (default: 1.5)",
        )
        add_seed(command)
        add_accept(command)

    @staticmethod
    def run(arguments: argparse.Namespace) -> None:
        """Draw the set and write it."""
        from accelerated_evaluation.base.randomness import child_generator
        from accelerated_evaluation.laws.files import read_law, require_shares
        from accelerated_evaluation.records.encounter_table import read_encounters
        from accelerated_evaluation.records.verdict import verdict_on_encounters
        from accelerated_evaluation.track.campaign_file import source_of
        from accelerated_evaluation.track.export import write_set
        from accelerated_evaluation.track.weighted_set import draw_weighted_set

        require_seed(arguments.seed)
        sources = {name: source_of(getattr(arguments, name)) for name in ("law", "encounters")}
        encounters = read_encounters(arguments.encounters)
        verdict = verdict_on_encounters(encounters, str(arguments.encounters), arguments.accept)
        law = read_law(arguments.law, encounters)
        require_shares(arguments.law, law, encounters)
        generator = child_generator(arguments.seed, "export")
        drawn = draw_weighted_set(law, arguments.size, arguments.safe_deceleration, generator)
        origin = {
            "law of cut-ins": law.description,
            "data": encounters.attrs.get("description", "not described"),
            **{f"{name}, SHA-256": source.sha256 for name, source in sources.items()},
            "seed": str(arguments.seed),
            **dict(line.split(": ", 1) for line in verdict.stop_lines()),
        }
        write_set(arguments.folder, drawn, origin)
        for line in verdict.lines():
            print(line)
        print(f"{len(drawn.table)} scenarios: {arguments.folder}; read {arguments.folder / 'README.md'}")
