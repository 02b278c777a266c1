"""Finite mixtures, and the piecewise mixture of the paper: a mixture whose components do not overlap."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.optimize.elementwise import find_root
from scipy.special import logsumexp

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.distributions.described import Described, Tiltable, distribution, from_dict


@distribution("mixture")
@dataclass(frozen=True)
class Mixture(Described):
    """Weighted sum of distributions (paper, section III.B.3)."""

    weights: Sequence[float]  # positive, summing to one
    components: Sequence[Any]  # distributions; a component may itself be a mixture

    def __post_init__(self) -> None:
        object.__setattr__(self, "weights", tuple(float(weight) for weight in self.weights))
        object.__setattr__(self, "components", tuple(self.components))
        if len(self.weights) != len(self.components) or not self.weights:
            raise ValueError(f"{len(self.weights)} weights for {len(self.components)} components")
        if not (min(self.weights) > 0 and abs(math.fsum(self.weights) - 1) <= 1e-9):
            raise ValueError(f"weights must be positive and sum to one, got {self.weights}")

    @property
    def lower(self) -> float:
        """Lower bound of the support."""
        return min(component.lower for component in self.components)

    @property
    def upper(self) -> float:
        """Upper bound of the support."""
        return max(component.upper for component in self.components)

    @property
    def n_parameters(self) -> int:
        """Number of free parameters: those of the components, plus the number of weights minus one."""
        return sum(component.n_parameters for component in self.components) + len(self.weights) - 1

    def rebounded(self, lower: float, upper: float) -> Self:
        """Return the mixture with the same weights, whose components have the support [lower, upper)."""
        return type(self)(self.weights, [component.rebounded(lower, upper) for component in self.components])

    def interval_probability(self, start: ArrayLike, end: ArrayLike) -> Array:
        """Return P(start <= X < end), element by element; that of each component keeps its digits."""
        start, end = np.broadcast_arrays(np.asarray(start, dtype=float), np.asarray(end, dtype=float))
        total = np.zeros(start.shape)
        for weight, component in zip(self.weights, self.components, strict=True):
            reached = (start < component.upper) & (end > component.lower)
            total[reached] += weight * component.interval_probability(start[reached], end[reached])
        return total

    def leaves(self) -> Iterator[tuple[float, Tiltable]]:
        """Yield weight and distribution of each component; of a mixture among them, those of its components.

        The weight is the product along the nesting.
        """
        for weight, component in zip(self.weights, self.components, strict=True):
            for share, leaf in component.leaves():
                yield weight * share, leaf

    def to_dict(self) -> dict[str, Any]:
        """Return the kind, the weights and the components of the mixture as a dictionary for JSON."""
        components = [component.to_dict() for component in self.components]
        return {"kind": self.kind, "weights": list(self.weights), "components": components}

    @classmethod
    def from_content(cls, content: Mapping[str, Any]) -> Self:
        """Build the mixture from the dictionary that `to_dict` returned, without the kind."""
        return cls(content["weights"], [from_dict(component) for component in content["components"]])

    @cached_property
    def _log_weights(self) -> Array:
        return np.log(np.asarray(self.weights))

    def _log_sum(self, method: str, x: ArrayLike) -> Array:
        """Log of the weighted sum over components of exp(method(x)), for a method such as ``logpdf``."""
        terms = [
            log_weight + getattr(component, method)(x)
            for log_weight, component in zip(self._log_weights, self.components, strict=True)
        ]
        return np.logaddexp.reduce(terms)

    def logpdf(self, x: ArrayLike) -> Array:
        """Return the log density at x; -inf outside the support."""
        return self._log_sum("logpdf", x)

    def logsf(self, x: ArrayLike) -> Array:
        """Return log P(X > x)."""
        return self._log_sum("logsf", x)

    def cdf(self, x: ArrayLike) -> Array:
        """Return P(X <= x)."""
        return self._average(component.cdf(x) for component in self.components)

    def mean(self) -> float:
        """Return the mean E X."""
        return float(self._average(component.mean() for component in self.components))

    def _average(self, values: Iterable[ArrayLike]) -> Array:
        return sum(weight * np.asarray(value) for weight, value in zip(self.weights, values, strict=True))

    def ppf(self, q: ArrayLike) -> Array:
        """Return the quantile x with P(X <= x) = q.

        It is found numerically between the smallest and the largest quantile of the components.
        """
        return self._invert(q, "ppf", "cdf")

    def isf(self, q: ArrayLike) -> Array:
        """Return x with P(X > x) = q, which is found numerically between the quantiles of the components."""
        return self._invert(q, "isf", "sf")

    @np.errstate(over="ignore", invalid="ignore")
    def _invert(self, q: ArrayLike, inverse: str, function: str) -> Array:
        shape, q = np.shape(q), np.ravel(np.asarray(q, dtype=float))
        quantiles = [getattr(component, inverse)(q) for component in self.components]
        low, high = np.minimum.reduce(quantiles), np.maximum.reduce(quantiles)
        # The error is relative, so that quantiles in a far tail have as many digits as in the middle.
        scale = np.maximum(q, np.finfo(float).tiny)

        def error(x: Array, q: Array, scale: Array) -> Array:
            return (getattr(self, function)(x) - q) / scale

        found = find_root(error, (low, high), args=(q, scale))
        # If rounding hides the change of sign, or an end is infinite, the better end is the solution.
        at_low, at_high = (np.abs(error(end, q, scale)) for end in (low, high))
        return np.where(found.success, found.x, np.where(at_low <= at_high, low, high)).reshape(shape)

    def rvs(self, generator: np.random.Generator, size: int) -> Array:
        """Return independent draws from the mixture, shape (size,).

        For each draw a component is chosen by the weights, and then a value is drawn from this component.
        """
        which = generator.choice(len(self.weights), size=size, p=self.weights)
        draws = np.empty(size)
        for index, component in enumerate(self.components):
            chosen = which == index
            draws[chosen] = component.rvs(generator, int(np.count_nonzero(chosen)))
        return draws

    @property
    def theta_limit(self) -> float:
        """Upper limit of theta in `tilt`: the smallest limit of the components."""
        return min(component.theta_limit for component in self.components)

    def _cumulants(self, theta: float) -> Array:
        return self._log_weights + [component.cumulant(theta) for component in self.components]

    def cumulant(self, theta: float) -> float:
        """Return kappa(theta) = log E exp(theta X)."""
        return float(logsumexp(self._cumulants(theta)))

    def tilt(self, theta: float) -> Self:
        """Return the exponentially tilted mixture, with density proportional to exp(theta x) f(x).

        Every component is tilted, and its weight is multiplied by its moment generating function at theta.
        The weights are then divided by their sum.
        """
        cumulants = self._cumulants(theta)
        weights = np.exp(cumulants - logsumexp(cumulants))
        # Weights must be positive, so a weight that underflows becomes the smallest positive double.
        weights = np.maximum(weights, np.finfo(float).tiny)
        return type(self)(weights / weights.sum(), [component.tilt(theta) for component in self.components])


@distribution("piecewise mixture")
class PiecewiseMixture(Mixture):
    """The paper's piecewise mixture, whose component i has the support [gamma_(i-1), gamma_i) (equation 5).

    ValueError is raised if a component does not begin where the previous one ends.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        for left, right in zip(self.components, self.components[1:], strict=False):
            if left.upper != right.lower:
                raise ValueError(
                    f"pieces must join: one ends at {left.upper}, the next is from {right.lower}"
                )

    @property
    def knots(self) -> tuple[float, ...]:
        """The inner truncation points gamma_1 .. gamma_(k-1)."""
        return tuple(component.lower for component in self.components[1:])

    def rebounded(self, lower: float, upper: float) -> Self:
        """Return the mixture with the outer bounds ``lower`` and ``upper``; the inner knots do not change."""
        return self.with_bounds([lower, *self.knots, upper])

    def with_bounds(self, bounds: Sequence[float]) -> Self:
        """Return a mixture with the same pieces and weights, and with truncation points gamma_0 .. gamma_k.

        ``bounds`` contains these k + 1 points in increasing order.
        """
        pieces = zip(self.components, pairwise(bounds), strict=True)
        return type(self)(self.weights, [piece.rebounded(low, high) for piece, (low, high) in pieces])

    def piece_index(self, x: ArrayLike) -> np.ndarray:
        """Return the index of the piece that contains each x, counted from 0."""
        return np.searchsorted(self.knots, x, side="right")

    def ppf(self, q: ArrayLike) -> Array:
        """Return the quantile x with P(X <= x) = q, computed piece by piece (paper, appendix A)."""
        return self._invert_pieces(q, "ppf", np.cumsum(self.weights[:-1]), range(len(self.weights)))

    def isf(self, q: ArrayLike) -> Array:
        """Return x with P(X > x) = q, computed piece by piece from the right for accuracy in far tails."""
        order = range(len(self.weights) - 1, -1, -1)
        return self._invert_pieces(q, "isf", np.cumsum(self.weights[:0:-1]), order)

    def _invert_pieces(self, q: ArrayLike, inverse: str, ends: Array, order: Sequence[int]) -> Array:
        """Return quantiles, piece by piece, by the method ``"ppf"`` or ``"isf"`` of the pieces.

        ``ends`` are the cumulative weights of the pieces in the given order, without the last one.
        """
        q = np.asarray(q, dtype=float)
        position = np.searchsorted(ends, q, side="right")
        bounds = np.concatenate([[0.0], ends, [1.0]])
        x = np.full(q.shape, np.nan)
        for place, index in enumerate(order):
            chosen = position == place
            if np.any(chosen):
                before = (q[chosen] - bounds[place]) / self.weights[index]
                after = (bounds[place + 1] - q[chosen]) / self.weights[index]
                share = np.clip(np.where(before < after, before, 1 - after), 0, 1)
                x[chosen] = getattr(self.components[index], inverse)(share)
        return x

    def accelerated(self, thetas: Sequence[float], weights: Sequence[float]) -> "PiecewiseMixture":
        """Return the paper's proposal f*: the mixture with tilted pieces and new weights (section V.B)."""
        pieces = [piece.tilt(theta) for piece, theta in zip(self.components, thetas, strict=True)]
        return PiecewiseMixture(tuple(weights), tuple(pieces))


def match_mean(distribution: Tiltable, mean: float) -> float:
    """Return the theta for which the exponentially tilted distribution has a given mean.

    The mean of the tilted distribution, kappa'(theta), increases strictly with theta, so there is one root.
    The Cross-Entropy update of a one-parameter exponential family has this form (section V.B). ValueError is
    raised if the mean is outside the support, if the support has no lower bound, or if no theta is found.
    """
    if not -math.inf < distribution.lower < mean < distribution.upper:
        bounds = f"({distribution.lower}, {distribution.upper}), bounded below"
        raise ValueError(f"the mean must lie inside {bounds}, got {mean}")

    def excess(theta: float) -> float:
        return distribution.tilt(theta).mean() - mean

    start = excess(0.0)
    if start == 0:
        return 0.0
    limit = distribution.theta_limit
    for doubling in range(60):
        step = math.copysign(2.0**doubling / (mean - distribution.lower), -start)
        if step >= limit:
            step = limit * (1 - 2.0 ** -(doubling + 1))
        if excess(step) * start <= 0:
            return brentq(excess, *sorted((0.0, step)), xtol=1e-14 * abs(step), rtol=1e-14)
    raise ValueError(f"no tilt of {distribution} has the mean {mean}")
