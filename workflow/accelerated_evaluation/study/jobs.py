"""Common frame of all scripts of the workflow: the log, and one message for an error."""

import os
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from threadpoolctl import threadpool_limits

from accelerated_evaluation.base.errors import StudyError, explained
from accelerated_evaluation.base.files import is_disk_full

# Set by the logger plugin, which shows the progress of jobs, and their errors after all else.
LOGGER_VARIABLE = "ACCELERATED_EVALUATION_LOGGER"


@contextmanager
def job(log: str | os.PathLike) -> Iterator[Callable[[str], object]]:
    """Run the script of a rule; standard error, including warnings and progress bars, is written to ``log``.

    Jobs run at the same time, so they leave the terminal to the logger of the workflow. If there is no such
    logger, or if the log cannot be written, a job reports its failure on the terminal.

    An error ends the process with status 1. A `StudyError` is reported by its message only, a full disk by
    the file that could not be written, and other errors with a traceback.
    """
    terminal = os.dup(2)
    message = ""
    try:
        with open(log, "wb", buffering=0) as file:
            os.dup2(file.fileno(), 2)
        # A job has a thread for each worker of a slow vehicle, on which no digit of its algebra may depend.
        with threadpool_limits(1, "blas"):
            yield lambda text: os.write(terminal, f"{text}\n".encode(errors="replace"))
    except StudyError as error:
        message = f"error: {error}\n"
    except SystemExit as error:
        message = (
            f"error: the job was ended by sys.exit({error.code!r}), which nothing that it runs may call\n"
        )
    except Exception as error:
        message = traceback.format_exc()
        if (cause := explained(error)) is not error:
            message = f"error: {cause}\n"
        elif is_disk_full(error):
            message = "error: no space left on the disk; free some and run the study again\n"
    if message:
        _report(message, terminal)
    os.dup2(terminal, 2)  # also after an error: what a full disk has left in a buffer would end in status 120
    if message:
        sys.exit(1)


def _report(message: str, terminal: int) -> None:
    """Write how a job failed to its log, and to the terminal where nothing else shows it."""
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
    """Hide a module inside the block, so that packages that use it optionally do without it.

    The package jsonschema would read a grammar of web addresses. This takes more than a second at each start
    of Snakemake and of each notebook, and no schema of the study needs it.
    """
    if module in sys.modules:
        yield
        return
    sys.modules[module] = None
    try:
        yield
    finally:
        del sys.modules[module]
