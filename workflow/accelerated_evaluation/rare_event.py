"""A rare event in the space of normal scores: what the adaptive sampler and its peers are given."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from accelerated_evaluation.distributions import Distribution
from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.problem import CutIn
from accelerated_evaluation.vehicles.events import CRASH, Event

Response = tuple[NDArray[np.bool_], Array | None]


@dataclass(frozen=True)
class RareEvent:
    """P(event) of inputs x = inputs(z), with z standard normal in ``dimension`` variables.

    Parameters
    ----------
    dimension
        Number d of variables.
    inputs
        Maps normal scores, shape (n, d), to the inputs of the system, shape (n, d).
    respond
        Runs the system on inputs, shape (n, d): whether the event happened, shape (n,), and a score, shape
        (n,), that falls as the event comes nearer, or None where only the flag is known.
    """

    dimension: int
    inputs: Callable[[Array], Array]
    respond: Callable[[Array], Response]

    def evaluate(self, z: Array) -> Response:
        """Run the system at normal scores, shape (n, d)."""
        return self.respond(self.inputs(z))


def normal_score_quantile(law: Distribution, z: Array) -> Array:
    """Value of ``law`` at the normal score z, exact in both tails: F(x) = Phi(z)."""
    return np.where(z > 0, law.isf(ndtr(-np.maximum(z, 0))), law.ppf(ndtr(np.minimum(z, 0))))


def independent(marginals: Sequence[Distribution], respond: Callable[[Array], Response]) -> RareEvent:
    """Return the event of independent inputs with the given marginals."""

    def inputs(z: Array) -> Array:
        return np.column_stack([normal_score_quantile(law, z[:, k]) for k, law in enumerate(marginals)])

    return RareEvent(len(marginals), inputs, respond)


def cut_in_event(
    problems: Mapping[str, CutIn], shares: Mapping[str, float], event: Event = CRASH, *, graded: bool = True
) -> RareEvent:
    """Return an event of a cut-in in any velocity segment.

    The variables are v_L, R^-1 and TTC^-1. The normal score of v_L runs through the segments one after the
    other, and the law of TTC^-1 is that of the segment, so that a sampler spreads its runs over the segments
    by what they contribute.

    Parameters
    ----------
    problems
        Cut-ins of each segment, in the order of their speeds; one vehicle simulates them all.
    shares
        Share of each segment in the lane changes; they sum to 1.
    graded
        Whether the sampler sees the score of an encounter, or only whether the event happened.
    """
    cut_ins = list(problems.values())
    share = np.array([shares[segment] for segment in problems])
    first = np.cumsum(share) - share

    def inputs(z: Array) -> Array:
        u = ndtr(z[:, 0])
        segment = np.searchsorted(first, u, side="right") - 1
        x = np.empty_like(z)
        for k, cut_in in enumerate(cut_ins):
            here = segment == k
            x[here, 0] = cut_in.lead_speed.ppf((u[here] - first[k]) / share[k])
            x[here, 1] = normal_score_quantile(cut_in.model.inverse_range, z[here, 1])
            x[here, 2] = normal_score_quantile(cut_in.model.inverse_ttc, z[here, 2])
        return x

    def respond(x: Array) -> Response:
        outcomes = cut_ins[0].simulate(*x.T)
        return event.happens(outcomes), event.score(outcomes) if graded else None

    return RareEvent(3, inputs, respond)
