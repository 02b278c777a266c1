"""The subcommand ``campaign``, which estimates a probability from runs on a proving ground."""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.options import argument, option, options_in, switch
from accelerated_evaluation.commands import COMMANDS
from accelerated_evaluation.commands.shared import LAW, Command, OfLaw, given_law, refuse_options

if TYPE_CHECKING:  # this import takes seconds, and --help does not need it
    from accelerated_evaluation.track.campaign import Run

LEAST = 1e-6  # half-width and confidence have to be from LEAST to 1 - LEAST
LIMITS = (
    "limits of the proving ground for cut-ins; see docs/campaign.md",
    "By default the host speed is at most 50 m/s and the range at least 0.5 m.",
)
DETERMINISTIC = {"yes": True, "no": False, "unknown": None}
DESCRIPTION = """\
Estimate the probability of an event for a real vehicle, from as few runs on a proving ground as possible.

The complete state of a campaign is in one readable file, CAMPAIGN.json. Keep a copy of it.
docs/campaign.md shows a campaign from start to end.

example, after `make study`:
  accelerated-evaluation campaign new campaign.json \\
      --law results/spmd/laws/draws.json --encounters results/spmd/encounters.parquet
  accelerated-evaluation campaign ask campaign.json to_drive
  accelerated-evaluation campaign tell campaign.json to_drive/runs.csv
  accelerated-evaluation campaign status campaign.json"""

TABLE = """\
The table has one row for each run, and empty columns to be filled in on the track:
  crash           1 if the cars touched, else 0; empty while the run was not driven
  min_range       smallest range [m]; 0 or less after a crash                     (may be empty)
  min_ttc         smallest time to collision [s]; it helps to find the event      (may be empty)
  impact_speed    closing speed at the crash [m/s]; 0 without one                  (may be empty)
  note            a remark                                                         (may be empty)
In another scenario, its own outcomes can be measured; `accelerated-evaluation simulate --help` lists them."""

NEW = f"""\
Begin a campaign and write its file.

{LAW}

examples: a campaign within the limits of a proving ground; another scenario
  accelerated-evaluation campaign new campaign.json \\
      --law results/spmd/laws/draws.json --encounters results/spmd/encounters.parquet \\
      --half-width 0.2 --confidence 0.8 --host-speed-max 50
  accelerated-evaluation campaign new turns.json \\
      --scenario left_turn --law results/left_turn/laws/draws.json"""

ASK = f"""\
Write the runs to drive next into FOLDER: runs.csv, and for cut-ins run_0001.xosc and so on with their road.
The next batch is chosen when all outcomes of the last one have been reported. Before that, --again writes the
runs again whose outcomes are still missing; without it they are refused, so that nobody drives them twice.

Speeds and distances are rounded to steps that can be driven, such as 0.1 m/s and 0.1 m.

{TABLE}

example:
  accelerated-evaluation campaign ask campaign.json to_drive --batch-size 15"""

TELL = f"""\
Read outcomes from the table that `ask` wrote, or from any table with the columns run and crash. Rows without
a crash flag are ignored. If a table contradicts the runs or itself, none of its rows is accepted.

{TABLE}

example:
  accelerated-evaluation campaign tell campaign.json to_drive/runs.csv"""


STATUS = """\
Print the status of the campaign. If the campaign was begun under a law with draws, the answer under all draws
is reported as well. For a campaign that was begun under a single law, --under names a law with draws: the
runs are reweighted for each draw, and a warning is printed if they are not suitable for these laws.

example:
  accelerated-evaluation campaign status campaign.json --under results/STUDY/estimate/law.json"""


@dataclass(frozen=True)
class New(OfLaw):
    """The step ``campaign new``, which begins a campaign."""

    campaign: Path = argument("CAMPAIGN.json", "file of the campaign")
    event: str = option(
        "EVENT",
        "crash, or an outcome of the scenario with a limit, such as impact_speed=5 [m/s] or, for cut-ins, "
        "min_range=1 [m] or min_ttc=1.5 [s] (default: %(default)s)",
        "crash",
    )
    half_width: float = option(
        "SHARE", "required half-width of the interval, divided by the estimate (default: %(default)s)", 0.2
    )
    confidence: float = option("LEVEL", "confidence level of the interval (default: %(default)s)", 0.8)
    interval: str = option(
        None,
        "anytime: the confidence is for all checks together; usual: the confidence is for one check that was "
        "planned beforehand, with about a seventh fewer runs (default: %(default)s)",
        "anytime",
        choices=("anytime", "usual"),
    )
    batch_size: int = option("N", "number of runs in a batch (default: %(default)s)", 10)
    predecessor: Path | None = option(
        "OTHER.json", "campaign of a similar vehicle; it saves about two fifths of the runs"
    )
    deterministic: str = option(
        None,
        "whether the vehicle always has the same outcome in the same encounter; with unknown, some runs are "
        "repeated to find out (default: %(default)s)",
        "unknown",
        choices=DETERMINISTIC,
    )
    host_speed_max: float | None = option("X", "highest host speed at the cut-in [m/s]", group=LIMITS)
    closing_speed_max: float | None = option("X", "highest closing speed at the cut-in [m/s]", group=LIMITS)
    range_min: float | None = option("X", "smallest range at the cut-in [m]", group=LIMITS)
    no_limits: bool = switch("only the limits that are stated", group=LIMITS)

    def start(self) -> None:
        """Run this step."""
        from accelerated_evaluation.track.campaign import Campaign
        from accelerated_evaluation.track.campaign_file import read_campaign, stopping, write_campaign
        from accelerated_evaluation.track.limits import Limits, usual_where_open
        from accelerated_evaluation.vehicles.protocol import event_named

        if self.campaign.exists():
            change = "Name another file, or remove this one if its campaign is over."
            raise InputError(str(self.campaign), seen="a file", expected="no file yet", change=change)
        for name in ("half_width", "confidence"):
            if not LEAST <= (value := getattr(self, name)) <= 1 - LEAST:
                where, expected = f"--{name.replace('_', '-')}", f"a number from {LEAST:g} to 1 - {LEAST:g}"
                raise InputError(where, seen=f"{value:g}", expected=expected, change="Correct the value.")
        print(f"reading the law {self.law}, and checking the records behind it ...", flush=True)
        given = given_law(self)
        limits = options_in(self, Limits)
        if given.table is None:
            refuse_options(self, given.scenario.name, *(each.name for each in fields(Limits)))
        elif not self.no_limits:
            limits = usual_where_open(limits, given.law)
        print("checking the limits, and preparing the first batch ...", flush=True)
        campaign = Campaign.begin(
            given.sources["law"],
            given.sources.get("encounters"),
            event_named(self.event, given.scenario),
            stopping(self.confidence, self.half_width, anytime=self.interval == "anytime"),
            batch_size=self.batch_size,
            seed=self.seed,
            limits=limits,
            predecessor=None if self.predecessor is None else read_campaign(self.predecessor),
            deterministic=DETERMINISTIC[self.deterministic],
            scenario=given.scenario,
        )
        campaign.description = "; ".join([campaign.description, *given.verdict.lines()])
        write_campaign(self.campaign, campaign)
        for line in given.verdict.lines():
            print(line)
        if campaign.limits:
            print(f"the campaign drives only runs within: {campaign.limits.in_words}")
            print(f"{campaign.beyond:.2g} of all cut-ins of the law lie beyond these limits")
        print(f"began {self.campaign}; next: accelerated-evaluation campaign ask {self.campaign} FOLDER")


@dataclass(frozen=True)
class Ask(Command):
    """The step ``campaign ask``, which writes the next runs to drive."""

    campaign: Path = argument("CAMPAIGN.json", "file of the campaign")
    folder: Path = argument("FOLDER", "where to write the runs")
    batch_size: int | None = option("N", "number of runs of the next batch and of all later ones")
    again: bool = switch("write the runs again whose outcomes have not been reported yet")
    no_scenarios: bool = switch("write only the table")

    def start(self) -> None:
        """Run this step."""
        from accelerated_evaluation.track.campaign_file import law_of, read_campaign, write_campaign
        from accelerated_evaluation.track.results import write_table
        from accelerated_evaluation.track.scenarios import (
            NOT_WRITTEN,
            WRITERS,
            require_scenariogeneration,
            write_scenarios,
        )

        campaign = read_campaign(self.campaign)
        writes_files = campaign.scenario.name in WRITERS and not self.no_scenarios
        if writes_files:
            require_scenariogeneration()
        elif not self.no_scenarios:
            print(NOT_WRITTEN)
        if campaign.outstanding and not self.again:
            raise _already_requested(self.campaign, campaign.outstanding)
        if campaign.estimate().converged and not campaign.outstanding:
            print("the goal is met, so no further runs are needed; new runs are written nevertheless")
        runs = campaign.ask(law_of(campaign), self.batch_size)
        write_campaign(self.campaign, campaign)
        write_table(self.folder / "runs.csv", runs, campaign.scenario)
        if writes_files:
            write_scenarios(self.folder, [run.concrete for run in runs])
        print(f"{runs_in_words(runs)} to drive: {self.folder / 'runs.csv'}")


def _already_requested(path: Path, runs: Sequence["Run"]) -> InputError:
    """Return the error for a request while runs of an earlier request are still to be driven."""
    return InputError(
        str(path),
        seen=f"{runs_in_words(runs)} of an earlier request without outcomes",
        expected="their outcomes, because the next runs depend on them",
        change=f"Report them with `accelerated-evaluation campaign tell {path} RESULTS.csv`. "
        "If nobody else drives these runs, write them again with --again.",
    )


def runs_in_words(runs: Sequence["Run"]) -> str:
    """Return the number of runs and their numbers as text, such as ``2 runs (3, 5)``."""
    numbers = [run.number for run in runs]
    is_gapless = len(numbers) > 2 and numbers[-1] - numbers[0] == len(numbers) - 1
    shown = f"{numbers[0]} to {numbers[-1]}" if is_gapless else ", ".join(map(str, numbers))
    return f"{len(numbers)} run{'s' if len(numbers) > 1 else ''} ({shown})"


@dataclass(frozen=True)
class Tell(Command):
    """The step ``campaign tell``, which reads the outcomes of runs."""

    campaign: Path = argument("CAMPAIGN.json", "file of the campaign")
    results: Path = argument("RESULTS.csv", "table of outcomes")
    correct: bool = switch("replace earlier reports of runs of the open batch")

    def start(self) -> None:
        """Run this step."""
        from accelerated_evaluation.track.campaign_file import read_campaign, write_campaign
        from accelerated_evaluation.track.results import read_results

        campaign = read_campaign(self.campaign)
        results = read_results(self.results, campaign)
        news = campaign.tell(results, correct=self.correct)
        write_campaign(self.campaign, campaign)
        print(
            f"outcomes: {news} new or corrected, {len(results) - news} known before; "
            f"{len(campaign.outstanding)} runs outstanding"
        )


@dataclass(frozen=True)
class Status(Command):
    """The step ``campaign status``, which prints the estimate and whether to stop."""

    campaign: Path = argument("CAMPAIGN.json", "file of the campaign")
    under: Path | None = option(
        "LAW.json", "law with draws, fitted to the same encounters, such as results/STUDY/estimate/law.json"
    )

    def start(self) -> None:
        """Run this step."""
        from accelerated_evaluation.track.campaign_file import law_of, read_campaign
        from accelerated_evaluation.track.results import status_in_words, status_of
        from accelerated_evaluation.track.under_draws import read_draws, whole_in_words

        campaign = read_campaign(self.campaign)
        draws = None if self.under is None else read_draws(self.under, campaign)
        print(status_in_words(campaign, status_of(campaign)))
        try:
            law = law_of(campaign)
        except InputError as error:  # the status without the uncertainty of the records needs no law
            print(f"laws        the uncertainty of the records is not reported: {error}")
        else:
            print(*whole_in_words(campaign, law, draws), sep="\n")


@COMMANDS.add("campaign")
class CampaignCommand:
    """The subcommand with its four steps: new, ask, tell and status."""

    help = "estimate from runs on a proving ground: new, ask, tell, status"
    description = DESCRIPTION

    @staticmethod
    def add_arguments(command: argparse.ArgumentParser) -> None:
        """Add the four steps with their arguments to the parser."""
        steps = command.add_subparsers(title="steps", metavar="STEP", required=True)
        for name, summary, text, step in (
            ("new", "begin a campaign: the law, the event and the width of the interval", NEW, New),
            ("ask", "write the next runs to drive, as a table and as OpenSCENARIO XML files", ASK, Ask),
            ("tell", "read the outcomes of some of these runs, in any order", TELL, Tell),
            ("status", "print the estimate, the runs still needed, and whether to stop", STATUS, Status),
        ):
            own = steps.add_parser(name, help=summary, description=text)
            step.add_arguments(own)
            own.set_defaults(step=step.run)

    @staticmethod
    def run(arguments: argparse.Namespace) -> None:
        """Begin a campaign, request runs, receive outcomes or print the status, as the arguments say.

        Other processes with a campaign in the same folder wait until this step has ended.
        """
        from accelerated_evaluation.track.campaign_file import locked

        with locked(arguments.campaign):
            arguments.step(arguments)
