"""Sentences about the weights of the runs of the sampler, and about what the runs cannot exclude."""

import math
from collections.abc import Mapping

from fewruns.constants import UNSEEN_ALPHA

CONFIDENCE = f"{1 - UNSEEN_ALPHA:.0%} confidence"


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
        f"{bounds[1]:.1g} if of any shape ({CONFIDENCE}){relative}"
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


def assumption_in_words(diagnostics: Mapping[str, float]) -> list[str]:
    """Return sentences that belong to every answer of a vehicle that is not stated to be deterministic."""
    if diagnostics["counted"]:
        return [
            "the event happens often: it was counted by plain simulation. The estimate is its share in "
            f"{diagnostics['law_draws']:,.0f} draws of the law itself, because they contain more events than "
            "the other runs explain"
        ]
    if diagnostics["differed"] or not (repeats := int(diagnostics["repeats"])):
        return []
    return [
        f"{repeats} repeats without a difference exclude ({CONFIDENCE}) that more than "
        f"{1 - UNSEEN_ALPHA ** (1 / repeats):.1%} of the runs near the event end differently by chance. That "
        "there are no rarer lapses is an assumption"
    ]


def chance_in_words(diagnostics: Mapping[str, float]) -> str:
    """Return sentences about the repeated runs, and about the events that lapses can add to an estimate."""
    repeats, differed = int(diagnostics["repeats"]), int(diagnostics["differed"])
    if not repeats:
        return "repeats: none, because the vehicle is stated to be deterministic"
    lines = [f"repeats: {repeats} runs were made a second time, and {differed} of them ended differently"]
    if draws := int(diagnostics["law_draws"]):
        events = int(diagnostics["law_events"])
        lines.append(f"draws of the law itself: {draws}, of which {events} ended in the event")
    lines += assumption_in_words(diagnostics)
    if diagnostics["drift"]:
        lines.append(
            "drift: late repetitions differ from early ones in one direction, so that the vehicle changes "
            "with the number of its runs. The estimate mixes its states and has no meaning"
        )
    if not math.isnan(bound := diagnostics.get("unseen_lapses", math.nan)):
        monotone = diagnostics["unseen_lapses_monotone"]
        lines.append(
            f"rare lapses can add up to {bound:.1g} without any assumption, and up to {monotone:.1g} if "
            f"harder encounters are not less prone to them ({CONFIDENCE}); the interval includes the first "
            "bound, and the estimate has not converged"
        )
    if not math.isnan(runs := diagnostics.get("settling_runs", math.nan)):
        lines.append(
            f"to exclude such lapses, at least {runs:,.0f} draws of the law itself without an event would be "
            "needed"
        )
    return "\n".join(lines)
