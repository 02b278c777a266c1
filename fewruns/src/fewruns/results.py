"""Results of a sampler: the estimate, whether it has converged, and a table of all runs."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fewruns.arrays import Array, Flags
from fewruns.certificate import Certificate, Unseen, look_beyond
from fewruns.clearance import points_in_open_balls
from fewruns.combining import BatchEstimate, Combined, anytime_interval, beginnings, combine, counted_batches
from fewruns.constants import AGREEMENT, COVERED, FEW, NOISY_USABLE, UNSEEN_ALPHA, USABLE
from fewruns.cover import Cover
from fewruns.estimates import Estimate, Stopping, effective_number, largest_pareto_k, pareto_k
from fewruns.graded import say_more
from fewruns.parts import draw_in_balls_together, open_balls
from fewruns.progress import Progress
from fewruns.repeats import where_lapses_matter
from fewruns.two_phase import reach_of
from fewruns.wide_laws import bound_without_event

ROUNDING = 1e-12  # relative tolerance


def estimate(
    progress: Progress,
    batch_size: int,
    stopping: Stopping,
    certificate: Certificate | Cover,
    *,
    converged: bool,
) -> Estimate:
    """Return the estimated probability of the event, from the batches since the surrogate became usable.

    Without an event the estimate is 0, and the upper end of the interval is the bound for an event that no
    run has met; if all runs are events, the complement is treated like this. Before two batches can be used,
    or if the events are counted, the estimate is the share of events in the draws of the law itself, with its
    interval. The estimate is then NaN if no draw is an event, and the interval is [0, 1] without draws.
    """
    events, (combined, ends) = int(np.count_nonzero(progress.happened)), combined_estimate(progress, stopping)
    draws, by_draws = progress.law_draws, is_counted(progress)
    if by_draws:
        probability, interval = draws.share, draws.interval(stopping.alpha)
    elif combined is not None:
        # The mean of unbiased estimates of a probability may exceed 1.
        probability = min(combined.probability, 1.0)
        interval = min(ends[0], 1.0), min(ends[1], 1.0)
    elif 0 < events < progress.happened.size:
        drawn = draws.extended(progress.plain.z, progress.plain.happened)
        probability = drawn.share if drawn.events else math.nan
        interval = drawn.interval(stopping.alpha) if len(drawn) else (0.0, 1.0)
    else:
        bound = bound_without_event(progress.wide_draws[:, 0].sum(), stopping.alpha)
        if len(progress.plain):
            bound = min(bound, 1 - stopping.alpha ** (1 / len(progress.plain)))
        probability, interval = (1.0, (1 - bound, 1.0)) if events else (0.0, (0.0, bound))
    estimating = len(draws) if by_draws else sum(batch.runs for batch in _that_count(progress))
    return Estimate(
        probability,
        *interval,
        alpha=stopping.alpha,
        learning=len(progress.z) + len(progress.repeats) + len(draws) - estimating,
        estimating=estimating,
        events=draws.events if by_draws else events,
        converged=converged,
        diagnostics=_diagnostics(progress, combined, certificate),
        tables={"runs": tabulate_runs(progress, batch_size)},
    )


def with_lapses(found: Estimate, progress: Progress, stopping: Stopping) -> Estimate:
    """Return an estimate whose interval also includes the bound on the probability that lapses can add."""
    if not (bound := unseen_lapses(progress)):
        return found
    own = {"unseen_lapses": bound}
    if found.probability > 0:  # draws without an event that would reduce the bound to this share of it
        own["settling_runs"] = -math.log(UNSEEN_ALPHA) / (stopping.beta * found.probability)
    sampled = found.high if found.probability > 0 else 0.0
    return replace(found, high=max(sampled, bound), diagnostics={**found.diagnostics, **own})


def unseen_lapses(progress: Progress) -> float:
    """Return a bound on the probability that lapses add; 0 if there are none, or if they are counted."""
    is_unseen = may_lapse(progress) and not is_counted(progress)
    return progress.law_draws.interval(2 * UNSEEN_ALPHA)[1] if is_unseen else 0.0


def may_lapse(progress: Progress) -> bool:
    """Return whether outcomes may be random in a few of the runs, which no run has shown."""
    return progress.chance and not progress.repeats.vary_often


def is_counted(progress: Progress) -> bool:
    """Return whether the event of a system that may lapse is so frequent that the draws of the law show it.

    They then contain more events than the estimate from all other runs allows, and they count instead.
    """
    return may_lapse(progress) and is_contradicted(progress)


def is_contradicted(progress: Progress) -> bool:
    """Return whether the draws of the law contain far more events than the present estimate allows."""
    return progress.law_draws.contradict(_mean(progress))


def is_narrow(progress: Progress, stopping: Stopping) -> bool:
    """Return whether the interval is as narrow as a stopping rule requires, with enough observed events."""
    if is_counted(progress):
        draws = progress.law_draws
        probability, (low, high), events = draws.share, draws.interval(stopping.alpha), draws.events
    else:
        combined, (low, high) = combined_estimate(progress, stopping)
        probability, events = getattr(combined, "probability", 0.0), np.count_nonzero(progress.happened)
    enough = probability > 0 and events >= stopping.minimum_events
    return bool(enough and (high - low) / 2 <= stopping.beta * probability * (1 + ROUNDING))


def is_certified(progress: Progress, certificate: Certificate | Cover) -> bool:
    """Return whether the runs exclude all other parts of the event that the certificate speaks of.

    If this is to be shown by a cover, no known part may be larger than estimated, and the scores may leave no
    room for another part. If a whole batch was spent on them, one more is sampled, because the surrogate has
    learnt from them.
    """
    if not is_covered(progress, certificate):
        return False
    if isinstance(certificate, Certificate):
        return True
    generator = np.random.Generator(np.random.PCG64(0))  # it does not matter whether runs are needed
    # The search for open balls takes long, so the simple condition comes first.
    return progress.estimates[-1].runs > 0 and not len(runs_of_cover(progress, certificate, 1, generator))


def is_covered(progress: Progress, certificate: Certificate | Cover) -> bool:
    """Return whether the bound on an unobserved mode is at most ``certificate.share`` times the estimate."""
    probability = _mean(progress)
    return _unseen(progress, probability, certificate).mode <= certificate.share * probability


def where_to_search(progress: Progress, certificate: Certificate | Cover) -> float:
    """Return the rarity beyond which runs exclude unobserved parts of the event; 0 if there are none."""
    probability = _mean(progress)
    if (
        isinstance(certificate, Cover)
        or not 0 < (share := certificate.share * probability / certificate.filled) < 0.5
    ):
        return 0.0
    wide_draws = progress.wide_draws * [certificate.filled, 1, 1]
    known = wide_draws, progress.z.shape[1], reach_of(probability), certificate.curvature
    return look_beyond(*known, share)


def runs_of_cover(
    progress: Progress, cover: Cover, n: int, generator: np.random.Generator, *, by_cover_alone: bool = False
) -> Array:
    """Return up to n runs, shape (m, d), that exclude other parts of the event; none if none are needed.

    The surroundings of known parts are checked first, because the estimate begins again if a known part is
    larger than its runs have shown. With at most two inputs, the runs of the cover reach all places, known
    parts included. With many inputs, no run is near another one. If outcomes may be random, only the cover
    can be checked.
    """
    z, happened, probability = progress.z, progress.happened, _mean(progress)
    can_see = not progress.chance and z.shape[1] <= FEW and not by_cover_alone
    centres = z[:0] if progress.centres is None else progress.centres
    is_open = cover.unseen(z) > cover.share * probability
    if can_see and not (is_open and z.shape[1] <= COVERED):
        balls = open_balls(z, happened, centres, probability, cover.share)
        if len(balls):
            return draw_in_balls_together(n, balls, generator)
    if can_see and happened.any() and say_more(happened, progress.score):
        asked = centres, cover.share * probability, 1 / cover.curvature
        points = points_in_open_balls(n, z, happened, progress.score, *asked)
        if len(points):
            return points
    return cover.next_runs(n, z, cover.share * probability, generator) if is_open else z[:0]


def _mean(progress: Progress) -> float:
    """Return the estimate from the batches on which it is based; 0 if there are none."""
    batches = _that_count(progress)
    return combine(batches).probability if batches else 0.0


def frequent_runs(progress: Progress, checks: int) -> Flags:
    """Return which runs are so frequent that lapses there could matter; see `where_lapses_matter`."""
    return where_lapses_matter(progress.z, _mean(progress), checks)


def can_cover(progress: Progress) -> bool:
    """Return whether a cover may have the next batch before the interval is narrow: every other one.

    Two batches must agree on an estimate that is not far below the last prediction.
    """
    batches = _that_count(progress)
    if len(batches) < 2 or not progress.estimates[-1].runs:
        return False
    return reaches_prediction(progress, AGREEMENT)


def reaches_prediction(progress: Progress, factor: float) -> bool:
    """Return whether the estimate is more than the last predicted probability divided by ``factor``.

    If not, the surrogate has learnt of a part of the event that most batches of the estimate missed.
    """
    return _mean(progress) > progress.estimates[-1].prediction.probability / factor


def _that_count(progress: Progress) -> Sequence[BatchEstimate]:
    """Return the batches on which the estimate is based, except those that only exclude further parts."""
    return [batch for batch in counted(progress) if batch.runs]


def counted(progress: Progress) -> Sequence[BatchEstimate]:
    """Return the last consistent batches, without those before noise was noticed."""
    return counted_batches(progress.estimates[progress.chance_since :], _usable(progress))


def has_learnt(progress: Progress, batches: int) -> bool:
    """Return whether there was an estimate after any of the last ``batches`` batches."""
    begun = [*beginnings(progress.estimates[progress.chance_since :], _usable(progress))]
    return any(first is not None for first in begun[-batches:])


def has_begun_again(progress: Progress) -> bool:
    """Return whether there is no estimate now, although batches since noise was noticed had given one."""
    if len(_that_count(progress)) >= 2:
        return False
    batches = progress.estimates[progress.chance_since :]
    begun = enumerate(beginnings(batches, _usable(progress)))
    return any(
        first is not None and sum(batch.runs > 0 for batch in batches[first : last + 1]) >= 2
        for last, first in begun
    )


def _usable(progress: Progress) -> float:
    """Return the coefficient of variation of a run below which the surrogate is usable."""
    return NOISY_USABLE if progress.repeats.vary_often else USABLE


def _unseen(progress: Progress, probability: float, certificate: Certificate | Cover) -> Unseen:
    """Return the bounds on an unobserved part of the event, given the probability of the known part."""
    reach, dimension = reach_of(probability), progress.z.shape[1]
    if isinstance(certificate, Cover):
        by_draws = Unseen.after(progress.wide_draws, dimension, reach, certificate.curvature)
        return replace(by_draws, mode=certificate.unseen(progress.z))
    return Unseen.after(progress.wide_draws, dimension, reach, certificate.curvature, certificate.filled)


def combined_estimate(progress: Progress, stopping: Stopping) -> tuple[Combined | None, tuple[float, float]]:
    """Return the estimate from the last consistent batches, and its interval; None without an estimate."""
    batches = _that_count(progress)
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
    estimates = counted(progress)[-len(progress.batches) :] if progress.batches else []
    batches = progress.batches[len(progress.batches) - len(estimates) :]
    ratios = [
        estimate.importance * batch.weight / batch.inclusion
        for estimate, batch in zip(estimates, batches, strict=True)
    ]
    joined = np.concatenate([np.empty(0), *ratios])
    return joined[progress.happened[len(progress.z) - len(joined) :] & (joined > 0)]


def tabulate_runs(progress: Progress, batch_size: int) -> NDArray[np.void]:
    """Return all simulations, with fields ``run`` and ``batch`` from 1, ``phase``, ``z_1`` ..., ``event``."""
    run = np.arange(len(progress.z)) + 1
    # The sizes of the batches before a sampler was rebuilt are not known.
    batch = np.repeat(np.arange(len(progress.sizes)), progress.sizes)
    earlier = np.arange(len(run) - len(batch)) // batch_size
    batch = np.append(earlier, batch + len(np.unique(earlier))) + 1
    batches = int(batch.max(initial=0))
    searched = batches - len(progress.estimates)
    learnt = batches - len(counted(progress))
    weight = np.concatenate([np.empty(0), *(each.weight for each in progress.batches)])
    is_of_cover = np.append(np.zeros(len(run) - len(weight), bool), weight == 0)
    is_of = [batch <= searched, is_of_cover, batch <= learnt]
    phase = np.select(is_of, ["search", "cover", "learn"], "estimate")
    repeats, draws = progress.repeats, progress.law_draws
    z = np.vstack([progress.z, progress.z[repeats.repeated], draws.z])
    others = np.repeat(["repeat", "law"], [len(repeats), len(draws)])
    columns = {
        "run": np.arange(len(z)) + 1,
        "batch": np.append(batch, np.zeros(len(others), int)),
        "phase": np.append(phase, others),
        **{f"z_{k + 1}": values for k, values in enumerate(z.T)},
        "event": np.concatenate([progress.happened, repeats.happened, draws.happened]),
    }
    table = np.empty(len(z), [(name, values.dtype) for name, values in columns.items()])
    for name, values in columns.items():
        table[name] = values
    return table


def _diagnostics(
    progress: Progress, combined: Combined | None, certificate: Certificate | Cover
) -> dict[str, float]:
    """Return relative errors (NaN without an estimate), health of the weights, and unobserved parts."""
    errors, probability = (math.nan, math.nan), 0.0
    if combined is not None:
        probability = combined.probability
        errors = np.sqrt([combined.observed_variance, combined.predicted_variance]) / probability
    unseen, ratios = _unseen(progress, probability, certificate), event_ratios(progress)
    return {
        "batches": 0 if combined is None else combined.batches,
        "observed_error": float(errors[0]),
        "predicted_error": float(errors[1]),
        "effective_events": float(effective_number(ratios)),
        "pareto_k": pareto_k(ratios),
        "pareto_k_limit": largest_pareto_k(len(ratios)),
        "wide_draws": unseen.runs,
        "unseen_mode": unseen.mode,
        "unseen_any": unseen.anything,
        "repeats": len(progress.repeats),
        "differed": int(np.count_nonzero(progress.repeats.differed)),
        "law_draws": len(progress.law_draws),
        "law_events": progress.law_draws.events,
        "counted": is_counted(progress),
        "drift": progress.repeats.drift,
    }
