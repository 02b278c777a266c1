"""What every script of the workflow shares: its log, and errors as one message."""

import os
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import BinaryIO

from accelerated_evaluation.errors import StudyError


@contextmanager
def job(log: str | os.PathLike) -> Iterator[None]:
    """Run a rule's script: standard error goes to the terminal and to ``log``, warnings and progress alike.

    An error ends the process with status 1: a `StudyError` with its message alone, others with a traceback.
    """
    file = open(log, "wb", buffering=0)  # noqa: SIM115, the thread closes it
    terminal = os.dup(2)
    read_end, write_end = os.pipe()
    os.dup2(write_end, 2)
    os.close(write_end)
    copier = threading.Thread(target=_copy, args=(read_end, terminal, file), daemon=True)
    copier.start()
    failed = True
    try:
        yield
        failed = False
    except StudyError as error:
        print(f"error: {error}", file=sys.stderr)
    except Exception:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os.dup2(terminal, 2)
        copier.join(timeout=10)  # A process that was left behind may hold the pipe open.
    if failed:
        sys.exit(1)


def _copy(read_end: int, terminal: int, file: BinaryIO) -> None:
    with os.fdopen(read_end, "rb", buffering=0) as source, file:
        while chunk := source.read(65536):
            file.write(chunk)
            with suppress(OSError):  # The log goes on where the terminal has gone.
                os.write(terminal, chunk)
