"""Turn the events of Snakemake into what a person wants to read."""

import os
import shutil
import sys
import threading
import time
from collections import Counter
from dataclasses import dataclass
from logging import ERROR, WARNING, LogRecord
from typing import Any

from accelerated_evaluation.study.jobs import LOGGER_VARIABLE
from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

from snakemake_logger_plugin_study.times import expected_seconds, pace
from snakemake_logger_plugin_study.words import (
    duration,
    failure,
    fault_of_configuration,
    is_noise,
    plain_error,
    progress_of,
    short_reason,
)

TICK = 1.0  # seconds between two looks at the running jobs
SILENCE = 30.0  # seconds after which a console that is no terminal says what is running
MOST = 4  # running jobs that are named; a cluster runs more
EARLY = 0.1  # share of the jobs that must be finished before the remaining time is estimated


@dataclass
class Running:
    """A job that runs: its rule, what it does, where it logs, and since when, in seconds."""

    rule: str
    message: str
    logs: list[str]
    since: float


class LogHandler(LogHandlerBase):
    """Writes to standard error; Snakemake's own log under .snakemake/log keeps everything."""

    writes_to_stream, writes_to_file, needs_rulegraph = True, False, False
    has_filter, has_formatter = False, True  # without a filter of our own, Snakemake's --quiet works

    def __post_init__(self) -> None:
        """Inform the jobs that their progress and errors are shown here, and begin to monitor them."""
        os.environ[LOGGER_VARIABLE] = "study"
        self.running: dict[int, Running] = {}
        self.left: Counter[str] = Counter()  # jobs to do, by rule
        self.seconds: dict[str, list[float]] = {}  # that finished jobs took, by rule
        self.expected: dict[str, float] = {}  # seconds of a job, by rule
        self.total = self.most_at_once = 0
        self.failures: list[str] = []
        self.errors: list[str] = []
        self.plan = ""  # of a dry run
        self.begun = self.spoken = time.time()
        self.is_terminal = sys.stderr.isatty()
        self.is_closed = threading.Event()
        threading.Thread(target=self._look, daemon=True).start()

    def emit(self, record: LogRecord) -> None:
        """Show a record of Snakemake's log, in the words of the study."""
        event = getattr(record, "event", None)
        shown = {
            LogEvent.RUN_INFO: self._planned,
            LogEvent.JOB_INFO: self._started,
            LogEvent.JOB_FINISHED: self._finished,
            LogEvent.JOB_ERROR: self._failed,
        }
        if event in shown:
            shown[event](record)
        elif record.levelno >= ERROR:
            self.errors.append(plain_error(record.getMessage()))
        elif record.levelno >= WARNING or (event is None and not is_noise(record.getMessage())):
            self._say(record.getMessage())

    def close(self) -> None:
        """Say how it ended; what went wrong comes last on the screen."""
        if not self.is_closed.is_set():
            self.is_closed.set()
            self._status("")
            done = sum(map(len, self.seconds.values()))
            if self.plan:
                self._say(self.plan)
            elif done < self.total:
                self._say_done(done)
            if self.errors and not self.total:
                fault = fault_of_configuration(sys.argv[1:])
                self.errors = [fault] if fault else self.errors
            for message in self.failures or dict.fromkeys(self.errors):
                self._say(f"\n{message}")
        super().close()

    def _planned(self, record: LogRecord) -> None:
        if self.common_settings.dryrun:
            self.plan = record.getMessage()
            return
        self.left = Counter({rule: n for rule, n in record.stats.items() if rule != "total"})
        self.total = self.left.total()
        self.expected = expected_seconds()
        self._say(f"{self.total} {'job' if self.total == 1 else 'jobs'} to do")

    def _started(self, record: Any) -> None:  # noqa: ANN401, Snakemake adds attributes to the record
        job = Running(record.rule_name, record.rule_msg or record.rule_name, list(record.log), record.created)
        if self.common_settings.dryrun:
            self._say(f"{job.rule}: {job.message}\n    because of {short_reason(record.reason)}")
            return
        self.running[record.jobid] = job
        self.most_at_once = max(self.most_at_once, len(self.running))

    def _finished(self, record: Any) -> None:  # noqa: ANN401
        job = self.running.pop(record.job_id, None)
        if job is None:
            return
        took = record.created - job.since
        self.left[job.rule] -= 1
        self.seconds.setdefault(job.rule, []).append(took)
        done = sum(map(len, self.seconds.values()))
        is_known = EARLY * self.total < done < self.total
        left = f"   about {duration(self._remaining())} left" if is_known else ""
        self._say(f"{done:>4} of {self.total}   {duration(took):>10}   {job.message}{left}")
        if done == self.total:  # before the workflow says what it found
            self._say_done(done)

    def _say_done(self, done: int) -> None:
        self._say(f"{done} of {self.total} done in {duration(time.time() - self.begun)}")

    def _failed(self, record: Any) -> None:  # noqa: ANN401
        job = self.running.pop(record.jobid, None)
        what = job.message if job else record.rule_name
        self.failures.append(failure(what, record.rule_name, list(record.log), self.errors))
        self._say(f"   failed   {what}")

    def _remaining(self) -> float:
        """Estimate the seconds left: a job takes what others of its rule took, or what is expected of it."""
        took = [seconds for times in self.seconds.values() for seconds in times]
        usual, factor = sum(took) / len(took), pace(self.expected, self.seconds, self.left)
        means = {rule: factor * seconds for rule, seconds in self.expected.items()}
        means |= {rule: sum(times) / len(times) for rule, times in self.seconds.items()}
        work = sum(count * means.get(rule, usual) for rule, count in self.left.items())
        spent = sum(min(time.time() - job.since, means.get(job.rule, usual)) for job in self.running.values())
        return (work - spent) / max(self.most_at_once, 1)

    def _look(self) -> None:
        """Show what is running, once a tick on a terminal, and after a long silence elsewhere."""
        while not self.is_closed.wait(TICK):
            with self.lock:
                parts = [
                    f"{job.message} {progress_of(job.logs)}({duration(time.time() - job.since)})"
                    for job in self.running.values()
                ]
                more = [f"{len(parts) - MOST} more"] if len(parts) > MOST else []
                line = f"running: {'; '.join([*parts[:MOST], *more])}"
                if self.is_terminal:
                    self._status(line if parts else "")
                elif parts and time.time() - self.spoken > SILENCE:
                    self._say(line)

    def _status(self, line: str) -> None:
        """Replace the last line of a terminal."""
        if self.is_terminal:
            width = shutil.get_terminal_size().columns - 1
            sys.stderr.write(f"\r\x1b[K{line[:width]}")
            sys.stderr.flush()

    def _say(self, text: str) -> None:
        self._status("")
        sys.stderr.write(f"{text}\n")
        sys.stderr.flush()
        self.spoken = time.time()
