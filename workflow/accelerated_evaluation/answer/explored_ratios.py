"""Ratios that convert the sum over the lines of the explorer to the probability under each draw of the law.

The explorer computes the probability of an event under the mean law as a sum over lines and points. For the
probability under one draw of the law, every term is multiplied by a ratio: P(R, C > c | v_L) under the draw
divided by the same quantity under the mean law. The logarithm of this ratio is a smooth function of v_L, of
the square root of R, and of the cumulative hazard Lambda of the mean law. It is stored at coarse nodes. Cubic
splines give its values at finer nodes, between which the ratios themselves are interpolated.
"""

import numpy as np
from scipy.interpolate import make_interp_spline

from accelerated_evaluation.answer.explored import DEPTH, Cell, DrawnLaws, closing_speeds, mean_law
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.support import Support

COARSE = (14, 12)  # numbers of stored nodes of the lead speed and of the square root of the range
FINE = (19, 16)  # numbers of nodes between which the ratios are interpolated
LEVELS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 14, 17, 20, 24, DEPTH)  # stored cumulative hazards
# Limits of the stored logarithms. Smaller ratios are almost 0, and no draw with a relevant weight has larger
# ones.
LIMITS = (-12.0, 8.0)


def log_ratios(drawn: DrawnLaws, support: Support) -> Array:
    """Return the logarithms of the ratio of each draw to the mean law of the answer, at the stored nodes.

    Parameters
    ----------
    drawn
        Draws of the law.
    support
        Limits of the records.

    Returns
    -------
    numpy.ndarray
        Shape (draws, nodes of v_L, nodes of the square root of R, levels of the cumulative hazard).
    """
    speeds, roots = (
        np.linspace(*support.lead_speeds, COARSE[0]),
        _roots(COARSE[1]) * np.sqrt(support.range_max),
    )
    lead_speed, root = (nodes.ravel() for nodes in np.meshgrid(speeds, roots, indexing="ij"))
    places = Places.of(lead_speed, root**2, support)
    # The density of the range is represented, up to a constant, by the probability of a cell at each node.
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
    """Return the matrices of spline interpolation from the stored to the finer nodes.

    There is one matrix for each coordinate: v_L, the square root of R, and Lambda. Each has the shape (finer
    nodes, stored nodes).
    """
    sides = (
        (np.linspace(0, 1, COARSE[0]), np.linspace(0, 1, FINE[0])),
        (_roots(COARSE[1]), _roots(FINE[1])),
        (np.array(LEVELS, dtype=float), np.arange(DEPTH + 1)),
    )
    first, second, third = (make_interp_spline(a, np.eye(a.size), k=3)(b) for a, b in sides)
    return first, second, third


def _roots(count: int) -> Array:
    """Return equidistant nodes of the square root of R / R_max, from half a step above 0 to 1."""
    return (2 * np.arange(count) + 1) / (2 * count - 1)
