"""What every script of the workflow shares: its log, and errors as one message."""

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from accelerated_evaluation.errors import StudyError


@contextmanager
def job(log: str | os.PathLike) -> Iterator[None]:
    """Run a rule's script: standard error goes to the terminal and to ``log``, warnings and progress alike.

    A `StudyError` ends the process with status 1 and its message alone; others keep their traceback.
    """
    terminal = os.dup(2)
    read_end, write_end = os.pipe()
    os.dup2(write_end, 2)
    os.close(write_end)
    copier = threading.Thread(target=_copy, args=(read_end, terminal, log))
    copier.start()
    status = 0
    try:
        yield
    except StudyError as error:
        print(f"error: {error}", file=sys.stderr)
        status = 1
    finally:
        sys.stderr.flush()
        os.dup2(terminal, 2)
        copier.join()
        os.close(terminal)
    if status:
        sys.exit(status)


def _copy(read_end: int, terminal: int, log: str | os.PathLike) -> None:
    with os.fdopen(read_end, "rb", buffering=0) as source, open(log, "wb", buffering=0) as file:
        while chunk := source.read(65536):
            os.write(terminal, chunk)
            file.write(chunk)
