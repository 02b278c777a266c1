"""The loop that runs the batches of a sampler, and the estimate for any function."""

import math
import os
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np

from fewruns.arguments import is_whole, require
from fewruns.arrays import Array, Flags
from fewruns.constants import ENOUGH_DRAWS, ENOUGH_REPEATS, FIRST_REPEATS
from fewruns.errors import InputError
from fewruns.estimates import Estimate, Stopping
from fewruns.problems import Marginal, Response, ScoreProblem, SystemProblem
from fewruns.sampler import Sampler
from fewruns.state import read_state, write_state

GOAL = Stopping(maximum_simulations=1000)

# Names of the arguments of `Sampler` that may be passed to `estimate`.
SETTINGS = sorted(
    {*signature(Sampler).parameters} - {"dimension", "generator", "fingerprint", "deterministic"}
)


def run_batches(
    sampler: Sampler,
    problem: ScoreProblem,
    stopping: Stopping,
    is_enough: Callable[[], bool] | None = None,
) -> Iterator[None]:
    """Run batches of a problem until the estimate has converged; yield after each batch.

    The runs also end at the largest number of simulations, and if the system drifts, so that its early and
    late runs differ. A system that may lapse (behave differently in a few of its runs) uses all simulations.

    Parameters
    ----------
    sampler, problem, stopping
        The sampler, which may already have runs, the problem, and the stopping rule.
    is_enough
        Function without arguments that returns whether the estimate is precise enough; by default whether the
        interval is as narrow as ``stopping`` requires. The sampler then continues only until parts of the
        event that no run has met are excluded.

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
    repeat = getattr(problem, "repeat", problem.evaluate)
    while not sampler.is_done(stopping, is_narrow=(enough := is_enough())):
        z = sampler.ask(certify=enough)
        sampler.tell(*(repeat(z) if sampler.repeats_next else problem.evaluate(z)))
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
        Distributions of the d inputs, for example frozen distributions of `scipy.stats`; or the number d of
        standard normal inputs.
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
    if is_whole(generator, 0):
        generator = np.random.Generator(np.random.PCG64(generator))
    require("function", function, "a function of points, shape (n, d)", fits=callable(function))
    is_generator = isinstance(generator, np.random.Generator)
    require("generator", generator, "a numpy.random.Generator or a seed", fits=is_generator)
    is_rule = isinstance(stopping, Stopping)
    require("stopping", stopping, "a rule such as Stopping(maximum_simulations=500)", fits=is_rule)
    is_usable = on_batch is None or callable(on_batch)
    require("on_batch", on_batch, "a function of an estimate, or None", fits=is_usable)
    for name in settings:
        if name not in SETTINGS:
            expected = f"one of {', '.join(SETTINGS)}"
            change = (
                "Correct the name. Limits belong to the rule: stopping=Stopping(maximum_simulations=500)."
            )
            raise InputError(name, seen="an unknown argument", expected=expected, change=change)
    if state_file is not None and not fingerprint:
        expected = "a text that identifies the function and its inputs, because a state is saved"
        change = "State one, such as fingerprint='overload, normal inputs', and change it with the function."
        raise InputError("fingerprint", seen="none", expected=expected, change=change)
    problem = SystemProblem(partial(_answer, function), dimension, marginals, fingerprint, deterministic)
    return estimate_problem(problem, generator, stopping, state_file, on_batch, **settings)


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
            on_batch(sampler.estimate(stopping))
    return sampler.estimate(stopping)


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
    own = {"fingerprint": problem.fingerprint, "dimension": problem.dimension}
    own["deterministic"] = settings.pop("deterministic", getattr(problem, "deterministic", None))
    if state_file is not None and Path(state_file).exists():
        size = {name: settings[name] for name in ("batch_size",) if name in settings}
        sampler = read_state(state_file, **own, **size)
        sampler.certificate = settings.get("certificate", sampler.certificate)
        return sampler
    checks = {
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
    if isinstance(inputs, Sequence) and all(hasattr(law, "ppf") and hasattr(law, "isf") for law in inputs):
        return len(inputs), inputs
    expected = "a number of inputs, or a list of distributions with the methods ppf and isf"
    raise InputError("inputs", seen=f"{inputs!r:.80}", expected=expected, change="Correct the argument.")
