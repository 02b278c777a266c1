"""Sentences about the weights of the runs of the sampler, and about what the runs cannot exclude."""

import math
from collections.abc import Mapping

from fewruns.constants import UNSEEN_ALPHA


def unseen_in_words(probability: float, diagnostics: Mapping[str, float]) -> str:
    """Return a sentence with two bounds on unobserved parts of an event, also relative to the estimate."""
    bounds = diagnostics["unseen_mode"], diagnostics["unseen_any"]
    relative = ""
    if probability > 0:
        mode, anything = (bound / probability for bound in bounds)
        relative = f"; these are {mode:,.2g} and {anything:,.2g} times the estimate"
        relative += ", so it is an assumption that there is no such part" if mode > 1 else ""
    return (
        f"a part of the event that no run has met: at most {bounds[0]:.1g} if a half-space, "
        f"{bounds[1]:.1g} if of any shape ({1 - UNSEEN_ALPHA:.0%} confidence){relative}"
    )


def weights_in_words(diagnostics: Mapping[str, float]) -> str:
    """Return a sentence about the effective number of events and the tail of their weights."""
    effective, k, limit = (diagnostics[name] for name in ("effective_events", "pareto_k", "pareto_k_limit"))
    words = f"weights of the events: as informative as {effective:.1f} events of equal weight"
    if math.isnan(k):
        return f"{words}; these are too few for Pareto k-hat"
    if k <= limit:
        return f"{words}; Pareto k-hat {k:.2f}, at most {limit:.2f}, so no single weight dominates"
    return (
        f"{words}; Pareto k-hat {k:.2f}, above its threshold {limit:.2f} for this number of events, so a few "
        "large weights may dominate, and the interval may be too narrow"
    )


def chance_in_words(diagnostics: Mapping[str, float]) -> str:
    """Return sentences about the repeated runs and the probability that lapses can add to an estimate."""
    repeats, differed = int(diagnostics["repeats"]), int(diagnostics["differed"])
    if not repeats:
        return "repeats: none, because the vehicle is stated to be deterministic"
    lines = [f"repeats: {repeats} runs were made a second time, and {differed} of them ended differently"]
    if draws := int(diagnostics["law_draws"]):
        events = int(diagnostics["law_events"])
        lines.append(f"draws of the law itself: {draws}, of which {events} ended in the event")
    bound = diagnostics.get("unseen_lapses", math.nan)
    if draws and not differed and not math.isnan(bound):
        lines.append(
            "these events contradict the estimate, although no repeat ended differently: the event also "
            "happens at places that the other runs do not show, such as thin stripes. They count as lapses"
        )
    if not math.isnan(bound):
        monotone, runs = diagnostics["unseen_lapses_monotone"], diagnostics["settling_runs"]
        lines.append(
            f"rare lapses can add up to {bound:.1g} if encounters of equal hardness are equally prone to "
            f"them, and {monotone:.1g} if in addition harder encounters are not less prone "
            f"({1 - UNSEEN_ALPHA:.0%} confidence); the interval includes the first bound, and the estimate "
            "has not converged"
        )
        if math.isfinite(runs):
            lines.append(
                f"to exclude such lapses, at least {runs:,.0f} runs without an event would be needed. They "
                "must be encounters drawn from the law itself, or may be any hard encounters if harder ones "
                "are not less prone to lapses. Q times as many are enough if lapses are harmless in all but "
                "the hardest share Q of the encounters"
            )
    return "\n".join(lines)
