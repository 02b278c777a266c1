"""What an estimate says in words: its reason, what its runs exclude, and what contradicts statements."""

import numpy as np

from fewruns.certificate import BY_DEFAULT
from fewruns.checks import Checks
from fewruns.constants import FEW, STEEPER, UNSEEN_ALPHA
from fewruns.cover import Cover
from fewruns.estimates import Stopping
from fewruns.exclusion import Exclusion
from fewruns.results import combined_estimate, is_narrow
from fewruns.statements import events_below_others, point_the_wrong_way


def reason(exclusion: Exclusion, checks: Checks, stopping: Stopping, *, is_settled: bool) -> str:
    """Return in one sentence why an estimate has converged, or why it has not."""
    progress = exclusion.progress
    if progress.repeats.drift:
        return "the system drifts: repetitions of the same runs differ in one direction"
    if progress.may_lapse and not progress.is_counted:
        return "outcomes may be random in a few of the runs, which the runs cannot exclude"
    if not progress.happened.any() and not progress.law_draws.events:
        return "no run has met the event"
    if progress.chance_since and combined_estimate(progress, stopping)[0] is None:
        return "the earlier batches no longer count, because repetitions show that most outcomes are random"
    if combined_estimate(progress, stopping)[0] is None and not progress.is_counted:
        return "too few batches have given an estimate that agrees with the one before"
    if not is_narrow(progress, stopping):
        return "the interval is wider than required"
    if not is_narrow(progress, stopping, with_failed=True):
        return "the interval is wider than required, because the failed runs may be events or not"
    if is_settled:
        return "the interval is narrow, and the certificate is met"
    if not exclusion.is_certified:
        return "the interval is narrow, but other parts of the event are not excluded yet"
    if checks.missing:
        return f"the interval is narrow, but {checks.missing} checks for random outcomes are missing"
    if not exclusion.is_sufficient:
        return "the default certificate is weak for this number of inputs; state one to exclude other parts"
    return "the surrogate predicts more than the estimate, which may have missed a part that was found late"


def excluded(exclusion: Exclusion, checks: Checks, probability: float) -> str:
    """Return what other parts of the event the runs exclude, and what outcomes by chance."""
    progress, required = exclusion.progress, exclusion.required
    parts = "nothing, so that the event may have other parts"
    if required == BY_DEFAULT:
        parts = "other parts of the event, because it was stated that there are none"
    elif exclusion.is_certified:
        parts = f"parts of the event with more than {required.share:g} times its probability"
        if required.curvature:
            parts += f" and a radius of at least {1 / required.curvature:.2g} normal scores"
        parts += ", except next to failed runs" * (len(progress.failed) > 0)
        by_scores = isinstance(required, Cover) and exclusion.has_scores and exclusion.dimension <= FEW
        towards = f"at most {STEEPER:g} times as steeply as towards the known parts"
        parts += f", and smaller ones if the scores fall towards them {towards}" * by_scores
    if checks.deterministic is not None or progress.chance or not len(progress.repeats):
        return parts
    rate = 1 - UNSEEN_ALPHA ** (1 / len(progress.repeats))
    added = min(rate, progress.law_draws.interval(2 * UNSEEN_ALPHA)[1])
    words = (
        f"{parts}; other outcomes in more than {100 * rate:.2g} % of repeated runs. Lapses at this rate "
        f"in all runs could add {added:.2g} to the probability"
    )
    return words + f", {added / probability:.2g} times the estimate" * (probability > 0)


def warning(exclusion: Exclusion) -> str:
    """Return what the runs say against statements about the problem; empty if nothing."""
    progress, words = exclusion.progress, []
    if failed := len(progress.failed):
        share = f"{failed} of {progress.simulations} runs ({failed / progress.simulations:.2g} of them)"
        words.append(f"{share} have failed; the interval allows for all or none of them to be events")
    if point_the_wrong_way(progress.happened, progress.score):
        words.append("scores of events are larger than those of other runs, but should be smaller")
    is_upper = exclusion.required == BY_DEFAULT and not progress.chance  # as stated
    if is_upper and (events := events_below_others(progress.z, progress.happened)):
        of = np.count_nonzero(progress.happened)
        where = f"in each input, at least {events} of {of} events have a run without the event above them"
        words.append(f"upper_set was stated, but {where}")
    return "; ".join(words)
