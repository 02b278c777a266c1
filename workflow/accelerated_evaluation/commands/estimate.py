"""The subcommand ``estimate``, which estimates a crash probability from few simulations."""

import argparse
import json
import os
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TextIO

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import write_text
from accelerated_evaluation.commands import COMMANDS, add_accept, number_option, positive_integer

ANSWER = "answer"
VEHICLE = "vehicle.json"
DESCRIPTION = """\
Estimate the crash probability of a vehicle from few simulations, for slow vehicles: a program in any
language, an FMU, or a Python class; docs/your_vehicle.md shows all three. Usually 100 to 300 simulations are
enough, and 100 to 140 replays of records are added; a vehicle that is not stated to be deterministic takes
650 more. Crash maps and crude Monte Carlo, which need millions of simulations, are not used.

The configuration is that of a study. It names the records, the vehicle and the scenario: a cut-in by
default, or left_turn, pedestrian, or your own (docs/your_scenario.md). Outcomes are stored in
results/vehicles/, so that no encounter is simulated twice if a run is continued or repeated.

laws of the encounters (--law):
  answer          all laws that the records support, by their weights (default). The simulations are made
                  under one law that covers draws from the posterior of law and parameters, and are reweighted
                  for every draw. The intervals contain the uncertainty in the data, in the choice of law and
                  in the sampling, like those of a complete study
  NAME            for cut-ins, one law of the family, such as 'two kinds 0.95', with the uncertainty in its
                  parameters; otherwise a kind of joint law, such as gaussian_copula. An unknown name gives an
                  error that lists all names
  FILE.json       law.json of an earlier estimate, with its draws; or a law of a finished study. The
                  configuration has to be that of this study
  paper           for cut-ins, the paper's law, with the pieces that the configuration names; also two_pieces,
                  three_pieces and single
Under a single law, the interval is that of the sampling alone.

The records are checked first. If a check says stop, nothing is estimated unless --accept names this check.
The simulations end when the sampling increases the width of the 80 % interval by less than 5 %
(--sampling-share), or when the interval of the sampling alone is as narrow as in the paper
(importance_sampling.beta).

files written to results/STUDY/estimate/:
  answer.csv      probability (mean), median, intervals and rate per kilometre, for each replicate and event
  budget.csv      sources of the uncertainty: data, far tail, choice of law, sampling
  draws.csv       the crash probability under every draw of the law, with its relative sampling error
  exposure.csv    crashes per kilometre and hour, if the exposure of the records is known
  compared.csv    ratio to other vehicles, its 80 % interval, and the probability to be safer (--compare,
                  --reference)
  criteria.csv    whether each criterion is met, with one-sided bounds; deciding.csv: what would decide it
  crashes.csv     the simulations that crashed, with their shares of the crash probability
  extrapolation.csv  how far the predicted events lie beyond the records
  replays.csv     how often the vehicle had the event when it replayed records; replayed_events.csv: in which
  estimate.csv    probability, ci_low, ci_high, simulations under the law that was sampled, for each replicate
  runs.csv        every simulation: its encounter, its phase, and whether it crashed
  account.csv     the number of records that each filter has removed
  law.json        the law that was sampled, with its draws, for `campaign new` and `export`
  encounters.parquet  the encounter table to which the law was fitted
  vehicle.json    scenario and vehicle; the estimate of another vehicle needs another name of the study

With --criterion, the exit status is 0 if all criteria are met, shown or under the models, and 1 if one is not
met, not decided or not known, so that a release can depend on it.

examples: the answer judged by counted crashes; under another law and for a near miss; the ratio to an
earlier version, whose runs save simulations; another scenario, with its default vehicle and records
  accelerated-evaluation estimate --config my_vehicle.yaml --criterion '0.5 x counted'
  accelerated-evaluation estimate --config my_vehicle.yaml --law 'two kinds 0.95' --event min_ttc=1
  accelerated-evaluation estimate --config new.yaml --compare results/OLD/estimate \\
      --predecessor results/OLD/estimate/runs.csv
  accelerated-evaluation estimate --scenario left_turn --verbose"""


# Beginnings of lines that are shown in a colour on a terminal: the code of bold yellow.
DOUBTS = dict.fromkeys(("warning", "STOP", "NOT CONVERGED", "not converged"), "1;33")
SHARE = number_option("a number from 0 to 1", lambda value: 0 <= value <= 1)


def coloured(lines: Iterable[str], stream: TextIO) -> Iterator[str]:
    """Yield lines of text, the first one bold and doubts in a colour if the stream is a terminal.

    Users who set the variable NO_COLOR get no colours.
    """
    has_colours = stream.isatty() and not os.environ.get("NO_COLOR")
    for number, line in enumerate(lines):
        codes = [code for start, code in DOUBTS.items() if line.startswith(start)] or ["1"] * (number == 0)
        yield f"\x1b[{codes[0]}m{line}\x1b[0m" if has_colours and codes else line


def require_own(path: Path, vehicle: str) -> None:
    """Raise InputError if a file shows that a folder has the estimate of another vehicle or scenario."""
    if path.is_file() and (other := path.read_text(encoding="utf-8")) != vehicle:
        raise InputError(
            str(path.parent),
            seen=f"the estimate of another vehicle: {' '.join(other.split())}",
            expected=f"nothing, or an earlier estimate of {' '.join(vehicle.split())}",
            change="Give this vehicle a study of its own, with the key study. If the earlier estimate is not "
            "needed any more, remove its folder.",
        )


@COMMANDS.add("estimate")
class EstimateAlone:
    """Estimate the crash probability of a slow vehicle from few simulations."""

    help = "estimate the crash probability of a slow vehicle from 100 to 300 simulations"
    description = DESCRIPTION

    @staticmethod
    def add_arguments(command: argparse.ArgumentParser) -> None:
        """Add the configuration, the law, the comparisons and all other options to the parser."""
        command.add_argument(
            "--config",
            metavar="FILE",
            type=Path,
            action="append",
            default=[],
            help="keys that differ from config/config.yaml; a later file has precedence over an earlier one",
        )
        command.add_argument(
            "--law",
            metavar="LAW",
            default=ANSWER,
            help="law of the encounters, see --help (default: %(default)s)",
        )
        command.add_argument(
            "--replicates",
            metavar="N",
            type=positive_integer,
            default=1,
            help="independent repetitions, of 100 to 300 simulations each (default: %(default)s)",
        )
        command.add_argument(
            "--sampling-share",
            metavar="SHARE",
            type=SHARE,
            help="stop when the sampling increases the width of the 80 %% interval by at most this share; "
            "with 0, only the paper's stopping rule is used (default: 0.05)",
        )
        command.add_argument(
            "--predecessor",
            metavar="RUNS.csv",
            type=Path,
            help="runs.csv of an earlier estimate for a similar vehicle under the same law; it saves about "
            "two fifths of the simulations",
        )
        command.add_argument(
            "--compare",
            metavar="FOLDER",
            type=Path,
            action="append",
            default=[],
            help="results/STUDY/estimate of another vehicle under the same law; the ratio of the crash "
            "probabilities is computed for each draw of the law",
        )
        command.add_argument(
            "--scenario",
            metavar="NAME",
            help="name of the scenario (default: scenario.name of the configuration, by default cut_in)",
        )
        command.add_argument(
            "--event",
            metavar="EVENT",
            help="event for which the simulations are chosen: crash, impact_speed=MIN_M_S and, for cut-ins, "
            "min_range=MAX_M or min_ttc=MAX_S; simulations that are chosen for crashes give no estimate for "
            "near misses (default: scenario.event of the configuration, by default crash)",
        )
        command.add_argument(
            "--reference",
            metavar="NAME",
            action="append",
            default=[],
            help="vehicle that is fast to simulate, such as cc_human; the ratio to its crash probability is "
            "computed for each draw of the law from a crash map or many simulations, in some seconds",
        )
        command.add_argument(
            "--criterion",
            metavar="TEXT",
            action="append",
            default=[],
            dest="criteria",
            help="upper limit by which the answer is judged, such as '1e-7 per hour', '1e-9 per kilometre', "
            "'1e-6 per cut-in', '1e-8 MAIS3+ per hour' or '0.5 x counted'; may be given several times, in "
            "addition to the criteria of the configuration",
        )
        command.add_argument(
            "--verbose",
            action="store_true",
            help="also print further events, the sampling alone, bounds on what no run has shown, repeated "
            "runs, and stored outcomes",
        )
        command.add_argument(
            "--json", action="store_true", help="print the answer as JSON, for scripts, instead of words"
        )
        add_accept(command)

    @staticmethod
    def run(arguments: argparse.Namespace) -> int:
        """Estimate the probability of the event, write the tables, and print the answer."""
        if sys.stderr.isatty():  # the imports take seconds; the first step is then written over this line
            print("loading the libraries ...", end="\r", file=sys.stderr, flush=True)
        from accelerated_evaluation.answer.criterion import exit_status
        from accelerated_evaluation.answer.estimation import estimate_event
        from accelerated_evaluation.answer.settings import Request, Settings
        from accelerated_evaluation.study.configuration import load, resolved
        from accelerated_evaluation.vehicles.external.workers import printed_to

        given = {} if arguments.scenario is None else {"scenario": {"name": arguments.scenario}}
        if given and not arguments.config:
            given["study"] = arguments.scenario  # instead of the study in config/config.yaml
        config = load(arguments.config, given)
        config["data"]["accepted_warnings"] = [*config["data"]["accepted_warnings"], *arguments.accept]
        names = (
            "law",
            "replicates",
            "sampling_share",
            "predecessor",
            "event",
            "compare",
            "reference",
            "criteria",
        )
        given = {name: value for name in names if (value := getattr(arguments, name)) not in (None, [])}
        request = Request(**given)
        folder = Path("results", config["study"], "estimate")
        car = {key: config["vehicle"][key] for key in ("name", "parameters")}
        vehicle = json.dumps({"scenario": config["scenario"]["name"], **car}, indent=1)
        require_own(folder / VEHICLE, vehicle)
        # What a vehicle prints is not part of the answer.
        with open(os.dup(2), "w", buffering=1) as errors, printed_to(errors, 1):
            found = estimate_event(Settings.of(resolved(config), request), request)
        compared = found.write(folder)
        write_text(folder / VEHICLE, vehicle)
        if arguments.json:
            print(json.dumps(found.content(compared), indent=1))
        else:
            lines = [*found.lines(compared, verbose=arguments.verbose), f"tables: {folder}"]
            print(*coloured(lines, sys.stdout), sep="\n")
        return exit_status(found.tables["criteria"]["verdict"]) if "criteria" in found.tables else 0
