"""A slow vehicle: outcomes are stored, and batches of new encounters are simulated by several workers."""

import math
import time
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Mapping, Sequence
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
from accelerated_evaluation.scenarios.outcomes import have_failed
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.external.checked import after_repetition
from accelerated_evaluation.vehicles.external.store import Encounter, Outcome, Request, Store
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
    workers=integer(
        2,
        1,
        10_000,
        "Number of batches that run at the same time. With many workers, `estimate` begins further batches "
        "while others are pending, so its runs depend on this number.",
    ),
    retries=integer(
        2,
        0,
        1_000,
        "How often an encounter is simulated again, in another worker if there is one, after its run was "
        "lost, because the program or the worker ended, took too long, or failed. `estimate` then sets a few "
        "such runs aside, and says what they can change.",
    ),
    options=mapping(
        {}, "Arguments of distributed.LocalCluster, dask_jobqueue.SLURMCluster or distributed.Client."
    ),
)
AT_ONCE = 50_000  # number of encounters that are looked up together, which limits the memory
PENDING = 2  # number of encounters for each worker that may be begun, so that none waits for the others
# Largest number of failed runs that an estimate sets aside: a few, and a share of the runs that succeed. With
# more, the vehicle is at fault.
MOST_FAILED, MOST_FAILED_SHARE = 2, 0.1


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


@dataclass(frozen=True)
class Part:
    """Requests that one worker simulates together."""

    requests: Sequence[Request]
    executor: Executor


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
    scenario: Scenario = field(repr=False)
    # Largest number of encounters in a batch. A request is divided evenly among the workers if this makes the
    # batches smaller.
    batch_size: int = field(default=100, repr=False)
    time_limit: float = field(default=600.0, repr=False)  # longest time for a batch [s]
    retries: int = field(default=2, repr=False)  # how often an encounter whose run was lost is sent again
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
    # Whether runs that fail again and again are set aside, up to `MOST_FAILED` and `MOST_FAILED_SHARE`. Their
    # outcomes are then those of `have_failed`. Otherwise the first of them is an error.
    sets_aside: bool = field(default=False, repr=False)

    def __post_init__(self) -> None:
        if self.deterministic is None and self.store.verdict is False:
            self.deterministic = False
        needed = [each for each in self.scenario.outcomes if not (each.is_flag or each.optional)]
        self.sets_aside &= bool(needed)  # otherwise no outcome says that a run has failed
        self.failed: dict[Request, InputError] = {}  # the runs that were set aside
        self._asked, self._without = 0, 0  # runs that `simulate` has returned, and those that have failed
        self._handed_out: Counter[Encounter] = Counter()
        # Numbers of the requests that `begin` has sent, until `simulate` or `repeat` takes them.
        self._begun: dict[Encounter, list[int]] = defaultdict(list)
        self._open: set[Request] = set()  # requests that wait or run
        self._waiting: deque[Part] = deque()
        self._running: dict[Future, tuple[Part, float]] = {}
        self._failures: Counter[Request] = Counter()
        self._fault: InputError | None = None
        self._moving: dict[Request, Outcome] = {}  # outcomes that are not stored

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
        rows = map(tuple, np.hstack([encounters.T, speeds]).tolist())
        requests = [(row, number) for number, row in enumerate(rows)]
        self._queue(requests, self.workers.executor)
        self._wait_for(requests)
        return self._outcomes_of(
            requests, {each: self._moving.pop(each) for each in requests if each in self._moving}
        )

    def begin(self, *columns: ArrayLike, again: bool = False) -> None:
        """Begin to simulate n encounters, without waiting for their outcomes.

        `simulate` returns the outcomes later, or `repeat` if the encounters are simulated ``again``. Workers
        are given new encounters during these calls.
        """
        encounters = self.scenario.checked(*columns)
        is_new = again or self.deterministic is False
        requests = [self._new_request(each, again=is_new) for each in zip(*encounters.tolist(), strict=True)]
        for encounter, count in requests:
            self._begun[encounter].append(count)
        self._send(requests, self.workers.others if again else self.workers.executor)

    def _checked(self, encounters: Array) -> Any:  # noqa: ANN401
        """Return the outcomes of encounters, shape (d, n); test once whether the vehicle is deterministic."""
        outcomes = self._looked_up(encounters, again=self.deterministic is False)
        self._limit(int(have_failed(outcomes).sum()), encounters.shape[1])
        is_open = self.deterministic is not False and self.store.verdict is None
        if self.is_tested and encounters.shape[1] and is_open:
            own = encounters, outcomes, self.title, self.scenario
            self.deterministic = after_repetition(self._again, *own, declared=self.deterministic)
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
        requests, new = [], []
        for encounter in zip(*encounters.tolist(), strict=True):
            if begun := self._begun.get(encounter):
                requests.append((encounter, begun.pop(0)))
            else:
                requests.append(self._new_request(encounter, again=again))
                new.append(requests[-1])
        self._send(new, self.workers.others if elsewhere else self.workers.executor, first=True)
        self._wait_for(requests)
        return self._outcomes_of(requests, self.store.known(dict.fromkeys(requests)))

    def _outcomes_of(self, requests: Sequence[Request], known: Mapping[Request, Outcome]) -> Any:  # noqa: ANN401
        """Return the outcomes of requests; those of failed runs are NaN."""
        m = len(self.scenario.outcomes)
        rows = np.array([known.get(request, (math.nan,) * m) for request in requests])
        return self.scenario.outcomes_of(rows.reshape(-1, m).T)

    def _new_request(self, encounter: Encounter, *, again: bool) -> Request:
        """Return a request; with ``again``, its number is that of earlier requests for this encounter."""
        number = self._handed_out[encounter] if again else 0
        self._handed_out[encounter] = max(self._handed_out[encounter], number + 1)
        return encounter, number

    def _limit(self, failed: int, asked: int) -> None:
        """Count failed runs, and raise the last error if there are too many."""
        self._asked, self._without = self._asked + asked, self._without + failed
        if failed and self._without > MOST_FAILED + MOST_FAILED_SHARE * (self._asked - self._without):
            last = next(reversed(self.failed.values()))
            raise self._with_kept(last, f"; {self._without} of {self._asked} runs have failed")

    # ---- runs on workers

    def _send(self, requests: Iterable[Request], executor: Executor, *, first: bool = False) -> None:
        """Queue those requests whose outcomes are not known."""
        known = self.store.known(requests := dict.fromkeys(requests))
        self.found += len(known)
        settled = known.keys() | self._open | self.failed.keys()
        self._queue([each for each in requests if each not in settled], executor, first=first)

    def _queue(self, requests: Sequence[Request], executor: Executor, *, first: bool = False) -> None:
        """Divide requests into batches, and queue them behind all others, or ``first``."""
        size = min(self.batch_size, math.ceil(len(requests) / self.workers.count)) or 1
        parts = [Part(requests[k : k + size], executor) for k in range(0, len(requests), size)]
        self._open.update(requests)
        self._waiting = deque([*parts, *self._waiting] if first else [*self._waiting, *parts])

    def _wait_for(self, requests: Sequence[Request]) -> None:
        """Wait until the runs of requests have ended, and give waiting runs to the workers that are free.

        After a fault of the vehicle, no new batch is started, but the outcomes of running batches are stored.
        """
        missing = self._open.intersection(requests)
        with tqdm(desc=self.title, total=len(missing), delay=5, disable=None, leave=False) as progress:
            while self._running if self._fault else missing:
                ended = missing.intersection(self._ended())
                missing -= ended
                progress.update(len(ended))
        if (fault := self._fault) is not None:
            self._fault = None
            for state in (self._open, self._waiting, self._failures, self._begun):
                state.clear()
            raise self._with_kept(fault)

    def _ended(self) -> list[Request]:
        """Keep the workers busy, wait until a batch ends, and return the requests that are settled.

        A node that is lost or a program that fails is not necessarily a fault of the vehicle. The encounters
        of a batch without outcomes are therefore sent again one by one, each up to ``retries`` times.
        """
        while self._waiting and self._fault is None and len(self._running) < self.workers.count:
            part = self._waiting.popleft()
            self._running[self._submit(part)] = part, time.monotonic()
        settled: list[Request] = []
        for future in wait(self._running, return_when=FIRST_COMPLETED).done:
            part, begun = self._running.pop(future)
            try:
                outcomes = future.result()
            except Exception as error:  # executors raise various errors for a worker that died
                if not self._is_fault(part, error, time.monotonic() - begun):
                    self.lost += 1
                    alone = [Part([request], part.executor) for request in part.requests]
                    self._waiting = deque([*alone, *self._waiting])
                    continue
            else:
                self._keep(part.requests, outcomes)
            settled += part.requests
        self._open.difference_update(settled)
        return settled

    def _is_fault(self, part: Part, error: Exception, seconds: float) -> bool:
        """Return whether a batch without outcomes is a fault of the vehicle, which is then noted."""
        requests = part.requests
        self._failures.update(requests)
        is_divided = self.sets_aside and len(requests) > 1
        if is_divided or max(self._failures[each] for each in requests) <= self.retries:
            return False
        fault = self._batch_error(error, [encounter for encounter, _ in requests], seconds)
        if self.sets_aside:
            self.failed[requests[0]] = fault
        else:
            self._fault = self._fault or fault
        return True

    def _keep(self, requests: Sequence[Request], outcomes: Array) -> None:
        """Store the outcomes of requests, shape (m, n); those with lead speeds over time are not stored."""
        rows = list(zip(*outcomes.tolist(), strict=True))
        self.simulated += len(rows)
        if len(requests[0][0]) == self.scenario.dimension:
            self.store.add(requests, rows)
        else:
            self._moving |= zip(requests, rows, strict=True)

    def _submit(self, part: Part) -> Future:
        return part.executor.submit(
            simulate_batch,
            self.name,
            dict(self.parameters),
            np.array([encounter for encounter, _ in part.requests]).T,
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

    def _with_kept(self, fault: InputError, more: str = "") -> InputError:
        kept = f"{fault.change} {len(self.store):,} outcomes are kept in {self.store.path}."
        return InputError(fault.where, seen=f"{fault.seen}{more}", expected=fault.expected, change=kept)
