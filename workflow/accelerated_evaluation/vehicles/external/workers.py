"""Workers that simulate batches of encounters, and the comparison of a vehicle with itself in them."""

import ctypes
import faulthandler
import importlib
import json
import os
import shutil
import signal
import subprocess
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from functools import cache, partial
from multiprocessing import active_children, get_context, parent_process
from queue import SimpleQueue
from typing import Any, TextIO

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError, StudyError
from accelerated_evaluation.base.users_code import error_in_words
from accelerated_evaluation.scenarios import DEFAULT, SCENARIOS
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.external.checked import CheckedVehicle, ForeignVehicle, difference_in
from accelerated_evaluation.vehicles.external.processes import RUNNING, end_group
from accelerated_evaluation.vehicles.loading import load_vehicle
from accelerated_evaluation.vehicles.protocol import outcome_error

PROCESSES = "processes"
CLUSTERS = {"dask": ("distributed", "LocalCluster"), "slurm": ("dask_jobqueue", "SLURMCluster")}
INTERRUPT = {signal.SIGINT}
GRACE = 2.0  # [s], time after the limit until a worker is ended, so that its command is ended first
AT_LEISURE = 0.5  # [s], longest time for a worker to end after an interrupt
# The printed output and the timer belong to the process, which may have several threads.
ONE_AT_A_TIME = threading.Lock()
JOIN = 60.0  # [s], longest time to wait for the first worker of a cluster whose address is given
COMPARED = 4  # number of runs with the event, and number of others, that are repeated one by one
TIME_LIMIT = 3600.0  # [s], longest time for the repetition of a batch of a vehicle that is not stored


@dataclass(frozen=True)
class Workers:
    """An executor for batches, another one for repetitions, and the number of batches of each at a time.

    The processes of the two executors differ, except on a cluster, where the scheduler chooses the process.
    """

    executor: Executor
    others: Executor
    count: int


def simulate_batch(
    name: str, parameters: Mapping[str, Any], encounters: Array, time_limit: float, scenario: str = DEFAULT
) -> Array:
    """Return the outcomes of a batch of n encounters, shape (m, n); this function runs in a worker.

    The printed output of the vehicle is discarded. If the vehicle takes longer than ``time_limit`` [s], the
    worker process is ended, because there is no other way to stop compiled code. For cut-ins with lead speeds
    over time, further rows of ``encounters`` contain these speeds.
    """
    with ONE_AT_A_TIME, open(os.devnull, "w") as nowhere, printed_to(nowhere, 1, 2):
        faulthandler.dump_traceback_later(time_limit + GRACE, exit=True, file=nowhere)
        try:
            vehicle = _loaded(json.dumps([name, scenario, parameters]))
            if isinstance(vehicle.vehicle, ForeignVehicle):
                vehicle.vehicle.time_limit = time_limit
                longest = vehicle.vehicle.longest(encounters.shape[1])
                faulthandler.dump_traceback_later(longest + GRACE, exit=True, file=nowhere)
            variables, speeds = np.split(encounters, [vehicle.scenario.dimension])
            motion = (speeds.T,) if len(speeds) else ()
            outcomes = (vehicle.simulate_moving if motion else vehicle.simulate)(*variables, *motion)
        finally:
            faulthandler.cancel_dump_traceback_later()
    names = vehicle.scenario.outcome_names
    return np.array([getattr(outcomes, name) + 0.0 for name in names])  # -0.0 becomes 0.0, as in SQLite


@contextmanager
def workers_of(kind: str, count: int, options: Mapping[str, Any]) -> Iterator[Workers]:
    """Yield workers, and end them after the ``with`` block.

    ``kind``, ``count`` and ``options`` are the keys ``executor``, ``workers`` and ``options`` of the
    simulations. InputError is raised if the executor is unknown, if Dask is not installed, or if the cluster
    cannot be reached or started.
    """
    if kind == PROCESSES:
        with Processes(count) as processes, Processes(count) as others:
            yield Workers(processes, others, count)
        return
    with ExitStack() as stack:
        try:
            client = stack.enter_context(_dask_client(kind, count, options, stack))
        except InputError:
            raise
        except Exception as error:  # clusters raise various errors for a wrong option or address
            change = "Correct simulations.executor or simulations.options."
            raise _error(
                repr(kind), error_in_words(error), "a cluster that starts or answers", change
            ) from error
        executor = Cluster(client)
        yield Workers(executor, executor, count)


class Processes(Executor):
    """Independent worker processes on this machine: if one dies, no other batch is lost.

    The ``count`` processes are started when they are first needed.
    """

    def __init__(self, count: int) -> None:
        context = get_context("spawn")  # a fork would copy the state of the threads of this process
        self._new = partial(ProcessPoolExecutor, 1, context, initializer=_follow_parent)
        self._pools = [self._new() for _ in range(count)]
        self._idle: SimpleQueue[ProcessPoolExecutor] = SimpleQueue()
        for pool in self._pools:
            self._idle.put(pool)

    def submit(self, fn: Callable, /, *args: Any, **kwargs: Any) -> Future:  # noqa: ANN401
        """Run ``fn(*args, **kwargs)`` in a free process, and return the future of its result.

        The call blocks until a process is free. A process that has died is replaced.
        """
        pool = self._idle.get()
        # A new process inherits the mask, so that an interrupt waits until the process can end silently.
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, INTERRUPT)
        try:
            future = pool.submit(fn, *args, **kwargs)
        except BrokenExecutor:
            pool = self._new()
            self._pools.append(pool)
            future = pool.submit(fn, *args, **kwargs)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        future.add_done_callback(lambda _: self._idle.put(pool))
        return future

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        """End the processes; after an interrupt from the keyboard, without waiting for their calls."""
        if kind is not None and issubclass(kind, KeyboardInterrupt):
            _end_children()
        self.shutdown()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes; with ``wait``, return only after their running calls have ended.

        If ``cancel_futures`` is true, calls that have not begun are cancelled.
        """
        for pool in self._pools:
            pool.shutdown(wait, cancel_futures=cancel_futures)


class Cluster(Executor):
    """The workers of a Dask client.

    The executor of Dask waits forever if a worker dies after a call, before its result was fetched, and the
    repetition of this call is lost as well.
    """

    def __init__(self, client: Any) -> None:  # noqa: ANN401
        self._client = client

    def submit(self, fn: Callable, /, *args: Any, **kwargs: Any) -> Future:  # noqa: ANN401
        """Run ``fn(*args, **kwargs)`` in a worker, and return the future of its result."""
        future: Future = Future()
        task = self._client.submit(fn, *args, pure=False, retries=0, **kwargs)
        task.add_done_callback(partial(_pass_on, future))
        return future


def _pass_on(future: Future, task: Any) -> None:  # noqa: ANN401
    """Give the result or the error of a task of Dask to a future."""
    try:
        future.set_result(task.result())
    except Exception as error:  # Dask raises various errors for a worker that died
        future.set_exception(error)


def _end_children() -> None:
    """End all workers of this process and the commands that they run, and return when they have ended."""
    children = active_children()
    for child in children:
        os.kill(child.pid, signal.SIGINT)
    for child in children:
        child.join(AT_LEISURE)
        if child.is_alive():  # it is still starting, or compiled code does not answer
            child.kill()
            child.join()


def _follow_parent() -> None:
    """End this worker process and the command that it runs with the study, or if they are interrupted."""

    def end(*_: object) -> None:
        for group in [*RUNNING]:
            end_group(group)
        os.kill(os.getpid(), signal.SIGKILL)

    def follow() -> None:
        parent_process().join()
        end()

    threading.Thread(target=follow, daemon=True).start()
    signal.signal(
        signal.SIGINT, end
    )  # instead of a traceback: the process of the study reports the interrupt
    signal.pthread_sigmask(signal.SIG_UNBLOCK, INTERRUPT)


def _dask_client(kind: str, count: int, options: Mapping[str, Any], stack: ExitStack) -> Any:  # noqa: ANN401
    """Return the client of a Dask cluster, which is closed together with ``stack``.

    Dask is an optional dependency.
    """
    if kind not in CLUSTERS and "://" not in kind:
        known = f"{PROCESSES}, {', '.join(CLUSTERS)}, or the address of a Dask scheduler, tcp://HOST:PORT"
        raise _error("executor", repr(kind), known, "Correct simulations.executor.")
    if kind == "slurm" and shutil.which("sbatch") is None:
        change = "Run this where jobs are submitted, or choose another simulations.executor."
        raise _error(repr(kind), "no program sbatch", "Slurm", change)
    package, class_name = CLUSTERS.get(kind, ("distributed", "Client"))
    try:
        dask, made = importlib.import_module("dask"), getattr(importlib.import_module(package), class_name)
        from distributed import Client
    except ImportError as error:
        change = "Install the extra: pip install 'accelerated-evaluation[cluster]'."
        raise _error(repr(kind), f"no package {error.name}", "Dask", change) from error
    # `SlowVehicle` sends the encounters of a batch again itself, one by one, and counts them.
    stack.enter_context(dask.config.set({"distributed.scheduler.allowed-failures": 0}))
    if kind not in CLUSTERS:
        client = Client(kind, timeout=JOIN, **options)
    else:
        own: dict[str, Any] = {
            "dask": {"n_workers": count, "threads_per_worker": 1, "dashboard_address": None},
            "slurm": {"n_workers": 0, "cores": 1, "processes": 1, "memory": "2 GB"},
        }[kind]
        cluster = stack.enter_context(made(**own | options))
        client = Client(cluster)
        if kind == "slurm":
            _try_submission(cluster.job_script())
            cluster.adapt(minimum=count, maximum=count)  # jobs that end are submitted again
    client.wait_for_workers(1, timeout=JOIN if kind != "slurm" else None)
    return client


def _try_submission(script: str) -> None:
    """Raise InputError if Slurm would refuse a job.

    Slurm checks the job without running it. Without this check, dask-jobqueue would wait forever for a job
    that is refused.
    """
    done = subprocess.run(
        ["sbatch", "--test-only"], input=script, text=True, capture_output=True, check=False
    )
    if done.returncode:
        change = "Correct simulations.options; they are arguments of dask_jobqueue.SLURMCluster."
        seen = " ".join(done.stderr.split())
        raise _error("'slurm'", seen, "a job that Slurm accepts", change)


def _error(where: str, seen: str, expected: str, change: str) -> InputError:
    return InputError(f"simulations, {where}", seen=seen, expected=expected, change=change)


@cache
def _loaded(description: str) -> CheckedVehicle:
    """Load a vehicle once in each worker, given name, scenario and parameters as JSON.

    The vehicle does not repeat encounters itself, because the process that distributes the batches does this.
    """
    name, scenario, parameters = json.loads(description)
    vehicle = load_vehicle(name, SCENARIOS[scenario], **parameters)
    vehicle.was_repeated = True
    return vehicle


@contextmanager
def printed_to(file: TextIO, *streams: int) -> Iterator[None]:
    """Redirect what is printed, also by compiled code, to a file; stream 1 is the output, 2 the errors."""
    kept = [os.dup(stream) for stream in streams]
    flush_all = ctypes.CDLL(None).fflush  # compiled code buffers its output and prints it later
    flush_all(None)
    try:
        with ExitStack() as redirected:
            for stream in streams:
                os.dup2(file.fileno(), stream)
                redirected.enter_context({1: redirect_stdout, 2: redirect_stderr}[stream](file))
            yield
    finally:
        flush_all(None)
        for stream, copy in zip(streams, kept, strict=True):
            os.dup2(copy, stream)
            os.close(copy)


@dataclass(frozen=True)
class Elsewhere:
    """A copy of a user's vehicle in another process."""

    name: str
    parameters: Mapping[str, Any]
    scenario: Scenario
    executor: Executor = field(repr=False)  # with the other process, which loads the vehicle itself

    def __call__(self, encounters: Array) -> Any:  # noqa: ANN401
        """Return the outcomes of encounters, shape (d, n), which are simulated in reverse order."""
        work = self.name, dict(self.parameters), encounters[:, ::-1], TIME_LIMIT, self.scenario.name
        try:
            outcomes = self.executor.submit(simulate_batch, *work).result()
        except StudyError:
            raise
        except Exception as error:  # executors raise various errors for a process that died
            shown = self.scenario.described_batch(encounters)
            seen = f"in another process, {error_in_words(error)}"
            raise outcome_error(self.name, shown, seen, "outcomes", "Correct the vehicle.") from error
        return self.scenario.outcomes_of(outcomes[:, ::-1])


def difference_elsewhere(vehicle: Any, encounters: Array, outcomes: Any, event: Event) -> InputError | None:  # noqa: ANN401
    """Simulate runs of an estimate again in another process, and return the error of the first difference.

    The last runs with the event and the last runs without it are repeated one by one. If the vehicle is not
    stored, because it is fast, all runs are repeated once more in one batch. The result is None without a
    difference, for outcomes that are stated to be random, and for vehicles of the project, which have no
    method ``repeat``.
    """
    if not hasattr(vehicle, "repeat") or vehicle.deterministic is False or not encounters.shape[1]:
        return None
    happened = event.happens(outcomes)
    alone = [row for kind in (happened, ~happened) for row in np.flatnonzero(kind)[: -COMPARED - 1 : -1]]
    batches = [np.array([row]) for row in alone]
    if isinstance(vehicle, CheckedVehicle):
        batches.append(np.arange(len(happened)))
    for rows in batches:
        again = vehicle.repeat(*encounters[:, rows])
        found = difference_in(again, rows, encounters, outcomes, vehicle.name, vehicle.scenario)
        if found is not None:
            return found
    return None
