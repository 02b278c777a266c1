"""The subcommand ``total``, which sums the crash rates of several scenarios."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.numerals import number_in
from accelerated_evaluation.base.options import argument, csv_file, option
from accelerated_evaluation.commands import COMMANDS
from accelerated_evaluation.commands.shared import Command

if TYPE_CHECKING:  # these imports take seconds, and --help does not need them
    from accelerated_evaluation.answer.consequences.criterion import Basis
    from accelerated_evaluation.base.arrays import Array

PER = ("kilometre", "hour")
A_STUDY = "name of a study, and its number of encounters per kilometre or hour if it does not know it"
DESCRIPTION = """\
Sum the crash rates of finished studies of different scenarios into one rate with one interval, such as those
of cut-ins, left turns and pedestrians for the same vehicle.

The rate of a scenario is the number of its encounters per kilometre or hour times the crash probability of an
encounter. A study whose records have an exposure knows the first number, with its uncertainty. For the others
it has to be given, as in left_turn=0.02, and is taken as known. The studies are taken as independent. A study
that knows the rate of all cut-ins contributes this rate; the column encounters names what the others contain.

If a criterion is given, the exit status is 0 if it is met, and 1 if it is not met or not decided.

Run it in the folder in which the studies ran, for example
  accelerated-evaluation total spmd left_turn=0.02 pedestrian=0.005 --per kilometre --criterion 1e-6"""


@COMMANDS.add("total")
@dataclass(frozen=True)
class Total(Command, description=DESCRIPTION):
    """Sum the crash rates of studies of several scenarios into one rate with one interval."""

    studies: Sequence[str] = argument("STUDY[=RATE]", A_STUDY, nargs="+")
    per: str = option(None, "unit (default: %(default)s)", "kilometre", choices=PER)
    criterion: float | None = option("LIMIT", "upper limit by which the sum is judged")
    target: Path = option("OUT.csv", "table to write", Path("results/total.csv"), type=csv_file)

    def start(self) -> int:
        """Print the rates of all studies and their sum, and write the table."""
        from accelerated_evaluation.answer.consequences.criterion import criterion_in_words, exit_status
        from accelerated_evaluation.answer.consequences.total import judged_total, total_table
        from accelerated_evaluation.base.files import write_csv

        rates, bases = {}, {}
        for text in self.studies:
            name = text.partition("=")[0]
            if name in rates:
                raise InputError(text, seen="named twice", expected="each study once", change="Remove one.")
            rates[name], bases[name] = study_rates(text, self.per)
        table = total_table(rates, self.per, bases)
        write_csv(self.target, table)
        shown = table[["scenario", "share", "median", "low80", "high80", "upper95", "beyond", "encounters"]]
        print(f"crashes per {self.per}")
        print(shown.to_string(index=False, float_format="{:.3g}".format))
        verdicts = []
        if self.criterion is not None:
            judged = judged_total(rates, self.per, bases, self.criterion)
            verdicts.append(judged.verdict)
            print(criterion_in_words(judged.row()))
        print(self.target)
        return exit_status(verdicts)


def study_rates(text: str, per: str) -> "tuple[Array, Basis]":
    """Return equally likely values of the crash rate of a study, and what it rests on.

    ``text`` is STUDY or STUDY=RATE, with the number of encounters per kilometre or hour (``per``). InputError
    is raised if the study has no answer, or if this number is neither given nor known.
    """
    from accelerated_evaluation.answer.consequences.all_cut_ins import every_encounter
    from accelerated_evaluation.answer.consequences.criterion import CONFIDENCE, Basis
    from accelerated_evaluation.answer.consequences.rates import UNITS, Rate
    from accelerated_evaluation.answer.consequences.total import rate_values
    from accelerated_evaluation.answer.study_tables import UNDER_TEST
    from accelerated_evaluation.answer.ways.comparison import posterior_of
    from accelerated_evaluation.base.files import read_json
    from accelerated_evaluation.base.randomness import child_generator
    from accelerated_evaluation.publishing.study import Study

    name, _, given = text.partition("=")
    study = Study.named(name)
    posterior = posterior_of(study.answer_draws)
    size = study.extrapolation.loc[0, "records"] if len(study.extrapolation) else 0
    key = next(name for name, unit in UNITS.items() if unit == per)
    length = read_json(study.path("exposure.json"))[key]
    if posterior is None or (not given and (length is None or not size)):
        raise InputError(
            text,
            seen="no crash probability" if posterior is None else f"records of unknown {key}",
            expected=f"a study with an answer, and its number of encounters per {per}",
            change=f"Write {name}=RATE with this number." if posterior is not None else "Leave it out.",
        )
    rate = _rate(text, given) if given else Rate(int(size), float(length))
    basis = Basis.of(study.extrapolation, study.scenario.scope)
    every = every_encounter(study.all_cut_ins, UNDER_TEST) if study.has("all_cut_ins") else None
    if every is not None:
        posterior, basis = every, basis.of_every(study.scenario.noun)
    values = rate_values(posterior, rate, child_generator(study.config["seed"], "total", name))
    ends = [rate] if isinstance(rate, float) else rate.law.ppf([1 - CONFIDENCE, CONFIDENCE])
    return values, basis.times(*ends)


def _rate(text: str, given: str) -> float:
    try:
        rate = number_in(given)
    except ValueError:
        rate = -1.0
    if not 0 < rate < float("inf"):
        raise InputError(
            text, seen=repr(given), expected="a positive number after =", change="Correct the number."
        )
    return rate
