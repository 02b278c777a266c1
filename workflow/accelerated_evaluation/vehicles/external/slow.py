"""A slow vehicle: outcomes are stored, and batches of new encounters are simulated by several workers."""

import math
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from tqdm import tqdm

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.sections import default_of, flag, integer, mapping, number, section, text
from accelerated_evaluation.base.users_code import error_in_words
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.external.checked import after_repetition
from accelerated_evaluation.vehicles.external.store import Encounter, Request, Store
from accelerated_evaluation.vehicles.external.workers import PROCESSES, Workers, simulate_batch
from accelerated_evaluation.vehicles.moving import checked_lead_speeds, motion_error
from accelerated_evaluation.vehicles.protocol import outcome_error

SECTION = section(
    slow=flag(
        False,
        "Whether the vehicle under test is too slow for crash maps and crude Monte Carlo. The study then "
        "simulates it about 100 to 300 times (more if surrogate.maximum_calls allows it and the estimate has "
        "not converged), and replays 100 to 140 records. Its book contains the chapters that need no further "
        "simulations. Outcomes of a Python class are then stored, as with keep_class.",
    ),
    keep_class=flag(
        False,
        "Whether `accelerated-evaluation estimate` stores the outcomes of a Python class and runs its "
        "batches on workers, as it does for commands and FMUs.",
    ),
    batch_size=integer(100, 1, 1_000_000, "Largest number of encounters in one batch of a slow vehicle."),
    time_limit=number(600, 0, 1_000_000, "Longest time for a batch [s].", exclusive=True),
    executor=text(
        PROCESSES,
        "Where batches run: processes of this machine, a dask cluster on it, a slurm cluster by Dask, or the "
        "address of a Dask scheduler, tcp://HOST:PORT.",
    ),
    workers=integer(2, 1, 10_000, "Number of batches that run at the same time."),
    retries=integer(
        2,
        0,
        1_000,
        "How often an encounter is simulated again, in another worker if there is one, after its run was "
        "lost, because the program or the worker ended, took too long, or failed.",
    ),
    options=mapping(
        {}, "Arguments of distributed.LocalCluster, dask_jobqueue.SLURMCluster or distributed.Client."
    ),
)
AT_ONCE = 50_000  # number of encounters that are looked up together, which limits the memory


@dataclass(frozen=True)
class SimulationSettings:
    """How slow vehicles are simulated: the keys of `SECTION`, which describes them."""

    slow: bool
    keep_class: bool
    batch_size: int
    time_limit: float
    executor: str
    workers: int
    retries: int
    options: Mapping[str, Any]

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Self:
        """Return the settings of a section, with defaults for the keys that are not given."""
        return cls(**default_of(SECTION) | dict(given))


@dataclass
class SlowVehicle:
    """A vehicle whose encounters are simulated only once, in batches, by workers.

    If the outcomes are random, an encounter is simulated every time it is requested.
    """

    name: str  # as for `load_vehicle`; each worker loads the vehicle itself
    parameters: Mapping[str, Any]
    title: str  # name of the vehicle in messages
    store: Store = field(repr=False)
    workers: Workers = field(repr=False)
    # Largest number of encounters in a batch. A request is divided evenly among the workers if this makes the
    # batches smaller.
    batch_size: int = field(default=100, repr=False)
    time_limit: float = field(default=600.0, repr=False)  # longest time for a batch [s]
    retries: int = field(default=2, repr=False)  # how often an encounter whose run was lost is sent again
    scenario: Scenario = field(default=CUT_IN, repr=False)
    # None if this is unknown and has to be tested.
    deterministic: bool | None = field(default=None, repr=False)
    # Whether the vehicle can be simulated with given lead speeds over time.
    takes_motion: bool = field(default=False, repr=False)
    # Encounters that this object has simulated, with repetitions that test whether the vehicle is
    # deterministic.
    simulated: int = field(default=0, repr=False)
    found: int = field(default=0, repr=False)  # encounters that were found in the store
    lost: int = field(default=0, repr=False)  # batches that were lost and sent again
    # Whether some encounters are simulated again, to find out whether the vehicle is deterministic.
    is_tested: bool = field(default=True, repr=False)
    _handed_out: Counter = field(default_factory=Counter, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.deterministic is None and self.store.verdict is False:
            self.deterministic = False

    def simulate(self, *columns: ArrayLike) -> Any:  # noqa: ANN401
        """Return the outcomes of n encounters; encounters that are not in the store are simulated.

        InputError is raised if the encounters are not valid, if the vehicle fails, takes too long, ends its
        worker or returns invalid outcomes, or if repeated encounters have other outcomes although the vehicle
        is stated to be deterministic. The outcomes of other batches remain in the store.
        """
        encounters = self.scenario.checked(*columns)
        starts = range(0, max(encounters.shape[1], 1), AT_ONCE)
        parts = [self._checked(encounters[:, start : start + AT_ONCE]) for start in starts]
        pairs = zip(*(vars(part).values() for part in parts), strict=True)
        return self.scenario.outcome_type(*(np.concatenate(column) for column in pairs))

    def repeat(self, *columns: ArrayLike) -> Any:  # noqa: ANN401
        """Simulate n encounters again, even if they are in the store, and return the new outcomes.

        The arguments and errors are those of `simulate`.
        """
        return self._again(self.scenario.checked(*columns))

    def simulate_moving(
        self, lead_speed: ArrayLike, range_: ArrayLike, closing_speed: ArrayLike, lead_speeds: ArrayLike
    ) -> Any:  # noqa: ANN401
        """Return the outcomes of n cut-ins with lead speeds [m/s] at 0, 0.1, ... s, (n, at least 81).

        They are not stored, because the same lead motion is hardly ever drawn twice. InputError is raised as
        in `simulate` and in `CheckedVehicle.simulate_moving`.
        """
        if not self.takes_motion:
            raise motion_error(self.title)
        encounters = self.scenario.checked(lead_speed, range_, closing_speed)
        speeds = checked_lead_speeds(lead_speeds, encounters[0])
        rows = list(map(tuple, np.hstack([encounters.T, speeds]).tolist()))
        outcomes = np.empty((len(self.scenario.outcomes), len(rows)))
        for first, found in self._simulated(rows, self.workers.executor):
            outcomes[:, first : first + found.shape[1]] = found
        return self.scenario.outcomes_of(outcomes)

    def _checked(self, encounters: Array) -> Any:  # noqa: ANN401
        """Return the outcomes of encounters, shape (d, n); test once whether the vehicle is deterministic."""
        outcomes = self._looked_up(encounters, again=self.deterministic is False)
        is_open = self.deterministic is not False and self.store.verdict is None
        if self.is_tested and encounters.shape[1] and is_open:
            self.deterministic = after_repetition(
                self._again,
                encounters,
                outcomes,
                self.title,
                declared=self.deterministic,
                scenario=self.scenario,
            )
            self.store.set_verdict(deterministic=self.deterministic is not False)
        return outcomes

    def _again(self, encounters: Array) -> Any:  # noqa: ANN401
        """Return new outcomes of encounters, shape (d, n), from other processes and in reverse order."""
        outcomes = self._looked_up(encounters[:, ::-1], again=True, elsewhere=True)
        return self.scenario.outcome_type(*(values[::-1] for values in vars(outcomes).values()))

    def _looked_up(self, encounters: Array, *, again: bool, elsewhere: bool = False) -> Any:  # noqa: ANN401
        """Return the outcomes of encounters, shape (d, n), from the store or, if necessary, by simulation.

        With ``again``, each request for an encounter gets an outcome of its own, as for random outcomes. With
        ``elsewhere``, other processes than usual simulate the encounters.
        """
        keys: list[Encounter] = list(zip(*encounters.tolist(), strict=True))
        requests: list[Request] = [(key, self._next_number(key) if again else 0) for key in keys]
        if not again:
            self._handed_out |= Counter(dict.fromkeys(keys, 1))
        known = self.store.known(dict.fromkeys(requests))
        missing = [request for request in dict.fromkeys(requests) if request not in known]
        self.found += len(known)
        executor = self.workers.others if elsewhere else self.workers.executor
        for first, outcomes in self._simulated([encounter for encounter, _ in missing], executor):
            rows = list(zip(*outcomes.tolist(), strict=True))
            batch = missing[first : first + len(rows)]
            self.store.add(batch, rows)
            known |= zip(batch, rows, strict=True)
        rows = np.array([known[request] for request in requests])
        return self.scenario.outcomes_of(rows.reshape(-1, len(self.scenario.outcomes)).T)

    def _next_number(self, encounter: Encounter) -> int:
        """Return the number of earlier requests for an encounter to this object, and count this request."""
        self._handed_out[encounter] += 1
        return self._handed_out[encounter] - 1

    def _simulated(self, encounters: Sequence[Encounter], executor: Executor) -> Iterator[tuple[int, Array]]:
        """Simulate encounters in batches by an executor, and yield the outcomes of each batch.

        Each item is the index of the first encounter of the batch, and the outcomes, shape (m, size of the
        batch). Batches are yielded in the order in which they end.

        A node that is lost or a program that fails is not necessarily a fault of the vehicle. The encounters
        of a batch without outcomes are therefore sent again one by one, each up to ``retries`` times. If an
        encounter fails once more, no new batch is started, but the outcomes of running batches are still
        yielded, so that they are stored.
        """
        size = min(self.batch_size, math.ceil(len(encounters) / self.workers.count)) or 1
        waiting = [slice(k, k + size) for k in range(0, len(encounters), size)][::-1]
        running: dict[Future, tuple[slice, float]] = {}
        failures: Counter[int] = Counter()  # of each encounter
        fault: InputError | None = None
        progress = tqdm(desc=self.title, total=len(encounters), delay=5, disable=None, leave=False)
        with progress:
            while running or (waiting and fault is None):
                while waiting and fault is None and len(running) < self.workers.count:
                    rows = waiting.pop()
                    running[self._submit(encounters[rows], executor)] = rows, time.monotonic()
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    rows, begun = running.pop(future)
                    try:
                        outcomes = future.result()
                    except Exception as error:  # executors raise various errors for a worker that died
                        again = range(len(encounters))[rows]
                        failures.update(again)
                        if max(failures[k] for k in again) > self.retries:
                            fault = fault or self._batch_error(
                                error, encounters[rows], time.monotonic() - begun
                            )
                        else:
                            self.lost += 1
                            waiting += [slice(k, k + 1) for k in reversed(again)]
                        continue
                    self.simulated += outcomes.shape[1]
                    progress.update(outcomes.shape[1])
                    yield rows.start, outcomes
        if fault is not None:
            raise self._with_kept(fault)

    def _submit(self, batch: Sequence[Encounter], executor: Executor) -> Future:
        return executor.submit(
            simulate_batch,
            self.name,
            dict(self.parameters),
            np.array(batch).T,
            self.time_limit,
            self.scenario.name,
        )

    def _batch_error(self, error: Exception, batch: Sequence[Encounter], seconds: float) -> InputError:
        """Return the error that describes why a batch failed after a number of seconds."""
        shown = self.scenario.described_batch(np.array(batch).T[: self.scenario.dimension])
        if isinstance(error, InputError):
            where = error.where if shown in error.where else f"{error.where}, {shown}"
            return InputError(where, seen=error.seen, expected=error.expected, change=error.change)
        if seconds >= self.time_limit:
            return outcome_error(
                self.title,
                shown,
                f"no end after {self.time_limit:g} s",
                "outcomes within this time limit of a batch",
                "Make the vehicle faster, raise simulations.time_limit, or lower simulations.batch_size "
                "(--time-limit and --batch-size of the command simulate).",
            )
        died = isinstance(error, BrokenExecutor) or type(error).__name__ == "KilledWorker"
        ends = f"the end of all {self.retries + 1} processes" if self.retries else "the end of the process"
        return outcome_error(
            self.title,
            shown,
            f"{ends} that simulated it" if died else error_in_words(error),
            "outcomes",
            "The vehicle crashes or ends its process, or was killed." if died else "Correct the vehicle.",
        )

    def _with_kept(self, fault: InputError) -> InputError:
        kept = f"{fault.change} {len(self.store):,} outcomes are kept in {self.store.path}."
        return InputError(fault.where, seen=fault.seen, expected=fault.expected, change=kept)
