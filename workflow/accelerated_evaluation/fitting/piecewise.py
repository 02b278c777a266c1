"""Maximum likelihood for piecewise mixtures, their knots given or chosen (paper, section III.A)."""

import itertools
import math
from collections.abc import Sequence

import numpy as np
from tqdm import tqdm

from accelerated_evaluation.distributions import Described, PiecewiseMixture
from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.errors import ConvergenceError, InputError
from accelerated_evaluation.fitting.pieces import PieceFamily


def fit_piecewise(
    x: Array, lower: float, knots: Sequence[float], families: Sequence[PieceFamily]
) -> PiecewiseMixture:
    """Fit a piecewise mixture with given knots: the weights are shares, every piece stands alone (eq. 7-9).

    Parameters
    ----------
    x
        Sample, shape (n,), on [lower, inf).
    lower
        gamma_0, where the support begins.
    knots
        gamma_1 .. gamma_(k-1), rising.
    families
        What each of the k pieces is fitted with.

    Raises
    ------
    InputError
        If a piece holds fewer than two different values, or a value lies outside the support.
    """
    outside = np.count_nonzero(~((x >= lower) & (x < math.inf)))
    if outside:
        raise InputError(
            f"sample of a piecewise mixture on [{lower:g}, inf)",
            seen=f"{outside} of {x.size} values outside or not a number",
            expected="all values in the support",
            change="Filter the encounters as the model assumes (configuration key filters).",
        )
    bounds = [lower, *knots, math.inf]
    pieces, weights = [], []
    for (low, high), family in zip(itertools.pairwise(bounds), families, strict=True):
        inside = x[(x >= low) & (x < high)]
        pieces.append(_fit_checked(inside, low, high, family))
        weights.append(inside.size / x.size)
    return PiecewiseMixture(weights, pieces)


def _fit_checked(inside: Array, low: float, high: float, family: PieceFamily) -> Described:
    if inside.size < 2 or inside.min() == inside.max():
        raise InputError(
            f"piece [{low:g}, {high:g})",
            seen=f"{inside.size} observations with fewer than two different values",
            expected="at least two different values in every piece",
            change="Move the knots (configuration key models) or use fewer pieces.",
        )
    return family.fit(inside, low, high)


def knots_at_quantiles(x: Array, quantiles: Sequence[float]) -> list[float]:
    """Knots at the given sample quantiles."""
    return [float(knot) for knot in np.quantile(x, quantiles)]


def knots_by_profile_likelihood(
    x: Array,
    lower: float,
    families: Sequence[PieceFamily],
    quantiles: Sequence[float],
    *,
    minimum_share: float = 0.005,
) -> list[float]:
    """Knots that maximize the likelihood over all rising choices from a grid of sample quantiles.

    The log-likelihood is a sum over pieces (eq. 7), so each interval of the grid is fitted once.
    Intervals with less than ``minimum_share`` of the sample are left out.

    Raises
    ------
    ConvergenceError
        If no choice of knots can be fitted.
    """
    x = np.sort(x)
    grid = [lower, *np.unique(np.quantile(x, quantiles)), math.inf]
    cuts = np.searchsorted(x, grid)
    gain: dict[tuple[int, int, PieceFamily], float] = {}
    last = len(grid) - 1
    intervals = [
        (start, end, families[place])
        for place in range(len(families))
        for start, end in itertools.combinations(range(last + 1), 2)
        if (start == 0) == (place == 0) and (end == last) == (place == len(families) - 1)
    ]
    for start, end, family in tqdm(set(intervals), desc="profile likelihood", unit="fit", mininterval=5):
        inside = x[cuts[start] : cuts[end]]
        if inside.size < max(2, minimum_share * x.size) or inside[0] == inside[-1]:
            continue
        try:
            piece = _fit_checked(inside, grid[start], grid[end], family)
        except ConvergenceError:
            continue
        share = inside.size / x.size
        gain[start, end, family] = float(piece.logpdf(inside).sum()) + inside.size * math.log(share)

    def total(inner: tuple[int, ...]) -> float:
        intervals = itertools.pairwise((0, *inner, last))
        return sum(
            gain.get((*interval, family), -math.inf)
            for interval, family in zip(intervals, families, strict=True)
        )

    best = max(itertools.combinations(range(1, last), len(families) - 1), key=total)
    if total(best) == -math.inf:
        raise ConvergenceError(
            "profile likelihood of the knots",
            reached="no interval of the grid that could be fitted in every piece",
            limit=f"{last - 1} grid points",
            change="Use other families or fewer pieces (configuration key models).",
        )
    return [float(grid[index]) for index in best]
