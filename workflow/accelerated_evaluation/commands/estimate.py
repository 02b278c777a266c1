"""The subcommand ``estimate``, which estimates a crash probability from few simulations."""

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.commands import COMMANDS, add_accept

if TYPE_CHECKING:  # these imports take seconds, and --help does not need them
    import pandas as pd

    from accelerated_evaluation.answer.estimation import Alone

CUT_IN, ANSWER, SURROGATE = "cut_in", "answer", "surrogate"
FOR_DRAWS = ("sampling_share", "compare", "reference")  # options that need a law with draws
DESCRIPTION = """\
Estimate the crash probability of a vehicle when a human driver cuts in, from about 150 simulations. Crash
maps and crude Monte Carlo, which need millions, are not used. The command is for slow vehicles: a program in
any language, an FMU, or a Python class; docs/your_vehicle.md shows all three. With --scenario, or
scenario.name in the configuration, it estimates the probability in a scenario other than the cut-in:
left_turn, pedestrian, or your own (docs/your_scenario.md).

The configuration is that of a study and names the records and the vehicle. Outcomes are stored in
results/vehicles/, so that no encounter is simulated twice if a run is continued or repeated.

laws of cut-ins (--law):
  answer          all smooth laws with dependence, by their weights (default). The simulations are made under
                  the mean of draws from the posterior of law and parameters, and are reweighted for every
                  draw. The intervals contain the uncertainty in the data, in the choice of law and in the
                  sampling, like those of a complete study
  NAME            one law of the family, such as 'two kinds 0.95', with the uncertainty in its parameters; an
                  unknown name gives an error that lists all names
  FILE.json       law.json of an earlier estimate, with its draws; or a law of a finished study,
                  results/STUDY/models/*.json. The configuration has to be that of this study
  paper           the paper's law, with the pieces that the configuration names; also two_pieces,
                  three_pieces and single
Under the paper's law, and any law file without draws, the interval is that of the sampling alone.

The records are checked first. If a check says stop, nothing is estimated unless --accept names this check.
The simulations end when the sampling increases the width of the 80 % interval by less than 5 %
(--sampling-share), or when the interval of the sampling alone is as narrow as in the paper
(importance_sampling.beta).

For another scenario, --law is answer (all joint laws by their weights, with all uncertainty), a kind of
joint law (truncated_normals, gaussian_copula, kernel, independent_variables), or the file of a joint law,
such as results/left_turn/scenario/law.json. Under a single law, the interval is that of the sampling alone.
The files are then laws.csv, answer.csv, budget.csv, draws.csv and law.json for answer, and estimate.csv,
runs.csv and law.json for one law.

files written to results/STUDY/estimate/:
  answer.csv      probability (mean), median, intervals and rate per kilometre, for each replicate and event
  budget.csv      sources of the uncertainty: data, choice of law, sampling
  draws.csv       the crash probability under every draw of the law, with its relative sampling error
  exposure.csv    crashes per kilometre and hour, if the exposure of the records is known
  compared.csv    ratio to other vehicles, its 80 % interval, and the probability to be safer (--compare,
                  --reference)
  crashes.csv     the simulations that crashed, with their shares of the crash probability
  extrapolation.csv  how far the predicted events lie beyond the records
  estimate.csv    probability, ci_low, ci_high, simulations under the mean law, for each replicate
  runs.csv        every simulation: its cut-in, its phase, and whether it crashed
  account.csv     the number of records that each filter has removed
  law.json        the law of cut-ins that was sampled, with its draws, for `campaign new` and `export`
  encounters.parquet  the encounter table to which the law was fitted"""


def _count(text: str) -> int:
    if (count := int(text)) < 1:
        raise ValueError
    return count


_count.__name__ = "positive integer"  # argparse prints this name in its error message


def _share(text: str) -> float:
    if not 0 <= (share := float(text)) <= 1:
        raise ValueError
    return share


_share.__name__ = "number from 0 to 1"


@COMMANDS.add("estimate")
class EstimateAlone:
    """Estimate the crash probability of a slow vehicle from few simulations."""

    help = "estimate the crash probability of a slow vehicle from about 150 simulations"
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
            "--law", metavar="LAW", default=ANSWER, help="law of cut-ins, see above (default: %(default)s)"
        )
        command.add_argument(
            "--replicates",
            metavar="N",
            type=_count,
            default=1,
            help="independent repetitions, of about 150 simulations each (default: %(default)s)",
        )
        command.add_argument(
            "--sampling-share",
            metavar="SHARE",
            type=_share,
            help="stop when the sampling increases the width of the 80 %% interval by at most this share; "
            "with 0, only the paper's stopping rule is used (default: 0.05; for cut-ins, under a law with "
            "draws)",
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
            "--method",
            metavar="NAME",
            help="in a scenario other than the cut-in, under a single law: surrogate, normal_mixture or "
            f"crude (default: {SURROGATE})",
        )
        command.add_argument(
            "--event",
            metavar="EVENT",
            help="event for which the simulations are chosen: crash, impact_speed=MIN_M_S and, for cut-ins, "
            "min_range=MAX_M or min_ttc=MAX_S; simulations that are chosen for crashes give no estimate for "
            "near misses (default: crash; in another scenario, scenario.event of the configuration)",
        )
        command.add_argument(
            "--reference",
            metavar="NAME",
            action="append",
            default=[],
            help="vehicle that is fast to simulate, such as cc_human; the ratio to its crash probability is "
            "computed for each draw of the law from a crash map, which takes some seconds",
        )
        add_accept(command)

    @staticmethod
    def run(arguments: argparse.Namespace) -> None:
        """Estimate the probability, write the tables, and print a summary."""
        from accelerated_evaluation.answer.averaged import SHARE
        from accelerated_evaluation.answer.compared import require_estimate
        from accelerated_evaluation.answer.estimation import estimate_alone
        from accelerated_evaluation.answer.references import reference_section
        from accelerated_evaluation.base.files import write_csv
        from accelerated_evaluation.laws.files import write_law
        from accelerated_evaluation.records.encounter_table import write_encounters
        from accelerated_evaluation.records.sources import describe
        from accelerated_evaluation.study.configuration import load, resolved
        from accelerated_evaluation.vehicles.events import CRASH, event_named

        given = {} if arguments.scenario is None else {"scenario": {"name": arguments.scenario}}
        if given and not arguments.config:
            given["study"] = arguments.scenario  # instead of the study in config/config.yaml
        config = load(arguments.config, given)
        config["data"]["accepted_warnings"] = [*config["data"]["accepted_warnings"], *arguments.accept]
        if config["scenario"]["name"] != CUT_IN:
            _estimate_scenario(arguments, config)
            return
        config = resolved(config)
        if arguments.method is not None:
            _refuse("method", f"the scenario {CUT_IN}", "another scenario")
        event = CRASH if arguments.event is None else event_named(arguments.event)
        if event != CRASH and arguments.reference:
            _refuse("reference", f"the event {arguments.event}", CRASH.quantity)
        for name in arguments.reference:  # before the simulations, which would otherwise be in vain
            reference_section(name, config)
        for other in arguments.compare:
            require_estimate(other)
        found = estimate_alone(
            config,
            arguments.replicates,
            arguments.law,
            arguments.predecessor,
            SHARE if arguments.sampling_share is None else arguments.sampling_share,
            event,
            [_written(option) for option in FOR_DRAWS if getattr(arguments, option) not in (None, [])],
        )
        folder = Path("results", config["study"], "estimate")
        for name, table in found.tables.items():
            write_csv(folder / f"{name}.csv", table)
        write_law(folder / "law.json", found.law, found.encounters)
        write_encounters(folder / "encounters.parquet", found.encounters, describe(config["data"]))
        compared = _compared(found, folder, arguments.compare, arguments.reference, config)
        if len(compared):
            write_csv(folder / "compared.csv", compared)
            print(compared.to_string(index=False, float_format="{:.3g}".format))
        print(_in_words(found, 1 - config["importance_sampling"]["alpha"]), f"tables: {folder}", sep="\n")


def _estimate_scenario(arguments: argparse.Namespace, config: dict[str, Any]) -> None:
    """Estimate the probability in a scenario other than the cut-in, write tables, and print a summary."""
    from accelerated_evaluation.answer.scenario_estimate import estimate_scenario
    from accelerated_evaluation.base.files import write_csv
    from accelerated_evaluation.laws.joint.files import write_joint_law
    from accelerated_evaluation.scenarios import SCENARIOS
    from accelerated_evaluation.vehicles.events import event_named

    name = config["scenario"]["name"]
    for option in ("compare", "reference", "sampling_share"):
        if getattr(arguments, option) not in (None, []):
            _refuse(option, f"the scenario {name}", CUT_IN)
    if arguments.law == ANSWER:
        for option, default in (("method", None), ("replicates", 1)):
            if getattr(arguments, option) != default:
                _refuse(option, f"the law {ANSWER}", f"one law of the scenario {name}, named by --law")
    method = SURROGATE if arguments.method is None else arguments.method
    if arguments.event is not None:
        event_named(arguments.event, SCENARIOS[name])
        config = {**config, "scenario": {**config["scenario"], "event": arguments.event}}
    found = estimate_scenario(config, arguments.law, arguments.replicates, method, arguments.predecessor)
    folder = Path("results", config["study"], "estimate")
    for table, rows in found.tables.items():
        write_csv(folder / f"{table}.csv", rows)
    write_joint_law(folder / "law.json", found.law, f"records of the scenario {name}", found.verdict)
    print(*found.lines(), f"tables: {folder}", sep="\n")


def _written(option: str) -> str:
    return f"--{option.replace('_', '-')}"


def _refuse(option: str, seen: str, expected: str) -> None:
    """Raise the error for an option that has no effect with the other options."""
    raise InputError(_written(option), seen=seen, expected=expected, change="Leave the option out.")


def _compared(
    found: "Alone", folder: Path, others: list[Path], references: list[str], config: dict[str, Any]
) -> "pd.DataFrame":
    """Compare an estimate with other estimates and with reference vehicles under each draw of the law."""
    import pandas as pd

    from accelerated_evaluation.answer.averaged import posterior_of
    from accelerated_evaluation.answer.compared import compare_estimates
    from accelerated_evaluation.answer.references import compared_with, map_reference
    from accelerated_evaluation.laws.smooth.family import DistinctRecords
    from accelerated_evaluation.laws.smooth.support import Support

    table = compare_estimates(folder, others) if others else pd.DataFrame()
    if not references:
        return table
    records, draws = DistinctRecords.of(found.encounters, Support.configured(config)), found.law.draws
    mapped = {name: map_reference(name, config, records, draws) for name in references}
    known = found.tables["draws"]
    own = posterior_of(known[known["replicate"] == 0]) if len(known) else None
    return pd.concat([table, compared_with(own, mapped)], ignore_index=True)


def _in_words(found: "Alone", level: float) -> str:
    """Return the estimates, their numbers of simulations, and bounds on missed events as lines of text."""
    from accelerated_evaluation.answer.study import event_name
    from accelerated_evaluation.methods.surrogate_words import chance_in_words, unseen_in_words

    doubts = [f"warning: {doubt}" for doubt in found.evidence.doubts]
    lines = [*found.verdict.lines(), *doubts, *_answers(found), f"law of cut-ins: {found.name}"]
    lines.append(found.evidence.in_words)
    what, ended = "crash probability", "crashes"
    if found.event.quantity != "crash":
        named = event_name(found.event)
        what, ended = f"probability of {named}", f"with {named}"
    for row in found.tables["estimate"].to_dict("records"):
        verdict = "converged" if row["converged"] else "not converged"
        probability = "not known yet" if math.isnan(row["probability"]) else f"{row['probability']:.3g}"
        lines.append(
            f"{what} of a cut-in under this law: {probability}, {level:.0%} interval of the "
            f"sampling alone {row['ci_low']:.2g} to {row['ci_high']:.2g}; {verdict} after "
            f"{row['learning'] + row['estimating']:,} encounters, {row['events']:,} of them {ended}"
        )
        lines += [unseen_in_words(row["probability"], row), chance_in_words(row)]
    if (vehicle := found.vehicle) is not None:
        lines.append(
            f"simulated: {vehicle.simulated:,}; taken from the store: {vehicle.found:,}; "
            f"kept: {len(vehicle.store):,} in {vehicle.store.path}"
        )
    return "\n".join(lines)


def _answers(found: "Alone") -> list[str]:
    """Return the answer of every replicate as lines of text; empty under a single law."""
    from accelerated_evaluation.answer.averaged import answer_in_words, budget_in_words
    from accelerated_evaluation.answer.extrapolation import in_words

    if "answer" not in found.tables:
        return []
    lines = []
    estimates = found.tables["estimate"].set_index("replicate")
    for replicate, rows in found.tables["answer"].groupby("replicate"):
        if not estimates.loc[replicate, "converged"]:
            lines.append(_not_settled(estimates.loc[replicate].get("unseen_lapses", math.nan)))
        for row in rows.to_dict("records"):
            lines += answer_in_words(row)
        budget = found.tables["budget"]
        lines += budget_in_words(budget[budget["replicate"] == replicate]) if len(budget) else []
        extrapolation = found.tables["extrapolation"]
        of_replicate = extrapolation[extrapolation["replicate"] == replicate]
        lines += [in_words(of_replicate)] if len(of_replicate) else []
    return lines


def _not_settled(unseen_lapses: float) -> str:
    """Return the line before an answer that has not converged, with the reason."""
    reason = "more simulations may change it, or may find further parts of the event"
    if not math.isnan(unseen_lapses):
        reason = (
            f"lapses that no run has shown can add up to {unseen_lapses:.1g}, which the upper ends contain"
        )
    return f"NOT CONVERGED: {reason}; see the last lines"
