"""The status of a campaign: its estimate, the number of runs still needed, and whether it may stop."""

import math
from dataclasses import dataclass

import numpy as np
from fewruns.anytime import boundary
from scipy.special import stdtrit

from accelerated_evaluation.methods.estimate import Estimate, Stopping, normal_reach
from accelerated_evaluation.methods.surrogate_words import chance_in_words, unseen_in_words
from accelerated_evaluation.track.campaign import Campaign
from accelerated_evaluation.track.driven import BEYOND

MOST_BATCHES = 10_000  # largest number of further batches that a forecast considers


@dataclass(frozen=True)
class Status:
    """The status of a campaign."""

    asked: int  # number of requested runs
    reported: int  # number of those whose outcome has been reported
    used: int  # number of runs in complete batches, on which the estimate is based
    # Number of runs that the sampler chose beyond the limits, which need not be driven. They are not included
    # in the other numbers.
    spared: int
    estimate: Estimate
    # Predicted number of runs that are still needed; 0 if the campaign may stop, None if the number cannot be
    # predicted.
    needed: int | None

    @property
    def may_stop(self) -> bool:
        """Whether the estimate has converged, so that the campaign may stop."""
        return self.estimate.converged


def status_of(campaign: Campaign) -> Status:
    """Return the status of a campaign; its estimate does not include the runs of an incomplete batch."""
    to_drive = [run for run in campaign.runs if run.outcome != BEYOND]
    reported = sum(run.outcome is not None for run in to_drive)
    # The last batch is open if one of its runs is outstanding.
    used = sum(run.batch < campaign.batches or not campaign.outstanding for run in to_drive)
    spared, estimate = len(campaign.runs) - len(to_drive), campaign.estimate()
    needed: int | None = 0
    if not estimate.converged:
        needed = forecast(estimate, campaign.sampler.batch_size, campaign.goal)
        sampler = campaign.sampler
        if needed is not None and sampler.is_narrow(campaign.goal):
            needed = max(needed, sampler.repeats_wanted(certify=True))
        needed = None if needed is None or sampler.may_lapse else max(needed - (reported - used), 0)
    return Status(len(to_drive), reported, used, spared, estimate, needed)


def forecast(found: Estimate, batch_size: int, goal: Stopping) -> int | None:
    """Predict how many more runs are needed, if further batches are similar to those so far.

    The squared relative error of the mean of b batches is proportional to 1 / b, and Student's quantile
    decreases with b. The result is the smallest number of further batches with which the half-width meets the
    goal, times the number of runs in a batch. The result is None if there is no estimate yet, or if more than
    `MOST_BATCHES` batches would be needed.
    """
    batches = found.diagnostics["batches"]
    if not (found.probability > 0 and batches >= 2):
        return None
    more = np.arange(1, MOST_BATCHES + 1)
    error = max(found.diagnostics["observed_error"], found.diagnostics["predicted_error"])
    reach = stdtrit(batches + more - 1, 1 - goal.alpha / 2) * error * np.sqrt(batches / (batches + more))
    if goal.anytime:
        reach *= boundary(goal.alpha) / normal_reach(goal.alpha)
    # The half-width of P / (1 + reach) to P / (1 - reach) is P reach / (1 - reach^2).
    enough = np.flatnonzero(reach <= goal.beta * (1 - reach**2))
    return int(more[enough[0]]) * batch_size if enough.size else None


def in_words(campaign: Campaign, status: Status) -> str:
    """Return the status of a campaign, from `status_of`, as text of several lines."""
    found, goal = status.estimate, campaign.goal
    event = campaign.scenario.event_in_words(campaign.event)
    lines = [
        f"event       {event}, under the law {campaign.description!r}",
        f"runs        {status.asked} requested, {status.reported} reported, "
        f"{status.asked - status.reported} outstanding; "
        f"{found.events} with the event in the {status.used} runs of complete batches",
        f"estimate    {_estimate(found, campaign.scenario.noun)}",
        f"unseen      {unseen_in_words(found.probability, found.diagnostics)}",
        *(f"{'chance':<12}{line}" for line in chance_in_words(found.diagnostics).splitlines()),
        *_about_limits(campaign, status),
        f"goal        half-width at most {goal.beta:.0%} of the estimate, confidence {1 - goal.alpha:.0%}"
        + (", at all checks together" if goal.anytime else ""),
        f"may stop    {_advice(status)}",
    ]
    return "\n".join(lines)


def _about_limits(campaign: Campaign, status: Status) -> list[str]:
    """Return lines of text about the limits and the probability beyond them, which the estimate excludes."""
    if not campaign.limits:
        return []
    high = min(status.estimate.high + campaign.beyond, 1.0)
    end = "" if math.isnan(high) else f"; if each of them had the event, the interval would end at {high:.3g}"
    return [
        f"limits      {campaign.limits.in_words}; the estimate is of the event within; "
        f"runs beyond, not to be driven: {status.spared}",
        f"beyond      {campaign.beyond:.2g} of all cut-ins of the law{end}",
    ]


def _estimate(found: Estimate, noun: str) -> str:
    confidence = f"{1 - found.alpha:.0%}"
    if math.isnan(found.probability):
        return "none yet: events were observed, but their region is not known well enough"
    if found.events == 0:
        return f"0, no event was observed; at most {found.high:.2g} with {confidence} confidence"
    half = (found.high - found.low) / 2 / found.probability
    interval = f"{confidence} interval {found.low:.3g} to {found.high:.3g}"
    return f"{found.probability:.3g} per {noun}, {interval} (half-width {half:.0%} of the estimate)"


def _advice(status: Status) -> str:
    if status.may_stop:
        return "yes, if there is no unseen part (no recorded encounter was driven, as a check)"
    if "unseen_lapses" in status.estimate.diagnostics:
        return "no; these runs cannot exclude rare lapses, see the lines above"
    if status.estimate.diagnostics["drift"]:
        return "no; the vehicle changes from run to run, so that there is no single probability"
    if status.estimate.diagnostics["counted"]:
        return "no; more draws of the law make the interval narrower, by the square root of their number"
    if status.needed is None:
        return "no; the number of runs still needed cannot be predicted before there is an estimate"
    return f"no; about {status.needed} more runs are likely needed"
