"""The loop that runs the batches of a sampler, and the estimate for any function."""

import math
import os
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from inspect import signature
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from fewruns.arguments import is_whole
from fewruns.arrays import Array, Flags
from fewruns.constants import ENOUGH_DRAWS, ENOUGH_REPEATS, FIRST_REPEATS
from fewruns.errors import InputError, require
from fewruns.estimates import Estimate, Stopping
from fewruns.problems import Marginal, Response, Runnable, ScoreProblem, SystemProblem
from fewruns.repeats import RepeatBatch
from fewruns.results import with_inputs
from fewruns.sampler import Sampler
from fewruns.state import read_state, write_state

GOAL = Stopping(maximum_simulations=1000)

# Names of the arguments of `Sampler` that may be passed to `estimate`.
SETTINGS = sorted(
    {*signature(Sampler).parameters} - {"dimension", "generator", "fingerprint", "deterministic"}
)


def run_batches(
    sampler: Sampler,
    problem: Runnable,
    stopping: Stopping,
    is_enough: Callable[[], bool] | None = None,
    ahead: int = 1,
) -> Iterator[None]:
    """Run batches of a problem until the estimate has converged; yield after each batch.

    The runs also end at the largest number of simulations, and if the system drifts, so that its early and
    late runs differ. A system that may lapse (behave differently in a few of its runs) uses all simulations.

    With ``ahead``, further batches are begun while others are pending, so that many workers are busy. The
    outcomes of batches are received in the order in which the batches were designed, one at a time, and a new
    batch is designed only then. The estimate therefore depends on ``ahead``, but not on which runs end first.

    Parameters
    ----------
    sampler, problem, stopping
        The sampler, which may already have runs, the problem, and the stopping rule.
    is_enough
        Function without arguments that returns whether the estimate is precise enough; by default whether the
        interval is as narrow as ``stopping`` requires. The sampler then continues only until parts of the
        event that no run has met are excluded.
    ahead
        Number of runs that may be pending at a time, rounded up to whole batches. If the problem has a method
        ``begin``, it receives the normal scores of each batch when the batch is designed, and whether they
        are repetitions. It starts the runs without waiting for them; ``evaluate`` or ``repeat`` waits later.

    Examples
    --------
    >>> import numpy as np
    >>> from fewruns import Sampler, Stopping, SystemProblem, run_batches
    >>> goal = Stopping(maximum_simulations=300)
    >>> problem = SystemProblem(lambda z: (z[:, 0] > 4, 4 - z[:, 0]), 2)
    >>> sampler = Sampler(2, np.random.default_rng(1))
    >>> for _ in run_batches(sampler, problem, goal):
    ...     if sampler.simulations == 100:
    ...         early = sampler.estimate(goal)
    >>> sampler.estimate(goal).converged
    True
    """
    is_enough = partial(sampler.is_narrow, stopping) if is_enough is None else is_enough
    repeat, begin = getattr(problem, "repeat", problem.evaluate), getattr(problem, "begin", lambda *_: None)
    begun = 0
    while not sampler.has_ended(is_narrow=(enough := is_enough())):
        progress = sampler.progress
        missing = ahead - len(sampler.outstanding)
        if missing > 0 and progress.next_number + sampler.batch_size <= stopping.maximum_simulations:
            sampler.ask(missing, certify=enough)
        if not progress.asked:
            break
        z = sampler.ask()  # all pending runs, with the rest of the last batch
        for each in progress.asked:
            if ahead > 1 and each.first >= begun:
                begin(each.batch.z, isinstance(each.batch, RepeatBatch))
        begun, first = progress.next_number, progress.asked[0].outstanding
        evaluate = repeat if sampler.repeats_next else problem.evaluate
        happened, score, *failed = evaluate(z[: len(first)])
        sampler.tell(happened, score, runs=first, failed=failed[0] if failed else None)
        yield


def estimate(
    function: Callable[[Array], Flags | Response],
    inputs: int | Sequence[Marginal],
    generator: np.random.Generator | int,
    *,
    stopping: Stopping = GOAL,
    deterministic: bool | None = None,
    fingerprint: str = "",
    state_file: str | os.PathLike | None = None,
    on_batch: Callable[[Estimate], None] | None = None,
    **settings: Any,  # noqa: ANN401
) -> Estimate:
    """Return the probability of an event of a function with independent random inputs, from few calls.

    Parameters
    ----------
    function
        Function of n points, shape (n, d), that returns whether the event happens, as n booleans, or a pair
        of these and n scores, which are smaller the closer a point is to the event.
    inputs
        Distributions of the d inputs, for example frozen distributions of `scipy.stats` or its newer
        `scipy.stats.Normal`; or the number d of standard normal inputs.
    generator
        Source of all randomness, or its seed. If a saved state is resumed, its own generator is used instead.
    stopping
        The stopping rule. By default, the half-width of the 80 % interval is at most a fifth of the estimate,
        and there are at most 1,000 points.
    deterministic
        Whether the function always returns the same for the same point. If this is not known (None), five
        points are evaluated twice.
    fingerprint
        A text that identifies the function and its inputs in the saved state, which cannot tell otherwise
        that it belongs to another function.
    state_file
        File in which the state is saved after every batch. If it exists, the runs are continued.
    on_batch
        Function that is called with the estimate after every batch.
    **settings
        Further arguments of `Sampler`, such as ``batch_size``, ``certificate`` or ``upper_set``. With more
        than six inputs, or more than two and flags alone, one of the last two is needed for convergence.

    Raises
    ------
    InputError
        If an argument cannot be used, if the function does not return booleans, or if the state file has no
        fingerprint, cannot be written, is damaged, or belongs to another problem.

    Examples
    --------
    >>> import numpy as np
    >>> import fewruns
    >>> from scipy import stats
    >>> def overload(x):  # resistance minus load
    ...     margin = x[:, 0] - x[:, 1]
    ...     return margin <= 0, margin
    >>> inputs = [stats.norm(7.0, 1.0), stats.norm(1.0, 0.75)]
    >>> found = fewruns.estimate(overload, inputs, np.random.default_rng(1))
    >>> exact = stats.norm.sf((7.0 - 1.0) / np.hypot(1.0, 0.75))
    >>> found.converged, found.simulations < 200, bool(0.7 < found.probability / exact < 1.4)
    (True, True, True)
    """
    dimension, marginals = _dimension_of(inputs)
    source: Any = np.random.Generator(np.random.PCG64(generator)) if is_whole(generator, 0) else generator
    require("function", function, "a function of points, shape (n, d)", fits=callable(function))
    is_generator = isinstance(source, np.random.Generator)
    require("generator", source, "a numpy.random.Generator or a seed", fits=is_generator)
    is_rule = isinstance(stopping, Stopping)
    require("stopping", stopping, "a rule such as Stopping(maximum_simulations=500)", fits=is_rule)
    is_usable = on_batch is None or callable(on_batch)
    require("on_batch", on_batch, "a function of an estimate, or None", fits=is_usable)
    for name in settings:
        if name not in SETTINGS:
            expected = f"one of {', '.join(SETTINGS)}"
            change = "Correct the name. Limits belong to stopping=Stopping(maximum_simulations=500)."
            raise InputError(name, seen="an unknown argument", expected=expected, change=change)
    expected = "a text that identifies the function and its inputs, because a state is saved"
    change = "State one, such as fingerprint='overload, normal inputs', and change it with the function."
    require("fingerprint", fingerprint, expected, fits=bool(state_file is None or fingerprint), change=change)
    problem = SystemProblem(partial(_answer, function), dimension, marginals, fingerprint, deterministic)
    return estimate_problem(problem, source, stopping, state_file, on_batch, **settings)


def estimate_problem(
    problem: ScoreProblem,
    generator: np.random.Generator,
    stopping: Stopping,
    state_file: str | os.PathLike | None = None,
    on_batch: Callable[[Estimate], None] | None = None,
    **settings: Any,  # noqa: ANN401
) -> Estimate:
    """Return the probability of the event of a problem; the arguments are those of `estimate`."""
    if state_file is not None and (Path(state_file).is_dir() or not Path(state_file).parent.is_dir()):
        expected, change = "a file in an existing folder", "Make the folder, or name another file."
        raise InputError("state_file", seen=repr(str(state_file)), expected=expected, change=change)
    sampler = sampler_for(problem, generator, state_file, **settings)
    for _ in run_batches(sampler, problem, stopping):
        if state_file is not None:
            write_state(state_file, sampler)
        if on_batch is not None:
            on_batch(with_inputs(sampler.estimate(stopping), problem))
    return with_inputs(sampler.estimate(stopping), problem)


def sampler_for(
    problem: ScoreProblem,
    generator: np.random.Generator,
    state_file: str | os.PathLike | None = None,
    **settings: Any,  # noqa: ANN401
) -> Sampler:
    """Return the sampler that is saved in a state file, or a new one for a problem if there is no such file.

    A `SystemProblem` is a formula in most cases, so neither rare lapses nor thin stripes are looked for.
    """
    is_formula = isinstance(problem, SystemProblem)
    own: dict[str, Any] = {"fingerprint": problem.fingerprint, "dimension": problem.dimension}
    own["deterministic"] = settings.pop("deterministic", getattr(problem, "deterministic", None))
    if state_file is not None and Path(state_file).exists():
        size = {name: settings[name] for name in ("batch_size",) if name in settings}
        sampler = read_state(state_file, **own, **size)
        sampler.certificate = settings.get("certificate", sampler.certificate)
        return sampler
    checks: dict[str, Any] = {
        "enough_repeats": FIRST_REPEATS if is_formula else ENOUGH_REPEATS,
        "enough_draws": 0 if is_formula else ENOUGH_DRAWS,
        "upper_set": getattr(problem, "upper_set", False),
    }
    return Sampler(generator=generator, **own, **(checks | settings))


def _answer(function: Callable[[Array], Flags | Response], x: Array) -> Response:
    """Return the flags and the scores of a function at points; scores are None if it returns only flags."""
    answer = function(x)
    if not isinstance(answer, tuple):
        return answer, None
    if len(answer) != 2:
        expected, change = "booleans, or a pair of booleans and scores", "Return `margin <= 0, margin`."
        raise InputError("the function", seen=f"{len(answer)} values", expected=expected, change=change)
    return answer


def _dimension_of(inputs: int | Sequence[Marginal]) -> tuple[int, Sequence[Marginal] | None]:
    """Return the number of inputs, and their distributions if they are stated."""
    if is_whole(inputs, -math.inf):
        return int(inputs), None
    unknown: object = inputs
    if isinstance(inputs, Sequence):
        laws = [_with_usual_names(law) for law in inputs]
        # A distribution of SciPy that still needs parameters has the number of them, numargs.
        unknown = [law for law in laws if not {"ppf", "isf"} <= {*dir(law)} or getattr(law, "numargs", 0) > 0]
        if not unknown:
            return len(laws), laws
    expected = "a number of inputs, or frozen distributions with the methods ppf and isf (or icdf, iccdf)"
    raise InputError("inputs", seen=f"{unknown!r:.80}", expected=expected, change="Correct the argument.")


def _with_usual_names(law: Any) -> Any:  # noqa: ANN401
    """Return a distribution with the methods ppf and isf, which SciPy's newer classes name differently."""
    return SimpleNamespace(ppf=law.icdf, isf=law.iccdf) if hasattr(law, "iccdf") else law
