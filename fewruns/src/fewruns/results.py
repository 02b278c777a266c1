"""Results of a sampler: the estimate, whether it has converged, and a table of all runs."""

import math
from dataclasses import replace

import numpy as np
from numpy.lib.recfunctions import append_fields
from numpy.typing import NDArray

from fewruns.arrays import Array
from fewruns.combining import Combined, anytime_interval, combine
from fewruns.constants import UNSEEN_ALPHA
from fewruns.estimates import Estimate, Stopping
from fewruns.exclusion import Exclusion
from fewruns.problems import ScoreProblem, SystemProblem
from fewruns.progress import Progress
from fewruns.weights import effective_number
from fewruns.wide_laws import bound_without_event

ROUNDING = 1e-12  # relative tolerance


def estimate(exclusion: Exclusion, batch_size: int, stopping: Stopping, *, converged: bool) -> Estimate:
    """Return the estimated probability of the event, from the batches since the surrogate became usable.

    Without an event the estimate is 0, and the upper end of the interval is the bound for an event that no
    run has met; if all runs are events, the complement is treated like this. Before two batches can be used,
    or if the events are counted, the estimate is the share of events in the draws of the law itself, with its
    interval. The estimate is then NaN if no draw is an event, and the interval is [0, 1] without draws.
    """
    progress, (combined, ends) = exclusion.progress, combined_estimate(exclusion.progress, stopping)
    draws, by_draws, events = progress.law_draws, progress.is_counted, np.count_nonzero(progress.happened)
    if by_draws:
        probability, interval = draws.share, draws.interval(stopping.alpha)
    elif combined is not None:
        # The mean of unbiased estimates of a probability may exceed 1.
        probability = min(combined.probability, 1.0)
        interval = max(min(ends[0] - combined.less, 1.0), 0.0), min(ends[1] + combined.more, 1.0)
    elif 0 < events < progress.happened.size:
        drawn = draws.extended(progress.plain.z, progress.plain.happened)
        probability = drawn.share if drawn.events else math.nan
        interval = drawn.interval(stopping.alpha) if len(drawn) else (0.0, 1.0)
    else:
        bound = bound_without_event(progress.wide_draws[:, 0].sum(), stopping.alpha)
        if len(progress.plain):
            bound = min(bound, 1 - stopping.alpha ** (1 / len(progress.plain)))
        probability, interval = (1.0, (1 - bound, 1.0)) if events else (0.0, (0.0, bound))
    if (by_draws or combined is None) and (failed := progress.failed_draws):
        share = failed / (failed + len(draws) + len(progress.plain))
        interval = interval[0] * (1 - share), interval[1] * (1 - share) + share
    estimating = len(draws) if by_draws else sum(batch.runs for batch in progress.sampled)
    return Estimate(
        probability,
        *interval,
        alpha=stopping.alpha,
        learning=progress.simulations - estimating,
        estimating=estimating,
        events=draws.events if by_draws else int(events),
        converged=converged,
        diagnostics=_diagnostics(exclusion, combined),
        tables={"runs": tabulate_runs(progress, batch_size)},
    )


def with_lapses(found: Estimate, progress: Progress, stopping: Stopping) -> Estimate:
    """Return an estimate whose interval also includes the bound on the probability that lapses can add."""
    if not (bound := progress.unseen_lapses):
        return found
    own = {"unseen_lapses": bound}
    if found.probability > 0:  # draws without an event that would reduce the bound to this share of it
        own["settling_runs"] = -math.log(UNSEEN_ALPHA) / (stopping.beta * found.probability)
    sampled = found.high if found.probability > 0 else 0.0
    return replace(found, high=max(sampled, bound), diagnostics={**found.diagnostics, **own})


def is_narrow(progress: Progress, stopping: Stopping, *, with_failed: bool = False) -> bool:
    """Return whether the interval is as narrow as a stopping rule requires, with enough observed events.

    ``with_failed``, it also contains the answers if all or none of the failed runs are events.
    """
    if progress.is_counted:
        draws = progress.law_draws
        probability, (low, high), events = draws.share, draws.interval(stopping.alpha), draws.events
    else:
        combined, (low, high) = combined_estimate(progress, stopping)
        probability, events = getattr(combined, "probability", 0.0), int(np.count_nonzero(progress.happened))
        if with_failed and combined is not None:
            low, high = low - combined.less, high + combined.more
    enough = probability > 0 and events >= stopping.minimum_events
    return bool(enough and (high - low) / 2 <= stopping.beta * probability * (1 + ROUNDING))


def combined_estimate(progress: Progress, stopping: Stopping) -> tuple[Combined | None, tuple[float, float]]:
    """Return the estimate from the last consistent batches, and its interval; None without an estimate."""
    batches = progress.sampled
    if not progress.happened.any() or len(batches) < 2:
        return None, (0.0, 1.0)
    if stopping.anytime:
        combined, interval = anytime_interval(batches, stopping.alpha, stopping.beta)
    else:
        combined = combine(batches)
        interval = combined.interval(stopping.alpha) if combined.probability > 0 else (0.0, 1.0)
    usable = combined.probability > 0 and interval[1] > interval[0]
    return (combined, interval) if usable else (None, (0.0, 1.0))


def event_ratios(progress: Progress) -> Array:
    """Return the importance ratios of the events in the stored batches of the estimate, shape (events,).

    Up to a common factor, they are the weights of these runs in the estimate without a control variate.
    """
    ratios = [estimate.importance * batch.weight / batch.inclusion for estimate, batch in progress.stored]
    joined = np.concatenate([np.empty(0), *ratios])
    return joined[progress.happened[len(progress.z) - len(joined) :] & (joined > 0)]


def tabulate_runs(progress: Progress, batch_size: int) -> NDArray[np.void]:
    """Return all simulations: ``run`` and ``batch`` from 1, ``phase``, ``z_1`` ..., ``event``, ``score``.

    The scores are 0 if the system has none, and NaN for draws of the law and for failed runs.
    """
    run = np.arange(len(progress.z)) + 1
    # The sizes of the batches before a sampler was rebuilt are not known.
    batch = np.repeat(np.arange(len(progress.sizes)), progress.sizes)
    earlier = np.arange(len(run) - len(batch)) // batch_size
    batch = np.append(earlier, batch + len(np.unique(earlier))) + 1
    batches = int(batch.max(initial=0))
    searched = batches - len(progress.estimates)
    learnt = batches - len(progress.consistent)
    weight = np.concatenate([np.empty(0), *(each.weight for each in progress.batches)])
    is_of_cover = np.append(np.zeros(len(run) - len(weight), bool), weight == 0)
    is_of = [batch <= searched, is_of_cover, batch <= learnt]
    phase = np.select(is_of, ["search", "cover", "learn"], "estimate")
    repeats, draws = progress.repeats, progress.law_draws
    z = np.vstack([progress.z, progress.z[repeats.repeated], draws.z, progress.failed])
    others = np.repeat(["repeat", "law", "failed"], [len(repeats), len(draws), len(progress.failed)])
    none, unknown = np.zeros(len(progress.failed), bool), np.full(len(draws) + len(progress.failed), math.nan)
    columns = {
        "run": np.arange(len(z)) + 1,
        "batch": np.append(batch, np.zeros(len(others), int)),
        "phase": np.append(phase, others),
        **{f"z_{k + 1}": values for k, values in enumerate(z.T)},
        "event": np.concatenate([progress.happened, repeats.happened, draws.happened, none]),
        "score": np.concatenate([progress.score, repeats.score, unknown]),
    }
    dtype = [(name, values.dtype) for name, values in columns.items()]
    return np.rec.fromarrays([*columns.values()], dtype)


def with_inputs(found: Estimate, problem: ScoreProblem) -> Estimate:
    """Return an estimate whose table of runs also contains the inputs, ``x_1`` ..., of a `SystemProblem`."""
    if not isinstance(problem, SystemProblem):
        return found
    runs, numbers = found.tables["runs"], range(1, problem.dimension + 1)
    x = problem.inputs(np.column_stack([runs[f"z_{k}"] for k in numbers]))
    runs = append_fields(runs, [f"x_{k}" for k in numbers], [*x.T], usemask=False, asrecarray=True)
    return replace(found, tables={"runs": runs})


def _diagnostics(exclusion: Exclusion, combined: Combined | None) -> dict[str, float]:
    """Return relative errors (NaN without an estimate), health of the weights, and unobserved parts."""
    progress, errors, probability = exclusion.progress, np.full(2, math.nan), 0.0
    if combined is not None:
        probability = combined.probability
        errors = np.sqrt([combined.observed_variance, combined.predicted_variance]) / probability
    unseen = exclusion.unseen(probability)
    return {
        "batches": 0 if combined is None else combined.batches,
        "observed_error": float(errors[0]),
        "predicted_error": float(errors[1]),
        "effective_events": float(effective_number(event_ratios(progress))),
        "wide_draws": unseen.runs,
        "unseen_mode": unseen.mode,
        "unseen_any": unseen.anything,
        "repeats": len(progress.repeats),
        "differed": int(np.count_nonzero(progress.repeats.differed)),
        "law_draws": len(progress.law_draws),
        "law_events": progress.law_draws.events,
        "counted": progress.is_counted,
        "drift": progress.repeats.drift,
    }
