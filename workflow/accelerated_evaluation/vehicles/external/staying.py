"""A program that stays: it is started once, and answers one encounter after the other in lines of JSON."""

import json
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any, BinaryIO

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.vehicles.external.processes import Printed, ended, started

LONGEST_LINE = 10_000_000  # number of bytes; the rest of a longer line is read as another line
BYTE_ORDER_MARK = b"\xef\xbb\xbf"
AT_LEISURE = 2.0  # [s], longest time for the program to end after the end of its input
GREETING = 'one line of JSON with the name of the program, such as {"name": "my stack", "version": "1.2"}'
Refuse = Callable[..., InputError]


class Conversation:
    """A running program and the lines that it writes; lines that do not begin with ``{`` are ignored.

    InputError is raised, and the program is ended, if it does not begin with a greeting, ends, answers
    something else than it was asked, or does not answer within ``time_limit`` [s]. ``refuse`` makes the error
    from the place, what was seen, what was expected, and what to change.
    """

    def __init__(self, words: Sequence[str], time_limit: float, refuse: Refuse) -> None:
        self._time_limit, self._refuse, self._asked = time_limit, refuse, 0
        pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
        self._process = started(words, refuse, **pipes)
        self._lines: SimpleQueue[bytes] = SimpleQueue()
        self._printed = Printed(self._process.stderr)
        Thread(target=_read_lines, args=(self._process.stdout, self._lines), daemon=True).start()
        self._expect("start", GREETING, lambda found: isinstance(found.get("name"), str))

    def ask(self, encounter: Mapping[str, Any], place: str) -> dict[str, Any]:
        """Return the answer to one encounter, which the error names by ``place``."""
        self._asked += 1
        request = json.dumps({"id": self._asked, **encounter})
        with suppress(OSError):  # the program has ended, which the next line says
            self._process.stdin.write(f"{request}\n".encode())
            self._process.stdin.flush()
        expected = f'one line of JSON with "id": {self._asked} and the outcomes'
        return self._expect(place, expected, lambda found: found.get("id") == self._asked)

    def end(self) -> None:
        """Close the input of the program, and end it if it does not end by itself."""
        if self._process.returncode is not None:
            return  # after a fault; its number may belong to another process by now
        with suppress(OSError):
            self._process.stdin.close()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(AT_LEISURE)
        ended(self._process, self._printed)

    def _expect(self, place: str, expected: str, fits: Callable[[Mapping[str, Any]], bool]) -> dict[str, Any]:
        """Return the next object that the program writes; InputError names ``place`` unless it fits."""
        until = time.monotonic() + self._time_limit
        ignored, line = b"", self._next_line(until)
        while line and not line.startswith((b"{", b"[{")):
            ignored, line = line, self._next_line(until)
        found = _object_in(line)
        if found is not None and "error" not in found and fits(found):
            return found
        shown = _shown(line) if line else ""
        change = "Correct the program."
        if line is None:
            seen = f"no line within {self._time_limit:g} s"
            seen += f" that begins with {{, but {_shown(ignored)}" if ignored else ""
            change = "Make the program faster, or raise simulations.time_limit."
        elif len(line) >= LONGEST_LINE:
            seen = f"a line of more than {LONGEST_LINE:,} bytes, {shown}"
        elif not line.endswith(b"\n"):
            seen = self._end_in_words(shown)
        else:
            seen = shown
        ended(self._process, self._printed)
        raise self._refuse(place, f"{seen}{self._printed.last_line()}", expected, change)

    def _next_line(self, until: float) -> bytes | None:
        """Return the next line, which is empty at the end of the output; None after the time ``until``.

        The output also ends if the program has ended, but a process that it started keeps the pipe open.
        """
        has_ended = False
        while (left := until - time.monotonic()) > 0 and not has_ended:
            has_ended = self._process.poll() is not None
            with suppress(Empty):
                return (
                    self._lines.get(timeout=min(left, AT_LEISURE))
                    .removeprefix(BYTE_ORDER_MARK)
                    .lstrip(b" \t")
                )
        return b"" if has_ended else None

    def _end_in_words(self, rest: str) -> str:
        """Return how the program ended, with the ``rest`` of a line that it had begun."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(AT_LEISURE)
        status = self._process.poll()
        how = "the end of its output" if status is None else f"its end with exit status {status}"
        return f"{how} in the middle of the line {rest}" if rest else how


def _object_in(line: bytes | None) -> dict[str, Any] | None:
    """Return the JSON object of a line; None if it is something else, or if there is no line."""
    try:
        found = json.loads(line) if line else None
    except (ValueError, RecursionError):  # no JSON, or JSON that is nested too deeply
        return None
    return found if isinstance(found, dict) else None


def _shown(line: bytes) -> str:
    """Return the beginning of a line for a message; bytes that are no UTF-8 are shown by their numbers."""
    return repr(line[:1000].decode(errors="backslashreplace").strip()[:200])


def _read_lines(pipe: BinaryIO, lines: "SimpleQueue[bytes]") -> None:
    """Put all lines of a pipe into a queue, and an empty one at its end."""
    line = b"\n"
    while line:
        try:
            line = pipe.readline(LONGEST_LINE)
        except (ValueError, OSError):  # the pipe was closed
            line = b""
        lines.put(line)
