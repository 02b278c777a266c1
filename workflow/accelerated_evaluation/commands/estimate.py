"""The subcommand ``estimate``."""

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from accelerated_evaluation.commands import COMMANDS, add_accept

if TYPE_CHECKING:  # takes seconds, which --help can do without
    from accelerated_evaluation.answer.estimation import Alone

DESCRIPTION = """\
Estimate the crash probability of a cut-in with the surrogate-guided method only, which takes about 200
simulations. Crash maps and crude Monte Carlo, which take millions, are not used. The command is for slow
vehicles: a command in any language, an FMU, or a Python class. docs/your_vehicle.md shows all three.

The configuration is that of a study; it names the records and the vehicle. Outcomes are stored in
results/vehicles/, so that a run that is continued or repeated simulates no encounter twice.

laws of cut-ins (--law):
  answer          the smooth law with dependence that the records support best, as in the answer of the
                  study; all laws of the family are fitted and weighted, in seconds (default)
  paper           the paper's law, with the pieces that the configuration names; also two_pieces,
                  three_pieces and single
  NAME            one law of the family, such as 'two kinds 0.95'; a name that is not known lists them all
  FILE.json       a law of a finished study, results/STUDY/laws/answer.json or results/STUDY/models/*.json;
                  the configuration has to be that of this study
The records are checked first. If a check says stop, nothing is estimated unless --accept names this check.
The interval is that of the sampling: it describes the error of the estimated probability under this one law.
The uncertainty about the law itself is not included; the complete study reports it.

files written to results/STUDY/estimate/:
  estimate.csv    probability, ci_low, ci_high, simulations, law; one row a replicate
  runs.csv        every simulation: its cut-in, its phase, and whether it crashed
  account.csv     how many records each step found, dropped and kept
  law.json        the law of cut-ins"""


def _count(text: str) -> int:
    if (count := int(text)) < 1:
        raise ValueError
    return count


_count.__name__ = "number from 1 on"  # argparse names the type in its message


@COMMANDS.add("estimate")
class EstimateAlone:
    """Estimate the crash probability of a slow vehicle."""

    help = "estimate the crash probability of a slow vehicle by some 200 simulations"
    description = DESCRIPTION

    @staticmethod
    def add_arguments(command: argparse.ArgumentParser) -> None:
        """Add the configuration, the law and the number of replicates."""
        command.add_argument(
            "--config",
            metavar="FILE",
            type=Path,
            action="append",
            default=[],
            help="what differs from config/config.yaml; a later file overrules an earlier one",
        )
        command.add_argument(
            "--law", metavar="LAW", default="answer", help="law of cut-ins, see above (default: %(default)s)"
        )
        command.add_argument(
            "--replicates",
            metavar="N",
            type=_count,
            default=1,
            help="independent repetitions, of some 200 simulations each (default: %(default)s)",
        )
        command.add_argument(
            "--predecessor",
            metavar="RUNS.csv",
            type=Path,
            help="runs.csv of an earlier estimate, of a vehicle like this one and under the same law; "
            "it saves about two fifths of the simulations",
        )
        add_accept(command)

    @staticmethod
    def run(arguments: argparse.Namespace) -> None:
        """Estimate the probability, write the tables, and print a summary."""
        from accelerated_evaluation.answer.estimation import estimate_alone
        from accelerated_evaluation.base.files import write_csv
        from accelerated_evaluation.laws.files import write_law
        from accelerated_evaluation.study.configuration import load, resolved

        config = load(arguments.config)
        config["data"]["accepted_warnings"] = [*config["data"]["accepted_warnings"], *arguments.accept]
        config = resolved(config)
        found = estimate_alone(config, arguments.replicates, arguments.law, arguments.predecessor)
        folder = Path("results", config["study"], "estimate")
        for name, table in found.tables.items():
            write_csv(folder / f"{name}.csv", table)
        write_law(folder / "law.json", found.law, found.encounters)
        print(_in_words(found, 1 - config["importance_sampling"]["alpha"]), f"tables: {folder}", sep="\n")


def _in_words(found: "Alone", level: float) -> str:
    """Return the estimates, what they took and what they may have missed, in lines of text."""
    from accelerated_evaluation.methods.surrogate.certificate import unseen_in_words

    lines = [*found.verdict.lines(), f"law of cut-ins: {found.name}"]
    for row in found.tables["estimate"].to_dict("records"):
        verdict = "converged" if row["converged"] else "not converged"
        probability = "not known yet" if math.isnan(row["probability"]) else f"{row['probability']:.3g}"
        lines.append(
            f"crash probability of a cut-in under this law: {probability}, {level:.0%} interval of the "
            f"sampling alone {row['ci_low']:.2g} to {row['ci_high']:.2g}; {verdict} after "
            f"{row['learning'] + row['estimating']:,} encounters, {row['events']:,} of them crashes"
        )
        lines.append(unseen_in_words(row))
    if (vehicle := found.vehicle) is not None:
        lines.append(
            f"simulated: {vehicle.simulated:,}; taken from the store: {vehicle.found:,}; "
            f"kept: {len(vehicle.store):,} in {vehicle.store.path}"
        )
    return "\n".join(lines)
