"""The subcommand ``campaign``, which estimates a probability from runs on a proving ground."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from accelerated_evaluation.base.errors import InputError
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

if TYPE_CHECKING:  # this import takes seconds, and --help does not need it
    from accelerated_evaluation.track.campaign import Run

LEAST = 1e-6  # half-width and confidence have to be from LEAST to 1 - LEAST
LIMITS = (  # of the proving ground, for cut-ins
    ("host_speed_max", "m/s", "highest host speed"),
    ("closing_speed_max", "m/s", "highest closing speed"),
    ("range_min", "m", "smallest range"),
)
DETERMINISTIC = {"yes": True, "no": False, "unknown": None}
DESCRIPTION = """\
Estimate the probability of an event for a real vehicle, from as few runs on a proving ground as possible.

  campaign new     begin a campaign: choose the law of cut-ins, the event and the width of the interval
  campaign ask     write the next runs to drive, as a table and as OpenSCENARIO XML files
  campaign tell    read the outcomes of some of these runs, in any order
  campaign status  print the estimate, its interval, the number of runs still needed, and whether to stop

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


@COMMANDS.add("campaign")
class CampaignCommand:
    """The subcommand with its four steps: new, ask, tell and status."""

    help = "estimate from runs on a proving ground: new, ask, tell, status"
    description = DESCRIPTION

    @staticmethod
    def add_arguments(command: argparse.ArgumentParser) -> None:
        """Add the four steps with their arguments to the parser."""
        steps = command.add_subparsers(title="steps", metavar="STEP", required=True)
        for name, summary, text, add, step in (
            ("new", "begin a campaign", NEW, _add_new, _new),
            ("ask", "write the next runs to drive", ASK, _add_ask, _ask),
            ("tell", "read the outcomes of runs", TELL, _add_tell, _tell),
            ("status", "print the estimate and the runs still needed", STATUS, _add_status, _status),
        ):
            own = steps.add_parser(
                name, help=summary, description=text, formatter_class=argparse.RawDescriptionHelpFormatter
            )
            own.add_argument("campaign", metavar="CAMPAIGN.json", type=Path, help="file of the campaign")
            add(own)
            own.set_defaults(step=step)

    @staticmethod
    def run(arguments: argparse.Namespace) -> None:
        """Begin a campaign, request runs, receive outcomes or print the status, as the arguments say.

        Other processes with a campaign in the same folder wait until this step has ended.
        """
        from accelerated_evaluation.track.campaign_file import locked

        with locked(arguments.campaign):
            arguments.step(arguments)


def _add_new(command: argparse.ArgumentParser) -> None:
    add_law(command)
    command.add_argument(
        "--event",
        default="crash",
        metavar="EVENT",
        help="crash, or an outcome of the scenario with a limit, such as impact_speed=5 [m/s] or, for "
        "cut-ins, min_range=1 [m] or min_ttc=1.5 [s] (default: crash)",
    )
    command.add_argument(
        "--half-width",
        type=float,
        default=0.2,
        metavar="SHARE",
        help="required half-width of the interval, divided by the estimate (default: 0.2)",
    )
    command.add_argument(
        "--confidence",
        type=float,
        default=0.8,
        metavar="LEVEL",
        help="confidence level of the interval (default: 0.8)",
    )
    command.add_argument(
        "--interval",
        choices=("anytime", "usual"),
        default="anytime",
        help="anytime: the confidence is for all checks together; usual: the confidence is for one check "
        "that was planned beforehand, with about a seventh fewer runs (default: %(default)s)",
    )
    command.add_argument(
        "--batch-size", type=int, default=10, metavar="N", help="number of runs in a batch (default: 10)"
    )
    command.add_argument(
        "--predecessor",
        metavar="OTHER.json",
        type=Path,
        help="campaign of a similar vehicle; it saves about two fifths of the runs",
    )
    command.add_argument(
        "--deterministic",
        choices=DETERMINISTIC,
        default="unknown",
        help="whether the vehicle always has the same outcome in the same encounter; with unknown, some runs "
        "are repeated to find out (default: %(default)s)",
    )
    add_seed(command)
    add_accept(command)
    limits = command.add_argument_group(
        "limits of the proving ground for cut-ins; see docs/campaign.md",
        "By default the host speed is at most 50 m/s and the range at least 0.5 m.",
    )
    for name, unit, what in LIMITS:
        limits.add_argument(
            f"--{name.replace('_', '-')}", type=float, metavar="X", help=f"{what} at the cut-in [{unit}]"
        )
    limits.add_argument("--no-limits", action="store_true", help="only the limits that are stated")


def _add_ask(command: argparse.ArgumentParser) -> None:
    command.add_argument("folder", metavar="FOLDER", type=Path, help="where to write the runs")
    command.add_argument(
        "--batch-size", type=int, metavar="N", help="number of runs of the next batch and of all later ones"
    )
    command.add_argument(
        "--again", action="store_true", help="write the runs again whose outcomes have not been reported yet"
    )
    command.add_argument("--no-scenarios", action="store_true", help="write only the table")


def _add_tell(command: argparse.ArgumentParser) -> None:
    command.add_argument("results", metavar="RESULTS.csv", type=Path, help="table of outcomes")
    command.add_argument(
        "--correct", action="store_true", help="replace earlier reports of runs of the open batch"
    )


def _add_status(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--under",
        metavar="LAW.json",
        type=Path,
        help="law with draws, fitted to the same encounters, such as results/STUDY/estimate/law.json",
    )


def _new(arguments: argparse.Namespace) -> None:
    from accelerated_evaluation.track.campaign import Campaign
    from accelerated_evaluation.track.campaign_file import read_campaign, stopping, write_campaign
    from accelerated_evaluation.track.limits import Limits, usual_where_open
    from accelerated_evaluation.vehicles.protocol import event_named

    if arguments.campaign.exists():
        change = "Name another file, or remove this one if its campaign is over."
        raise InputError(str(arguments.campaign), seen="a file", expected="no file yet", change=change)
    for name in ("half_width", "confidence"):
        if not LEAST <= (value := getattr(arguments, name)) <= 1 - LEAST:
            where, expected = f"--{name.replace('_', '-')}", f"a number from {LEAST:g} to 1 - {LEAST:g}"
            raise InputError(where, seen=f"{value:g}", expected=expected, change="Correct the value.")
    require_seed(arguments.seed)
    print(f"reading the law {arguments.law}, and checking the records behind it ...", flush=True)
    given = given_law(arguments)
    limits = Limits(*(getattr(arguments, name) for name, *_ in LIMITS))
    if given.table is None:
        refuse_options(arguments, given.scenario.name, *(name for name, *_ in LIMITS))
    elif not arguments.no_limits:
        limits = usual_where_open(limits, given.law)
    print("checking the limits, and preparing the first batch ...", flush=True)
    campaign = Campaign.begin(
        given.sources["law"],
        given.sources.get("encounters"),
        event_named(arguments.event, given.scenario),
        stopping(arguments.confidence, arguments.half_width, anytime=arguments.interval == "anytime"),
        batch_size=arguments.batch_size,
        seed=arguments.seed,
        limits=limits,
        predecessor=None if arguments.predecessor is None else read_campaign(arguments.predecessor),
        deterministic=DETERMINISTIC[arguments.deterministic],
        scenario=given.scenario,
    )
    campaign.description = "; ".join([campaign.description, *given.verdict.lines()])
    write_campaign(arguments.campaign, campaign)
    for line in given.verdict.lines():
        print(line)
    if campaign.limits:
        print(f"the campaign drives only runs within: {campaign.limits.in_words}")
        print(f"{campaign.beyond:.2g} of all cut-ins of the law lie beyond these limits")
    print(
        f"began {arguments.campaign}; next: accelerated-evaluation campaign ask {arguments.campaign} FOLDER"
    )


def _ask(arguments: argparse.Namespace) -> None:
    from accelerated_evaluation.track.campaign_file import law_of, read_campaign, write_campaign
    from accelerated_evaluation.track.results import write_table
    from accelerated_evaluation.track.scenarios import (
        NOT_WRITTEN,
        require_scenariogeneration,
        write_scenarios,
    )

    campaign = read_campaign(arguments.campaign)
    writes_files = campaign.scenario.has_scenario_files and not arguments.no_scenarios
    if writes_files:
        require_scenariogeneration()
    elif not arguments.no_scenarios:
        print(NOT_WRITTEN)
    if campaign.outstanding and not arguments.again:
        raise _already_requested(arguments.campaign, campaign.outstanding)
    if campaign.estimate().converged and not campaign.outstanding:
        print("the goal is met, so no further runs are needed; new runs are written nevertheless")
    runs = campaign.ask(law_of(campaign), arguments.batch_size)
    write_campaign(arguments.campaign, campaign)
    write_table(arguments.folder / "runs.csv", runs, campaign.scenario)
    if writes_files:
        write_scenarios(arguments.folder, [run.concrete for run in runs])
    print(f"{runs_in_words(runs)} to drive: {arguments.folder / 'runs.csv'}")


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


def _tell(arguments: argparse.Namespace) -> None:
    from accelerated_evaluation.track.campaign_file import read_campaign, write_campaign
    from accelerated_evaluation.track.results import read_results

    campaign = read_campaign(arguments.campaign)
    results = read_results(arguments.results, campaign)
    news = campaign.tell(results, correct=arguments.correct)
    write_campaign(arguments.campaign, campaign)
    print(
        f"outcomes: {news} new or corrected, {len(results) - news} known before; "
        f"{len(campaign.outstanding)} runs outstanding"
    )


def _status(arguments: argparse.Namespace) -> None:
    from accelerated_evaluation.track.campaign_file import law_of, read_campaign
    from accelerated_evaluation.track.results import status_in_words, status_of
    from accelerated_evaluation.track.under_draws import read_draws, whole_in_words

    campaign = read_campaign(arguments.campaign)
    draws = None if arguments.under is None else read_draws(arguments.under, campaign)
    print(status_in_words(campaign, status_of(campaign)))
    try:
        law = law_of(campaign)
    except InputError as error:  # the status without the uncertainty of the records needs no law
        print(f"laws        the uncertainty of the records is not reported: {error}")
    else:
        print(*whole_in_words(campaign, law, draws), sep="\n")
