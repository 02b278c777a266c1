"""Processes of programs that are run for a vehicle: started in a group of their own, and ended as a whole."""

import contextlib
import os
import signal
import subprocess
import time
import uuid
from collections.abc import Callable, Sequence
from pathlib import Path
from threading import Thread
from typing import BinaryIO

from accelerated_evaluation.base.errors import InputError

REMEMBERED = 2000  # number of bytes kept of the printed output, so that a message can contain the last line
MARK = "ACCELERATED_EVALUATION_COMMAND"  # environment variable that all processes of a command inherit

RUNNING: set[tuple[int, str]] = set()
"""Arguments of `end_group` for the programs that are running, which have to end with this process."""


def started(
    words: Sequence[str], refuse: Callable[..., InputError], **streams: int
) -> tuple[subprocess.Popen, str]:
    """Start a program in its own process group, and return it with its mark (see `end_group`).

    ``streams`` are arguments of `subprocess.Popen`. The error that ``refuse`` makes is raised if the program
    cannot be started.
    """
    mark = f"{MARK}={uuid.uuid4()}"
    try:
        process = subprocess.Popen(
            words, env=os.environ | dict([mark.split("=")]), start_new_session=True, **streams
        )
    except OSError as error:
        seen = f"{words[0]!r}: {(error.strerror or str(error)).lower()}"
        change = "Correct the path, and make the file executable or name its interpreter first."
        raise refuse("start", seen, "a program that can be run", change) from error
    RUNNING.add((process.pid, mark))
    return process, mark


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


def end_group(process: int, mark: str) -> None:
    """Kill all processes of a command: its process group, and processes that have left the group.

    ``mark`` is an entry of the environment that only the processes of this command have. It identifies
    processes that have left the group, on systems that list processes under /proc.
    """
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process, signal.SIGKILL)
    while left := _marked(mark):  # a process may have started another one meanwhile
        for one in left:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(one, signal.SIGKILL)
        time.sleep(0.01)


def _marked(mark: str) -> list[int]:
    """Return the numbers of running processes that have the entry ``mark`` in their environment."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # the process has ended, or belongs to another user
            if mark.encode() in (folder / "environ").read_bytes().split(b"\0"):
                found.append(int(folder.name))
    return found


def ended(process: subprocess.Popen, mark: str, printed: Printed) -> None:
    """End a program with all that it has started, and read the rest of what it printed."""
    end_group(process.pid, mark)
    process.wait()
    RUNNING.discard((process.pid, mark))
    printed.stop()
