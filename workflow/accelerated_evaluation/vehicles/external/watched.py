"""A vehicle that remembers its simulations, and compiled code that runs in a separate process."""

import ctypes
import os
import pickle
import signal
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.scenarios.outcomes import have_failed
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.protocol import Vehicle

REMEMBERED = 20_000  # largest number of runs that are kept; an estimate from few runs has fewer
DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of prctl(2)


class WatchedVehicle:
    """A vehicle that remembers its runs; all other attributes are those of ``vehicle``.

    ``differed`` counts repetitions that ended differently from the first simulation of the encounter. Runs
    that have failed are neither remembered nor compared.
    """

    def __init__(self, vehicle: Vehicle, scenario: Scenario) -> None:
        self.vehicle, self.scenario, self.differed = vehicle, scenario, 0
        self._runs: dict[tuple[float, ...], tuple[float, ...]] = {}

    def simulate(self, *columns: Array) -> Any:  # noqa: ANN401
        """Return the outcomes of the vehicle, and remember them."""
        outcomes = self.vehicle.simulate(*columns)
        if len(self._runs) < REMEMBERED:
            self._runs |= _rows(columns, outcomes)
        return outcomes

    def repeat(self, *columns: Array) -> Any:  # noqa: ANN401
        """Return the outcomes of a repetition of the vehicle, and count those that differ from the first."""
        again = getattr(self.vehicle, "repeat", self.vehicle.simulate)(*columns)
        self.differed += sum(
            not np.allclose(outcome, self._runs.get(encounter, outcome), equal_nan=True)
            for encounter, outcome in _rows(columns, again).items()
        )
        return again

    @property
    def encounters(self) -> Array:
        """The encounters that were simulated, without repetitions, shape (d, n)."""
        return np.array([*self._runs]).reshape(-1, self.scenario.dimension).T

    @property
    def outcomes(self) -> Any:  # noqa: ANN401
        """The outcomes of the encounters."""
        rows = np.array([*self._runs.values()]).reshape(-1, len(self.scenario.outcomes))
        return self.scenario.outcomes_of(rows.T)

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401
        """Return an attribute of the vehicle."""
        return getattr(self.vehicle, name)

    def __repr__(self) -> str:
        """Return the description of the vehicle, which identifies its runs."""
        return repr(self.vehicle)


def _rows(columns: tuple[Array, ...], outcomes: Any) -> dict[tuple[float, ...], tuple[float, ...]]:  # noqa: ANN401
    """Return a mapping from each encounter to its outcomes, both as tuples of numbers."""
    known = ~have_failed(outcomes)
    encounters = np.array([np.asarray(column, dtype=float)[known] for column in columns]).T.tolist()
    found = np.array([values[known] * 1.0 for values in vars(outcomes).values()]).T.tolist()
    return dict(zip(map(tuple, encounters), map(tuple, found), strict=True))


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
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(DIE_WITH_PARENT, signal.SIGKILL)
    if os.getppid() != parent:  # the parent has ended before prctl took effect
        os._exit(1)
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
    os._exit(0)
