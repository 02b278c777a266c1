"""Joint laws that users add as candidates for cut-ins, next to the smooth laws.

The smooth laws are scored by the closing speed given lead speed and range. A joint law of range and closing
speed is scored in the same way: its conditional density is its density divided by the integral over the
closing speed, which is computed by quadrature.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.answer.joint_family import Candidate, ClusteredRecords, candidates
from accelerated_evaluation.answer.scores import BLOCKS, contiguous_blocks
from accelerated_evaluation.answer.smooth_family import SmoothFamily, region
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws import joint
from accelerated_evaluation.laws.distributions import Empirical
from accelerated_evaluation.laws.draws import DrawnLaws, Draws, MixedDraws
from accelerated_evaluation.laws.joint.protocol import JointLaw
from accelerated_evaluation.laws.lead_speeds import WithLeadSpeeds
from accelerated_evaluation.laws.protocol import Box
from accelerated_evaluation.laws.smooth.family import DistinctRecords

NODES, NODE_WEIGHTS = np.polynomial.legendre.leggauss(32)
AT_ONCE = 100_000  # number of records at once, which limits the memory to about 200 MB


def added_candidates() -> tuple[Candidate, ...]:
    """Return the candidates of joint laws that do not come with the library."""
    return tuple(each for each in candidates() if not each.kind.__module__.startswith(joint.__name__))


@dataclass(frozen=True)
class AddedLaws:
    """Joint laws of range and closing speed that are fitted to cut-ins, with scores on held-out records."""

    records: DistinctRecords
    candidates: Sequence[Candidate]
    laws: Sequence[JointLaw]  # each candidate fitted to all records
    scores: Array  # held-out log score of each candidate on each record, shape (M, n)

    @classmethod
    def of(
        cls,
        records: DistinctRecords,
        candidates: Sequence[Candidate],
        closing_speed_max: float,
        generator: np.random.Generator,
        blocks: int = BLOCKS,
    ) -> Self:
        """Fit candidates to ranges and to closing speeds up to a limit [m/s], and score them on blocks."""
        x = np.column_stack([records.range_, np.minimum(records.closing_speed, closing_speed_max)])
        box = Box(("range", "closing_speed"), (0.0, 0.0), (records.support.range_max, closing_speed_max))
        whole, block = _clustered(x, box), contiguous_blocks(len(x), blocks)
        laws = [candidate.fit(whole, generator) for candidate in candidates]
        boundary, scores = region(records) * records.range_, np.empty((len(candidates), len(x)))
        for number in range(blocks):
            out = block == number
            rest = _clustered(x[~out], box)
            for k, (candidate, law) in enumerate(zip(candidates, laws, strict=True)):
                held = candidate.fit(rest, generator, start=law)
                scores[k, out] = conditional_scores(held, x[out], boundary[out])
        return cls(records, candidates, laws, scores)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the M candidates."""
        return tuple(candidate.name for candidate in self.candidates)

    def draws(self, chosen: NDArray[np.intp], generator: np.random.Generator) -> DrawnLaws:
        """Fit the chosen candidates, shape (K,), each to another bootstrap sample of the records."""
        x = np.column_stack([self.records.range_, self.records.closing_speed])
        records = _clustered(np.minimum(x, self.laws[0].box.upper), self.laws[0].box)
        lead_speeds, laws = Empirical(self.records.lead_speed), []
        for k in chosen:
            weights = generator.standard_exponential(len(x))
            own = self.candidates[k].fit(records, generator, weights=weights, start=self.laws[k])
            laws.append(WithLeadSpeeds(own, lead_speeds))
        names = tuple(self.names[k] for k in chosen)
        drawn = DrawnLaws.of([law.law for law in laws], names, generator)
        return DrawnLaws(laws, names, WithLeadSpeeds(drawn.proposal, lead_speeds))


def _clustered(x: Array, box: Box) -> ClusteredRecords:
    """Return records of cut-ins, shape (n, 2), as independent records."""
    return ClusteredRecords(x, np.arange(len(x)), box)


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
    added: AddedLaws

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all candidates, the smooth laws first."""
        return (*self.smooth.names, *self.added.names)

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
            parts.append(self.added.draws(others, generator))
        return parts[0] if len(parts) == 1 else MixedDraws(parts)
