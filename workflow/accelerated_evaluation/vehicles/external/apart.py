"""Run a user's compiled code in a separate process, so that a crash of the code becomes an error message."""

import ctypes
import os
import pickle
import signal
import sys
from collections.abc import Callable

from accelerated_evaluation.base.errors import InputError

DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of prctl(2)


def run_apart(work: Callable[[], None], what: str) -> None:
    """Run a function in a child process; an exception of the function is raised in this process.

    Its changes of objects in memory are lost. InputError is raised if a signal ends the child process, for
    example because of a segmentation fault in compiled code.
    """
    read, write = os.pipe()
    parent = os.getpid()
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if child == 0:
        os.close(read)
        _work(work, write, parent)
    os.close(write)
    try:
        with os.fdopen(read, "rb") as pipe:
            report = pipe.read()
    except KeyboardInterrupt:
        os.kill(child, signal.SIGKILL)
        raise
    finally:
        _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        raise InputError(
            what,
            seen=f"the end of the process that simulated it by {signal.Signals(os.WTERMSIG(status)).name}",
            expected="outcomes",
            change="Correct the vehicle: its compiled code, or a library that it uses, ends the process.",
        )
    if report:
        raise pickle.loads(report)


def _work(work: Callable[[], None], pipe: int, parent: int) -> None:
    """Run the function in the child process, write its exception to the pipe, and end the child process."""
    leave = os._exit
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(DIE_WITH_PARENT, signal.SIGKILL)
    if os.getppid() != parent:  # the parent has ended before prctl took effect
        leave(1)
    report = b""
    try:
        work()
    except BaseException as error:
        try:
            report = pickle.dumps(error)
            pickle.loads(report)
        except Exception:  # the exception cannot be pickled
            report = pickle.dumps(RuntimeError(f"{type(error).__name__}: {error}"))
    with os.fdopen(pipe, "wb") as file:
        file.write(report)
    sys.stdout.flush()
    sys.stderr.flush()
    leave(0)
