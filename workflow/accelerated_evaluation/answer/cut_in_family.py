"""Joint laws that users have added, as candidates for cut-ins beside the smooth laws.

They are laws of range and closing speed; lead speeds are those of the records. Like the smooth laws, they are
scored by the closing speed given the range, on contiguous blocks of held-out records.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.answer.joint_family import (
    Candidate,
    ClusteredRecords,
    JointFamily,
    candidates,
    without_each_block,
)
from accelerated_evaluation.answer.scores import BLOCKS, contiguous_blocks
from accelerated_evaluation.answer.smooth_family import SmoothFamily, region
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws import Law, joint
from accelerated_evaluation.laws.distributions import Empirical
from accelerated_evaluation.laws.draws import Draws, MixedDraws
from accelerated_evaluation.laws.joint import JointLaw
from accelerated_evaluation.laws.lead_speeds import with_lead_speeds
from accelerated_evaluation.laws.protocol import Box
from accelerated_evaluation.laws.smooth.family import DistinctRecords

NODES, NODE_WEIGHTS = np.polynomial.legendre.leggauss(32)
AT_ONCE = 100_000  # number of records at once, which limits the memory to about 200 MB


def added_candidates() -> tuple[Candidate, ...]:
    """Return the candidates of joint laws that do not come with the library."""
    return tuple(each for each in candidates() if not each.kind.__module__.startswith(joint.__name__))


def added_family(
    records: DistinctRecords,
    added: Sequence[Candidate],
    closing_speed_max: float,
    generator: np.random.Generator,
) -> JointFamily:
    """Fit candidates to ranges and to closing speeds up to a limit [m/s], and score them on blocks."""
    x = np.column_stack([records.range_, np.minimum(records.closing_speed, closing_speed_max)])
    box = Box(("range", "closing_speed"), (0.0, 0.0), (records.support.range_max, closing_speed_max))
    cut_ins = ClusteredRecords(x, np.arange(len(x)), box)  # each cut-in is independent of the others
    laws = [candidate.fit(cut_ins, generator) for candidate in added]
    boundary = region(records) * records.range_
    log_scores, near_scores = np.empty((2, len(added), len(x)))
    block = contiguous_blocks(len(x), BLOCKS)
    for k, out, held in without_each_block(cut_ins, block, added, laws, generator):
        log_scores[k, out] = held.log_density(x[out])
        near_scores[k, out] = conditional_scores(held, x[out], boundary[out])
    return JointFamily(cut_ins, added, laws, log_scores, near_scores)


def conditional_scores(law: JointLaw, x: Array, boundary: Array) -> Array:
    """Return the censored log scores of closing speeds given the range under a joint law, shape (n,).

    A cut-in x, a row of range [m] and closing speed [m/s], is scored by its conditional log density if its
    closing speed exceeds the boundary [m/s], and by the log probability of not exceeding it otherwise.
    """
    parts = np.array_split(np.arange(len(x)), -(-len(x) // AT_ONCE))
    return np.concatenate([_conditional_scores(law, x[part], boundary[part]) for part in parts])


def _conditional_scores(law: JointLaw, x: Array, boundary: Array) -> Array:
    top = law.box.upper[1]
    limit = np.minimum(boundary, top)
    below = _integral(law, x[:, 0], np.zeros(len(x)), limit)
    above = _integral(law, x[:, 0], limit, np.full(len(x), top))
    with np.errstate(divide="ignore", invalid="ignore"):
        density = law.log_density(x) - np.log(below + above)
        return np.where(x[:, 1] > boundary, density, np.log(below) - np.log(below + above))


def _integral(law: JointLaw, range_: Array, low: Array, high: Array) -> Array:
    """Return the integral of a density over the closing speed from low to high [m/s], all of shape (n,)."""
    speeds = (low + high)[:, None] / 2 + (high - low)[:, None] / 2 * NODES
    points = np.column_stack([np.repeat(range_, NODES.size), speeds.ravel()])
    return (high - low) / 2 * (np.exp(law.log_density(points)).reshape(speeds.shape) @ NODE_WEIGHTS)


@dataclass(frozen=True)
class Together:
    """The smooth laws and added laws as one family of candidates."""

    smooth: SmoothFamily
    added: JointFamily  # of range and closing speed

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all candidates, the smooth laws first."""
        return (*self.smooth.names, *self.added.names)

    @property
    def built_in(self) -> SmoothFamily:
        """The smooth laws."""
        return self.smooth

    def law(self, name: str) -> Law:
        """Return a smooth law, fitted to all records."""
        return self.smooth.law(name)

    @property
    def scores(self) -> Array:
        """Held-out log score of each candidate on each record, shape (M, n)."""
        return np.vstack([self.smooth.scores, self.added.scores])

    @property
    def resampled(self) -> NDArray[np.bool_]:
        """Flags of the records that the bootstrap resamples."""
        return self.smooth.resampled

    def draws(self, chosen: NDArray[np.intp], generator: np.random.Generator) -> Draws:
        """Draw the chosen candidates, shape (K,), each with parameters from their posterior."""
        first, parts = len(self.smooth.names), []
        if (own := chosen[chosen < first]).size:
            parts.append(self.smooth.draws(own, generator))
        if (others := chosen[chosen >= first] - first).size:
            lead_speeds = Empirical(self.smooth.records.lead_speed)
            parts.append(with_lead_speeds(self.added.draws(others, generator), lead_speeds))
        return parts[0] if len(parts) == 1 else MixedDraws(parts)
