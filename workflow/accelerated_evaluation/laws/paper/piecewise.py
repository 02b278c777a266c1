"""Maximum-likelihood fits of piecewise mixtures with given or selected knots (paper, section III.A)."""

import itertools
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from tqdm import tqdm

from accelerated_evaluation.base.arguments import one_of
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import ConvergenceError, InputError
from accelerated_evaluation.base.users_code import call
from accelerated_evaluation.laws.distributions import DISTRIBUTIONS, Described, PiecewiseMixture

FITTED = one_of(Described, words="a distribution", change="Correct the distribution.")
MINIMUM_SHARE = 0.005  # of the sample, in each piece between knots of a profile likelihood


@dataclass(frozen=True)
class PieceFamily:
    """The family of a piece: a kind of distribution, or mixtures of several components of that kind."""

    kind: str  # name in the registry `DISTRIBUTIONS`, such as ``bounded exponential``
    components: int = 1  # a number above one means a mixture

    @classmethod
    def of(cls, piece: Described) -> "PieceFamily":
        """Return the family to which a fitted piece belongs."""
        leaves = [leaf for _, leaf in piece.leaves()]
        return cls(leaves[0].kind, len(leaves))

    def fit(self, x: Array, lower: float, upper: float) -> Described:
        """Return the member of the family that is fitted by maximum likelihood to a sample on [lower, upper).

        ConvergenceError is raised if it cannot be fitted, and InputError if no distribution is of this kind.
        """
        member: Any = DISTRIBUTIONS[self.kind]  # not every distribution can be fitted
        stated: dict[str, Any] = {"where": f"distribution {self.kind}", "returns": FITTED}
        if self.components == 1:
            return call(member.fit, x, lower, upper, **stated)
        return call(member.fit_mixture, x, lower, upper, self.components, **stated)

    def fit_or_simpler(self, x: Array, lower: float, upper: float) -> Described:
        """Return a fit of the family to a sample x, shape (n,), on [lower, upper), or of a simpler family.

        If the family cannot be fitted, the number of components is reduced one by one. If a single component
        cannot be fitted either, a bounded exponential distribution is fitted. This is always possible,
        because its density may also increase, as the density of a few observations may do by chance.
        `PieceFamily.of` returns the family that was fitted.
        """
        for components in range(self.components, 0, -1):
            # If a component loses all its observations, a division by zero leads to one of these errors.
            with suppress(ConvergenceError, ValueError), np.errstate(divide="ignore", invalid="ignore"):
                return PieceFamily(self.kind, components).fit(x, lower, upper)
        return EXPONENTIAL.fit(x, lower, upper)

    def __str__(self) -> str:
        """Return a description of the family."""
        return self.kind if self.components == 1 else f"mixture of {self.components} {self.kind}s"


EXPONENTIAL = PieceFamily("bounded exponential")


def piece_kinds() -> list[str]:
    """Return the names of the distributions that can be fitted to a piece and tilted exponentially."""
    needed = ("fit", "tilt")
    return [kind for kind, member in DISTRIBUTIONS.items() if all(hasattr(member, name) for name in needed)]


def mixture_kinds() -> list[str]:
    """Return the names of those distributions in `piece_kinds` of which mixtures can be fitted."""
    return [kind for kind in piece_kinds() if hasattr(DISTRIBUTIONS[kind], "fit_mixture")]


def fit_piecewise(
    x: Array, lower: float, knots: Sequence[float], families: Sequence[PieceFamily]
) -> PiecewiseMixture:
    """Fit a piecewise mixture with given knots by maximum likelihood (equations 7-9).

    The sample is on [lower, inf). The weight of a piece is its share of the sample, and each piece is fitted
    to its own values. A piece that cannot be fitted with its family gets a simpler one; see
    `PieceFamily.fit_or_simpler`. InputError is raised if a piece contains fewer than two different values, or
    a value lies outside the support.
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
        _require_two_values(inside, low, high)
        pieces.append(family.fit_or_simpler(inside, low, high))
        weights.append(inside.size / x.size)
    return PiecewiseMixture(weights, pieces)


def _require_two_values(inside: Array, low: float, high: float) -> None:
    if inside.size < 2 or inside.min() == inside.max():
        raise InputError(
            f"piece [{low:g}, {high:g})",
            seen=f"{inside.size} observations with fewer than two different values",
            expected="at least two different values in every piece",
            change="Move the knots (configuration key models) or use fewer pieces.",
        )


def knots_at_quantiles(x: Array, quantiles: Sequence[float]) -> list[float]:
    """Return knots at the given quantiles of the sample x, shape (n,)."""
    return [float(knot) for knot in np.quantile(x, quantiles)]


def usable_knots(x: Array, knots: Sequence[float]) -> list[float]:
    """Move knots as little as necessary so that each piece contains two different values of the sample x.

    InputError is raised if x has fewer different values than twice the number of pieces.
    """
    values, pieces = np.unique(x), len(knots) + 1
    if values.size < 2 * pieces:
        raise InputError(
            f"sample of {x.size} for {pieces} pieces",
            seen=f"{values.size} different values",
            expected=f"at least {2 * pieces}, two in each piece",
            change="Add records, join segments (segments.lead_speed_edges) or use fewer pieces.",
        )
    wanted = np.searchsorted(values, knots)  # number of values below each knot
    below = wanted.copy()
    for place in range(below.size):
        below[place] = max(below[place], below[place - 1] + 2 if place else 2)
    for place in reversed(range(below.size)):
        below[place] = min(below[place], (below[place + 1] if place + 1 < below.size else values.size) - 2)
    moved = below != wanted
    return [
        float(values[n]) if move else float(knot) for n, move, knot in zip(below, moved, knots, strict=True)
    ]


def knots_by_profile_likelihood(
    x: Array, lower: float, families: Sequence[PieceFamily], quantiles: Sequence[float]
) -> list[float]:
    """Return the knots with the largest likelihood among all increasing choices from a grid of quantiles.

    The log-likelihood is a sum over pieces (equation 7), so each interval of the grid is fitted only once.
    Pieces with less than `MINIMUM_SHARE` of the sample are excluded. ConvergenceError is raised if no
    choice of knots can be fitted.
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
        if inside.size < max(2, MINIMUM_SHARE * x.size) or inside[0] == inside[-1]:
            continue
        try:
            piece = family.fit(inside, grid[start], grid[end])
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

    best = max(itertools.combinations(range(1, last), len(families) - 1), key=total, default=None)
    if best is None or total(best) == -math.inf:
        raise ConvergenceError(
            "profile likelihood of the knots",
            reached="no interval of the grid that could be fitted in every piece",
            limit=f"{last - 1} grid points",
            change="Use other families or fewer pieces (configuration key models).",
        )
    return [float(grid[index]) for index in best]
