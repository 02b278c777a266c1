"""Ratios with which sums over explored lines become probabilities under each draw of the law.

The probability of an event under one draw of the law is a sum over lines under the mean law, in which every
term is multiplied by a ratio: P(R, C > c | v_L) under the draw divided by that under the mean law. The
logarithm of this ratio is a smooth function of v_L, of the root of R, and of the cumulative hazard Lambda of
the mean law. It is stored at coarse nodes. Cubic splines lead from the coarse nodes to finer ones, between
which the ratios themselves are interpolated.
"""

import numpy as np
from scipy.interpolate import make_interp_spline

from accelerated_evaluation.answer.explored import DEPTH, Cell, DrawnLaws, closing_speeds, mean_law
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.support import Support

COARSE = (14, 12)  # stored nodes of lead speed and of the root of the range
FINE = (19, 16)  # nodes between which ratios are interpolated
LEVELS = (0, 1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 17, 20, 24, DEPTH)  # stored cumulative hazards
LIMITS = (
    -12.0,
    8.0,
)  # of the stored logarithms: smaller ratios count as 0, larger ones have no draw that matters


def log_ratios(drawn: DrawnLaws, support: Support) -> Array:
    """Return log ratios of each draw to the mean law of the answer at the stored nodes.

    Returns
    -------
    numpy.ndarray
        Shape (draws, nodes of v_L, nodes of the root of R, levels of the cumulative hazard).
    """
    speeds, roots = (
        np.linspace(*support.lead_speeds, COARSE[0]),
        _roots(COARSE[1]) * np.sqrt(support.range_max),
    )
    lead_speed, root = (nodes.ravel() for nodes in np.meshgrid(speeds, roots, indexing="ij"))
    places = Places.of(lead_speed, root**2, support)
    # A narrow cell around each node: its probability is that of the density, up to a constant.
    width = roots[0]
    sides = np.column_stack([np.minimum(root + width, roots[-1]), root - width]) / roots[-1]
    cells = Cell(np.column_stack([lead_speed, lead_speed]), sides, np.ones(root.size), support)
    survival = mean_law(cells, places, drawn.laws[: drawn.answered])
    levels = closing_speeds(survival, np.array(LEVELS))
    row = np.repeat(np.arange(root.size), len(LEVELS))
    logs = np.empty((len(drawn.laws), root.size, len(LEVELS)))
    for own, (ranges, law) in zip(logs, drawn.laws, strict=True):
        hazard = law.given(places).cumulative(levels.ravel(), row).reshape(own.shape)
        own[:] = np.log(cells.probability(places, ranges))[:, None] - hazard
    mean = np.log(np.mean(np.exp(logs[: drawn.answered]), axis=0))
    return np.clip(logs - mean, *LIMITS).reshape(-1, *COARSE, len(LEVELS))


def refinements() -> tuple[Array, Array, Array]:
    """Return the matrices that lead from stored to fine nodes: of v_L, of the root of R, and of Lambda."""
    sides = (
        (np.linspace(0, 1, COARSE[0]), np.linspace(0, 1, FINE[0])),
        (_roots(COARSE[1]), _roots(FINE[1])),
        (np.array(LEVELS, dtype=float), np.arange(DEPTH + 1)),
    )
    first, second, third = (make_interp_spline(a, np.eye(a.size), k=3)(b) for a, b in sides)
    return first, second, third


def _roots(count: int) -> Array:
    """Return nodes of the root of R / R_max, up to 1, the first one half a step above 0."""
    return (2 * np.arange(count) + 1) / (2 * count - 1)
