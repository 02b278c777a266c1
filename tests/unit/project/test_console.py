"""The console of the study, fed with the events of Snakemake."""

import json
import logging
import re
import sys
from types import SimpleNamespace

import pytest
from snakemake_interface_logger_plugins.common import LogEvent
from snakemake_interface_logger_plugins.registry import LoggerPluginRegistry
from snakemake_logger_plugin_study import LogHandler
from snakemake_logger_plugin_study.times import expected_seconds, pace
from snakemake_logger_plugin_study.words import duration, plain_error, progress_of, short_reason

LOCKED = (
    "LockException:\nError: Directory cannot be locked. Please make sure that no other Snakemake process ..."
)


class Console:
    """A handler of the study, and what Snakemake would send to it."""

    def __init__(self, **settings: bool) -> None:
        self.handler = LogHandler(SimpleNamespace(**{"dryrun": False, "verbose": False} | settings), None)

    def send(self, message: str, level: int = logging.INFO, at: float = 0.0, **extra: object) -> None:
        record = logging.LogRecord("snakemake", level, __file__, 1, message, (), None)
        vars(record).update(extra, created=at)
        self.handler.emit(record)

    def starts(self, number: int, rule: str, at: float, log: str = "", reason: str = "") -> None:
        extra = {"jobid": number, "rule_name": rule, "rule_msg": f"Doing {rule}", "log": [log] if log else []}
        self.send("", at=at, event=LogEvent.JOB_INFO, reason=reason, **extra)

    def ends(self, number: int, at: float) -> None:
        self.send("Finished", at=at, event=LogEvent.JOB_FINISHED, job_id=number)

    def fails(self, number: int, rule: str, log: str) -> None:
        self.send("Error", logging.ERROR, event=LogEvent.JOB_ERROR, jobid=number, rule_name=rule, log=[log])


@pytest.fixture
def console():
    """Return a console that is closed in the end."""
    console = Console()
    yield console
    console.handler.close()


def test_snakemake_finds_the_plugin():
    assert LoggerPluginRegistry().is_installed("study")


def test_a_finished_job_is_one_line_with_its_time_and_the_time_left(console, capsys):
    console.send("Job stats", event=LogEvent.RUN_INFO, stats={"fit": 1, "search": 3, "total": 4})
    console.send("Building DAG of jobs...")
    console.starts(1, "fit", at=0)
    console.ends(1, at=5)
    console.starts(2, "search", at=5)
    console.ends(2, at=25)
    reported = capsys.readouterr().err.splitlines()
    assert reported[0] == "4 jobs to do"
    assert re.split(r"  +", reported[1].strip()) == ["1 of 4", "5.0 s", "Doing fit", "about 15.0 s left"]
    # Two searches are left, which take what the first of them took.
    assert re.split(r"  +", reported[2].strip()) == ["2 of 4", "20.0 s", "Doing search", "about 40.0 s left"]
    assert len(reported) == 3
    for number in (3, 4):
        console.starts(number, "search", at=25)
        console.ends(number, at=30)
    print("the answer", file=sys.stderr)  # by the workflow, before Snakemake closes the console
    console.handler.close()
    *_, done, last = capsys.readouterr().err.splitlines()
    assert done.startswith("4 of 4 done in ")
    assert last == "the answer"


def test_the_time_left_is_that_of_the_last_run_at_the_pace_of_this_one(tmp_path):
    last, shipped = tmp_path / "metadata", tmp_path / "rules.csv"
    last.mkdir()
    for output, number, start, end in (("a", 1, 0.0, 4.0), ("b", 1, 0.0, 4.0), ("c", 2, 10.0, 12.0)):
        job = {"rule": "fit", "job_hash": number, "starttime": start, "endtime": end}
        (last / output).write_text(json.dumps(job))
    (last / "d").write_text(json.dumps({"rule": "search", "job_hash": 3, "starttime": 1.0, "endtime": None}))
    shipped.write_text("rule,jobs,seconds_all\nfit,1,50\nsearch,2,40\n")
    expected = expected_seconds(last, shipped)
    assert expected == {"fit": 3.0, "search": 20.0}
    assert pace(expected, {}, {"fit": 1}) == 1
    assert pace(expected, {"fit": [6.0]}, {"search": 10_000}) == pytest.approx(1, rel=1e-3)
    assert pace(expected, {"search": [40.0] * 10_000}, {"fit": 1}) == pytest.approx(21 / 11, rel=1e-3)
    assert pace({}, {"fit": [6.0]}, {"search": 1}) == 1


def test_the_message_of_a_failed_job_comes_last(console, capsys, tmp_path):
    log = tmp_path / "fit.log"
    log.write_text("progress 10%|\nerror: a.csv: seen x; expected y. Mend it.\n")
    console.send("Job stats", event=LogEvent.RUN_INFO, stats={"fit": 2, "total": 2})
    console.starts(1, "fit", at=0, log=str(log))
    console.fails(1, "fit", str(log))
    console.send("RuleException:\nCalledProcessError in file ...", logging.ERROR, event=LogEvent.ERROR)
    console.send("Shutting down, this might take some time.")
    console.starts(2, "fit", at=0)
    console.ends(2, at=1)
    console.send("WorkflowError:\nAt least one job did not complete successfully.", logging.ERROR)
    console.handler.close()
    reported = capsys.readouterr().err.splitlines()
    assert reported[-2:] == [
        f"failed: Doing fit (rule fit, log {log})",
        "error: a.csv: seen x; expected y. Mend it.",
    ]
    assert not any("RuleException" in line or "Shutting" in line for line in reported)


def test_a_job_that_left_no_message_is_told_with_what_snakemake_knows(console, capsys, tmp_path):
    console.starts(1, "fit", at=0)
    console.send("Command died with <Signals.SIGKILL: 9>.", logging.ERROR, event=LogEvent.ERROR)
    console.fails(1, "fit", str(tmp_path / "none.log"))
    console.handler.close()
    assert "SIGKILL" in capsys.readouterr().err.splitlines()[-1]


def test_an_error_before_any_job_is_told_without_the_code_it_came_from(console, capsys):
    reported = (
        'WorkflowError in file "/x/common.smk", line 21:\nThe configuration cannot be used:\n  seeds: seen 0'
    )
    console.send(
        f'{reported}\n  File "/x/common.smk", line 21, in <module>', logging.CRITICAL, event=LogEvent.ERROR
    )
    console.handler.close()
    assert capsys.readouterr().err.splitlines()[-2:] == [
        "error: The configuration cannot be used:",
        "  seeds: seen 0",
    ]


def test_a_dry_run_tells_each_job_and_why(capsys):
    console = Console(dryrun=True)
    console.starts(1, "fit", at=0, reason="Updated input files: a.py, b.py; Code has changed")
    console.send("Job stats:\nfit 1", event=LogEvent.RUN_INFO, stats={"fit": 1})
    console.handler.close()
    assert capsys.readouterr().err.splitlines() == [
        "fit: Doing fit",
        "    because of edited a.py, b.py; code has changed",
        "Job stats:",
        "fit 1",
    ]


def test_progress_is_that_of_the_last_bar_in_the_log(tmp_path):
    log = tmp_path / "job.log"
    assert progress_of([str(log)]) == ""
    log.write_text("\r 10%|#   | 1/10" + "x" * 9000 + "\r 40%|##  | 4/10\r 45%|## | 5/10")
    assert progress_of([str(log)]) == "45 % "
    assert progress_of([]) == ""


def test_words():
    assert [duration(seconds) for seconds in (0.04, 605)] == ["0.0 s", "10 min 05 s"]
    assert (
        short_reason("Missing output files: a, b; Params have changed since last execution: before: c")
        == "missing output files; changed settings or code of the library"
    )
    assert plain_error(LOCKED).startswith("error: another run makes files of this study")
    missing = (
        "Traceback (most recent call last):\n  File ...\nFileNotFoundError: [Errno 2] No such file: 'c.yaml'"
    )
    assert plain_error(missing) == "error: [Errno 2] No such file: 'c.yaml'"
    forbidden = "PermissionError in file common.smk:\n[Errno 13] Permission denied: 'my table.csv'"
    assert plain_error(forbidden).startswith("error: my table.csv: seen no permission to use it;")
    read_only = "Failed to create output directory a.\nOSError: [Errno 30] Read-only file system: 'figures/a'"
    assert plain_error(read_only).startswith("error: figures/a: seen no permission to use it;")
    assert "ZeroDivisionError" in plain_error(
        "Traceback (most recent call last):\nZeroDivisionError: by zero"
    )
