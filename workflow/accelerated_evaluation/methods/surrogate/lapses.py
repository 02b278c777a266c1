"""Bounds on the probability that lapses add, if a vehicle drives differently in few of its runs.

The estimate contains only the events that the runs have met. A lapse is seldom met: if none of n runs in
cut-ins of probability Q was a crash, lapses may cause crashes there with probability 3 Q / n (95 %
confidence). The probability of lapses is bounded here, not estimated, and a shape has to be assumed for it.
Cut-ins are sorted by their hardness, which is the probability of the event by a surrogate of the flags, and
divided into shells. Each shell has a tenth of the probability of the previous one.

- *Like hardness*: all cut-ins of a shell have the same probability of a lapse that ends in the event, so that
  it does not matter how the runs were chosen. Every shell has its own bound.
- *Monotone*: besides, harder cut-ins do not have a smaller one. Harder shells then bound the easier ones too.

Without any assumption n draws of the law itself are needed, of which none is an event: log(1 / alpha) / n.
Neither of the two assumptions lowers this number, because lapses that are equally likely in all cut-ins
satisfy both. If harder cut-ins do not lapse less often, the n runs may be hard cut-ins instead of draws. Only
the knowledge that easy cut-ins are harmless lowers it: to n Q if lapses matter in a share Q of all cut-ins.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import betaincinv

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.methods.surrogate.constants import NOISY_AMPLITUDE, POOL, UNSEEN_ALPHA
from accelerated_evaluation.methods.surrogate.gaussian_process import EventSurrogate
from accelerated_evaluation.methods.surrogate.two_phase import Flags
from accelerated_evaluation.methods.surrogate.wide_laws import draw_wide, log_normal_to_wide

# Multiple of the estimate up to which the hardest cut-ins are those that the estimate is made of; and the
# probability of these cut-ins if there is no estimate.
KNOWN, HARDEST = 10.0, 1e-6


@dataclass(frozen=True)
class LapseBounds:
    """Bounds, with confidence 1 - `UNSEEN_ALPHA`, on what lapses can add to the estimate.

    Attributes
    ----------
    like_hardness, monotone
        By the two assumptions of the module. If there is no estimate, the hardest cut-ins are included, so
        that these are bounds on the probability of the event.
    runs
        Draws of the law itself, none of them an event, that would bring the bound down to a share of the
        estimate, whatever the shape. If there is no estimate, it is replaced by its bound, so that at least
        so many draws are needed.
    """

    like_hardness: float
    monotone: float
    runs: float

    @classmethod
    def after(cls, z: Array, happened: Flags, probability: float, share: float) -> "LapseBounds":
        """Return what lapses can add after some runs.

        Parameters
        ----------
        z, happened
            Normal scores of the runs, shape (n, d), and whether the event happened, shape (n,).
        probability
            The estimate; NaN or 0 if there is none.
        share
            Share of the estimate to which ``runs`` belongs.
        """
        if not len(z):
            return cls(1.0, 1.0, math.inf)
        is_known = probability > 0
        surrogate = EventSurrogate(z.shape[1], amplitude=NOISY_AMPLITUDE)
        surrogate.fit(z, happened, learn=False)
        # These draws cost no run. They are the same every time, so that a bound has no noise of its own.
        points = draw_wide(POOL, z.shape[1], child_generator(0, "lapses"))
        harder = _mass_of_harder(surrogate, points, z)
        edges = _edges(KNOWN * probability if is_known else HARDEST)
        shells = np.digitize(harder, edges) - 1  # -1 for the hardest cut-ins, which are known
        count = np.array([np.count_nonzero(shells == k) for k in range(len(edges) - 1)])
        events = np.array([np.count_nonzero(happened & (shells == k)) for k in range(len(edges) - 1)])
        mass, each = np.diff(edges), UNSEEN_ALPHA / max(len(edges) - 1, 1)
        own, pooled = upper_limit(events, count, each), upper_limit(events.cumsum(), count.cumsum(), each)
        rest = 0.0 if is_known else HARDEST
        alike, monotone = float(mass @ own) + rest, float(mass @ np.minimum(own, pooled)) + rest
        return cls(alike, monotone, -math.log(UNSEEN_ALPHA) / (share * (probability if is_known else alike)))


def upper_limit(events: Array, count: Array, alpha: float) -> Array:
    """Return the upper limits of Clopper and Pearson with confidence 1 - alpha, shape (k,)."""
    return np.where(events < count, betaincinv(events + 1, np.maximum(count - events, 1), 1 - alpha), 1.0)


def _edges(least: float) -> Array:
    """Return the probabilities of all cut-ins that are at least as hard as the ends of the shells, rising."""
    decades = max(math.ceil(-math.log10(least)), 1) if least < 1 else 0
    return np.unique(np.append(np.logspace(-decades, 0, decades + 1).clip(least), 1.0))


def _mass_of_harder(surrogate: EventSurrogate, points: Array, z: Array) -> Array:
    """Return for each run of z, shape (n, d), the probability of all cut-ins that are at least as hard."""
    hardness = surrogate.probability(points)
    order = np.argsort(hardness)
    mass = np.exp(log_normal_to_wide(points[order])) / len(points)
    harder = np.append(np.cumsum(mass[::-1])[::-1], 0.0)
    place = np.searchsorted(hardness[order], surrogate.probability(z))
    return np.clip(harder[place] / harder[0], 0.0, np.nextafter(1.0, 0.0))


def chance_in_words(diagnostics: Mapping[str, float]) -> str:
    """Say what the repeats of runs have shown, and what lapses can add to the estimate."""
    repeats, differed = int(diagnostics["repeats"]), int(diagnostics["differed"])
    if not repeats:
        return "repeats: none, because the vehicle is said to repeat itself"
    lines = [f"repeats: {repeats} runs were made a second time, and {differed} of them ended differently"]
    if not math.isnan(bound := diagnostics.get("unseen_lapses", math.nan)):
        monotone, runs = diagnostics["unseen_lapses_monotone"], diagnostics["settling_runs"]
        lines.append(
            f"rare lapses can add up to {bound:.1g} if all cut-ins of like hardness are alike, and "
            f"{monotone:.1g} if harder cut-ins besides are not less prone to them ({1 - UNSEEN_ALPHA:.0%} "
            "confidence); the interval ends at the first bound, and the estimate is not converged"
        )
        if math.isfinite(runs):
            lines.append(
                f"to exclude such lapses it would take at least {runs:,.0f} runs without an event: of cut-ins"
                " drawn from the law itself, without an assumption or if cut-ins of like hardness are alike; "
                "of any hard cut-ins, if harder ones are not less prone; and Q times as many, if lapses are "
                "harmless in all but the hardest share Q of the cut-ins"
            )
    return "\n".join(lines)
