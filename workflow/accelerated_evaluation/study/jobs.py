"""Common context of all scripts, which writes the log and reports errors; removal of locks of killed runs."""

import fcntl
import os
import shutil
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from threadpoolctl import threadpool_limits

from accelerated_evaluation.base.errors import StudyError, explained
from accelerated_evaluation.base.files import is_disk_full

# Environment variable of the logger plugin, which shows the progress of jobs, and their errors at the end.
LOGGER_VARIABLE = "ACCELERATED_EVALUATION_LOGGER"


@contextmanager
def job(log: str | os.PathLike) -> Iterator[Callable[[str], object]]:
    """Run the script of a rule in a ``with`` block whose standard error is written to a log.

    Jobs run at the same time, so only the logger of the workflow writes to the terminal. If there is no such
    logger, or if the log cannot be written, a job reports its failure on the terminal. An error ends the
    process with status 1. A `StudyError` is reported by its message, a full disk by a short message, and
    other errors with a traceback. The yielded function prints a line on the terminal.
    """
    terminal = os.dup(2)
    message = ""
    try:
        with open(log, "wb", buffering=0) as file:
            os.dup2(file.fileno(), 2)
        # Linear algebra uses one thread, because its digits must not depend on the number of threads of a
        # job.
        with threadpool_limits(1, "blas"):
            yield lambda text: os.write(terminal, f"{text}\n".encode(errors="replace"))
    except StudyError as error:
        message = f"error: {error}\n"
    except SystemExit as error:
        message = (
            f"error: the job was ended by sys.exit({error.code!r}), which the code of a job must not call\n"
        )
    except Exception as error:
        message = traceback.format_exc()
        if (cause := explained(error)) is not error:
            message = f"error: {cause}\n"
        elif is_disk_full(error):
            message = "error: no space left on the disk; free some and run the study again\n"
    if message:
        _report(message, terminal)
    os.dup2(terminal, 2)  # also after an error, because unwritten output would change the exit status to 120
    if message:
        sys.exit(1)


def _report(message: str, terminal: int) -> None:
    """Write the error message of a job to its log, and to the terminal if no logger shows it."""
    content = message.encode(errors="replace")
    try:
        sys.stderr.flush()
        is_logged = os.write(2, content) == len(content)
    except OSError:
        is_logged = False
    if not is_logged or LOGGER_VARIABLE not in os.environ:
        os.write(terminal, content)


@contextmanager
def without(module: str) -> Iterator[None]:
    """Hide an optional module from packages that are imported in a ``with`` block.

    The package jsonschema would otherwise load a grammar of web addresses. This takes more than a second at
    each start of Snakemake and of each notebook, and no schema of the study needs it.
    """
    if module in sys.modules:
        yield
        return
    sys.modules[module] = None
    try:
        yield
    finally:
        del sys.modules[module]


def release_dead_locks(folder: str | os.PathLike = ".snakemake") -> BinaryIO:
    """Remove the locks that killed runs left in Snakemake's folder, and mark this run as active.

    A run that is killed cannot remove its locks, and Snakemake cannot distinguish them from the locks of an
    active run. Every run therefore holds a shared lock on a file until its process ends. If a run can lock
    this file exclusively, no other run is active, and all of Snakemake's locks are left over from killed
    runs. The result is the locked file; keep it open until the run ends.
    """
    folder = Path(folder)
    folder.mkdir(exist_ok=True)
    mark = open(folder / "alive", "ab")  # noqa: SIM115, open as long as the run lasts
    try:
        fcntl.flock(mark, fcntl.LOCK_EX | fcntl.LOCK_NB)
        shutil.rmtree(folder / "locks", ignore_errors=True)
    except BlockingIOError:
        pass  # another run is active, to which the locks may belong
    fcntl.flock(mark, fcntl.LOCK_SH)
    return mark
