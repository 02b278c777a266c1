"""The subcommand ``monitor``, which compares the crashes of a fleet in service with the prediction."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.options import argument, csv_file, option
from accelerated_evaluation.commands import COMMANDS
from accelerated_evaluation.commands.shared import Command
from accelerated_evaluation.commands.total import A_STUDY, PER, study_rates

DESCRIPTION = """\
Compare the crashes of a fleet in service with the prediction of a finished study.

FLEET.csv has a row for each period, such as a month, in the order of time. The column kilometres (or hours,
with --per hour) has what was driven in the period, and crashes the number of crashes of the scenario, in the
role of the study, that were counted in it. The study predicts all crashes of the scenario, so state with
--reported which share of them is counted.

Two things are printed. First, the predicted rate before and after these counts, which are taken as Poisson
counts. If the counts contradict the prediction, this is said instead. Second, whether there are more crashes
than predicted: an e-value for each period, which may be looked at after every period. If the prediction is
right, it ever exceeds 20 with a probability of at most 5 %; an e-value of 20 or more is an alarm.

Run it in the folder in which the study ran, for example
  accelerated-evaluation monitor spmd fleet.csv --reported 0.4 0.8

The exit status is 1 if there is an alarm."""


@COMMANDS.add("monitor")
@dataclass(frozen=True)
class Monitor(Command, description=DESCRIPTION):
    """Compare the crashes and kilometres of a fleet in service with the predicted rate, at any time."""

    study: str = argument("STUDY[=RATE]", A_STUDY)
    fleet: Path = argument("FLEET.csv", "what was driven and counted")
    per: str = option(None, "unit (default: %(default)s)", "kilometre", choices=PER)
    reported: Sequence[float] = option(
        ("LOW", "HIGH"),
        "limits of the share of the crashes that are counted; all values between them are equally likely "
        "(default: 1 1)",
        (1.0, 1.0),
        nargs=2,
    )
    target: Path = option(
        "OUT.csv",
        "table of the periods to write (default: %(default)s)",
        Path("results/monitor.csv"),
        type=csv_file,
    )

    def start(self) -> int:
        """Print the rate before and after the counts and the e-values, and write them."""
        import numpy as np
        import pandas as pd

        from accelerated_evaluation.answer.consequences.in_service import (
            FALSE_ALARMS,
            InService,
            in_service_table,
        )
        from accelerated_evaluation.answer.consequences.rates import UNITS
        from accelerated_evaluation.base.errors import StudyError
        from accelerated_evaluation.base.files import write_csv
        from accelerated_evaluation.base.tables import column_of_numbers, read_csv, require_file

        low, high = self.reported
        if not 0 < low <= high <= 1:
            raise InputError(
                "--reported",
                seen=f"{low:g} {high:g}",
                expected="two shares above 0 and at most 1, the smaller one first",
                change="Correct the shares.",
            )
        key = next(name for name, unit in UNITS.items() if unit == self.per)
        require_file(self.fleet, "Correct the path of the table.")
        table = read_csv(self.fleet, {"monitor --help": key, "--help": "crashes"})

        def where(row: int) -> str:
            return f"{self.fleet}, row {row + 2}"

        columns = (key, "crashes")
        found = pd.DataFrame({name: column_of_numbers(table[name], where, "Correct it.") for name in columns})
        wrong = (found < 0).any(axis=1) | (found["crashes"] % 1 != 0)
        if wrong.any() or not found[key].sum() > 0:
            row = int(np.argmax(wrong.to_numpy())) if len(found) else 0
            raise InputError(
                where(row),
                seen=", ".join(f"{name} {found[name].iloc[row]:g}" for name in found)
                if len(found)
                else "no row",
                expected=f"{key} of 0 or more, in all above 0, and a whole number of crashes",
                change="Correct the table.",
            )
        bounds, basis = study_rates(self.study, self.per)
        rates = bounds[1]  # so that a rate that is known only to be low gives no alarm
        if not rates.any():
            raise InputError(
                self.study,
                seen="a predicted rate of 0",
                expected="a study that predicts crashes",
                change="Name a study whose vehicle crashes in some encounters.",
            )
        reported = np.linspace(low, high, len(rates))
        # Rates have a random order, so that these pairs are independent.
        counts = InService(found[key].cumsum().to_numpy(), found["crashes"].cumsum().to_numpy())
        e_values = counts.e_values(rates * reported)
        found = found.assign(
            expected=(rates * reported).mean() * counts.exposure, counted=counts.events, e_value=e_values
        )
        write_csv(self.target, found)
        print(f"crashes per {self.per}, for {basis.encounters}")
        try:
            updated = in_service_table(bounds, reported, counts)
            print(updated.drop(columns="probability").to_string(index=False, float_format="{:.3g}".format))
        except StudyError as error:
            print(f"warning: {error}")
        alarms = np.flatnonzero(e_values >= 1 / FALSE_ALARMS)
        last = (
            f"e-value {e_values[-1]:.3g} after {counts.exposure[-1]:,.0f} {key}, largest {e_values.max():.3g}"
        )
        if alarms.size:
            print(f"ALARM since row {alarms[0] + 2}: more crashes than predicted ({last})")
        else:
            print(f"no alarm: {last}; an alarm needs {1 / FALSE_ALARMS:g}")
        print(self.target)
        return int(alarms.size > 0)
