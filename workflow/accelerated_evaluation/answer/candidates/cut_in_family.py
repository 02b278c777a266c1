"""Joint laws that users have added, as candidates for cut-ins in addition to the smooth laws.

They are laws of range and closing speed; lead speeds are those of the records. Like the smooth laws, they are
scored by the closing speed given the range, on contiguous blocks of held-out records.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from accelerated_evaluation.answer.candidates.joint_family import (
    Candidate,
    ClusteredRecords,
    JointFamily,
    candidates,
    without_each_block,
)
from accelerated_evaluation.answer.candidates.scores import BLOCKS, contiguous_blocks
from accelerated_evaluation.answer.candidates.smooth_family import region
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws import joint
from accelerated_evaluation.laws.distributions import Empirical
from accelerated_evaluation.laws.joint import JointLaw
from accelerated_evaluation.laws.protocol import Box, density_over
from accelerated_evaluation.laws.smooth.family import DistinctRecords

AT_ONCE = 100_000  # number of records at once, which limits the memory to about 200 MB


def added_candidates() -> tuple[Candidate, ...]:
    """Return the candidates of joint laws that do not come with the library."""
    return tuple(each for each in candidates() if not each.kind.__module__.startswith(joint.__name__))


def added_family(
    records: DistinctRecords,
    lead_speeds: Array,
    added: Sequence[Candidate],
    closing_speed_max: float,
    generator: np.random.Generator,
) -> JointFamily:
    """Fit candidates to ranges and to closing speeds up to a limit [m/s], and score them on blocks.

    ``lead_speeds`` [m/s] are those of the encounter table, by which draws are completed to laws of cut-ins,
    as a law file takes them from there.
    """
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
    return JointFamily(cut_ins, added, laws, log_scores, near_scores, Empirical(lead_speeds))


def scores_by_region(
    family: JointFamily, regions: Mapping[str, Array], generator: np.random.Generator
) -> dict[str, dict[str, Array]]:
    """Score candidates on held-out records by regions of closing speeds, (records,) by candidate and region.

    The regions are boundaries of closing speeds [m/s], as for `scores.HeldOut.scores`.
    """
    x = family.records.x
    scores = {name: {where: np.empty(len(x)) for where in regions} for name in family.names}
    block = contiguous_blocks(len(x), BLOCKS)
    for k, out, held in without_each_block(family.records, block, family.candidates, family.laws, generator):
        for where, boundary in regions.items():
            scores[family.names[k]][where][out] = conditional_scores(held, x[out], boundary[out])
    return scores


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
    below = density_over(law, 1, x, np.zeros(len(x)), limit)
    above = density_over(law, 1, x, limit, np.full(len(x), top))
    with np.errstate(divide="ignore", invalid="ignore"):
        density = law.log_density(x) - np.log(below + above)
        return np.where(x[:, 1] > boundary, density, np.log(below) - np.log(below + above))
