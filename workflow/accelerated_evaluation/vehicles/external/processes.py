"""Processes of programs that are run for a vehicle: started in a group of their own, and ended as a whole."""

import contextlib
import os
import signal
import subprocess
from collections.abc import Callable, Sequence
from threading import Thread
from typing import BinaryIO

from accelerated_evaluation.base.errors import InputError

REMEMBERED = 2000  # number of bytes kept of the printed output, so that a message can contain the last line

RUNNING: set[int] = set()
"""The process groups of the programs that are running, which have to end with this process."""


def started(words: Sequence[str], refuse: Callable[..., InputError], **streams: int) -> subprocess.Popen:
    """Start a program in its own process group.

    ``streams`` are arguments of `subprocess.Popen`. The error that ``refuse`` makes is raised if the program
    cannot be started.
    """
    try:
        process = subprocess.Popen(words, start_new_session=True, **streams)
    except OSError as error:
        seen = f"{words[0]!r}: {(error.strerror or str(error)).lower()}"
        change = "Correct the path, and make the file executable or name its interpreter first."
        raise refuse("start", seen, "a program that can be run", change) from error
    RUNNING.add(process.pid)
    return process


class Printed:
    """Reads the printed output of a command, so that the command never blocks, and keeps the last part."""

    def __init__(self, pipe: BinaryIO) -> None:
        self._pipe, self._end = pipe, b""
        self._thread = Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        with contextlib.suppress(ValueError, OSError):  # the pipe was closed
            while part := self._pipe.read1(65536):
                self._end = (self._end + part)[-REMEMBERED:]

    def stop(self) -> None:
        """Read the rest of the output for at most one second.

        A process that has left the process group of the command may keep the pipe open forever.
        """
        self._thread.join(1)
        if not self._thread.is_alive():
            self._pipe.close()

    def last_line(self) -> str:
        """Return the last printed line, for a message; empty if there is none."""
        lines = self._end.decode(errors="replace").strip().splitlines()
        return f", and printed last {' '.join(lines[-1].split())[-300:]!r}" if lines else ""


def end_group(process: int) -> None:
    """Kill all processes of a command, which are its process group."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process, signal.SIGKILL)


def ended(process: subprocess.Popen, printed: Printed) -> None:
    """End a program with all that it has started, and read the rest of what it printed."""
    end_group(process.pid)
    process.wait()
    RUNNING.discard(process.pid)
    printed.stop()
