"""The subcommand ``estimate``, which estimates a crash probability from few simulations."""

import json
import os
import re
import shutil
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TextIO

from accelerated_evaluation.answer.ways.request import Request
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import write_text
from accelerated_evaluation.base.options import option, options_in, switch, wrapped
from accelerated_evaluation.commands import COMMANDS
from accelerated_evaluation.commands.shared import Accepting

VEHICLE = "vehicle.json"
COMPARED_KEYS = ("name", "parameters", "files", "deterministic")  # of a vehicle to compare with
DESCRIPTION = """\
Estimate the crash probability of a slow vehicle from few simulations: a program in any language, an FMU, or
a Python class (docs/your_vehicle.md). Usually 100 to 300 simulations and 100 to 140 replays of records are
enough; a vehicle that is not stated to be deterministic takes 650 more.

The configuration is that of a study. It names the records, the vehicle and the scenario: a cut-in by
default, or left_turn, pedestrian, or your own (docs/your_scenario.md). Outcomes are stored in
results/vehicles/, so that no encounter is simulated twice if a run is continued or repeated.

laws of the encounters (--law):
  answer          all laws that the records support, by their weights (default). The intervals contain the
                  uncertainty in the data, in the choice of law and in the sampling
  NAME            for cut-ins, one law of the family, such as 'two kinds 0.95', with the uncertainty in its
                  parameters; otherwise a kind of joint law, such as gaussian_copula
  FILE.json       law.json of an earlier estimate, or a law of a finished study, whose configuration is needed
  paper           for cut-ins, the paper's law; also two_pieces, three_pieces and single
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
  compared.csv    ratio to other vehicles, its 80 % interval, and the probability to be safer (--against,
                  --reference), with the simulations of the other vehicle
  in_service.csv  the rate of crashes before and after those of the fleet (in_service of the configuration)
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

examples:
  accelerated-evaluation estimate --config my_vehicle.yaml --criterion '0.5 x counted'
  accelerated-evaluation estimate --config my_vehicle.yaml --law 'two kinds 0.95' --event min_ttc=1
  accelerated-evaluation estimate --config new.yaml --against old.yaml --criterion '1 x old'
  accelerated-evaluation estimate --scenario left_turn --verbose"""


# Beginnings of lines that are shown in a colour on a terminal: the code of bold yellow.
DOUBTS = dict.fromkeys(("warning", "STOP", "NOT CONVERGED", "not converged"), "1;33")


def coloured(lines: Iterable[str], stream: TextIO) -> Iterator[str]:
    """Yield lines of text; if the stream is a terminal, the first one bold and doubts in a colour.

    Lines that are wider than a terminal are broken between words and continue in the column of their value.
    Users who set the variable NO_COLOR get no colours.
    """
    has_colours = stream.isatty() and not os.environ.get("NO_COLOR")
    for number, line in enumerate(lines):
        codes = [code for start, code in DOUBTS.items() if line.startswith(start)] or ["1"] * (number == 0)
        if stream.isatty():
            line = wrapped(line, shutil.get_terminal_size().columns)
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
@dataclass(frozen=True)
class EstimateAlone(Accepting, Request, description=DESCRIPTION):
    """Estimate the crash probability of a slow vehicle from 100 to 300 simulations."""

    config: Sequence[Path] = option(
        "FILE",
        "keys that differ from config/config.yaml; a later file has precedence over an earlier one",
        (),
    )
    scenario: str | None = option(
        "NAME", "name of the scenario (default: scenario.name of the configuration, by default cut_in)"
    )
    verbose: bool = switch(
        "also print further events, the sampling alone, bounds on what no run has shown, repeated runs, and "
        "stored outcomes"
    )
    json: bool = switch("print the answer as JSON, for scripts, instead of words")

    def start(self) -> int:
        """Estimate the probability of the event, write the tables, and print the answer."""
        if sys.stderr.isatty():  # the imports take seconds; the first step is then written over this line
            print("loading the libraries ...", end="\r", file=sys.stderr, flush=True)
        from accelerated_evaluation.answer.consequences.criterion import exit_status
        from accelerated_evaluation.answer.estimation import estimate_event
        from accelerated_evaluation.answer.settings import Settings
        from accelerated_evaluation.study.configuration import load, resolved
        from accelerated_evaluation.vehicles.external.workers import printed_to

        given = {} if self.scenario is None else {"scenario": {"name": self.scenario}}
        if given and not self.config:
            given["study"] = self.scenario  # instead of the study in config/config.yaml
        config = load(self.config, given)
        config["data"]["accepted_warnings"] = [*config["data"]["accepted_warnings"], *self.accept]
        request = options_in(self, Request)
        if request.against is not None and request.against.endswith((".yaml", ".yml")):
            label = re.sub(r"\W", "_", Path(request.against).stem, flags=re.ASCII)
            other = load([request.against])["vehicle"]
            config["compared_vehicles"][label] = {key: other[key] for key in COMPARED_KEYS}
            request = replace(request, against=label)
        folder = Path("results", config["study"], "estimate")
        car = {key: config["vehicle"][key] for key in ("name", "parameters")}
        vehicle = json.dumps({"scenario": config["scenario"]["name"], **car}, indent=1)
        require_own(folder / VEHICLE, vehicle)
        # What a vehicle prints is not part of the answer.
        with open(os.dup(2), "w", buffering=1) as errors, printed_to(errors, 1):
            found = estimate_event(Settings.of(resolved(config), request), request)
        compared = found.write(folder)
        write_text(folder / VEHICLE, vehicle)
        if self.json:
            print(json.dumps(found.content(compared), indent=1))
        else:
            lines = [*found.lines(compared, verbose=self.verbose), f"tables: {folder}"]
            print(*coloured(lines, sys.stdout), sep="\n")
        return exit_status(found.tables["criteria"]["verdict"]) if "criteria" in found.tables else 0
