"""Families of accelerated distributions of one variable and their Cross-Entropy updates (section V.B)."""

import math
from dataclasses import dataclass, replace

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.distributions import (
    BoundedExponential,
    PiecewiseMixture,
    Tiltable,
    match_mean,
)

LARGE = 0.1  # weight from which a piece is large; the paper gives no number (section V.C.2)


@dataclass(frozen=True)
class SingleFamily:
    """The family of the authors' earlier method: f* is one exponential distribution on [lower, inf)."""

    distribution: BoundedExponential

    @classmethod
    def start(cls, model: Tiltable) -> "SingleFamily":
        """Return the family at the start of a search: the exponential that has the mean of the model."""
        return cls(BoundedExponential.from_mean(model.mean(), model.lower))

    def update(self, x: Array, weight: Array) -> "SingleFamily":
        """Return the family whose exponential has the weighted mean of the events, values x, as its mean."""
        mean = float(np.average(x, weights=weight))
        return SingleFamily(BoundedExponential.from_mean(mean, self.distribution.lower))

    def is_determined(self, x: Array, weight: Array) -> bool:
        """Return True, because the one rate is estimated from all events."""
        return True

    def raised(self, step: float, x: Array | None) -> "SingleFamily":
        """Return the family itself, because it has no truncation points."""
        return self

    def parameters(self) -> dict[str, float]:
        """Return the rate, in the inverse unit of the variable."""
        return {"rate": self.distribution.rate}


@dataclass(frozen=True)
class PiecewiseFamily:
    """The family in which every piece of the model has its own tilt and weight (section V.B).

    The tilt theta of a piece multiplies its density by exp(theta x) and normalises it again.
    """

    model: PiecewiseMixture  # the pieces that are tilted: f, or f with shifted truncation points
    thetas: tuple[float, ...]
    weights: tuple[float, ...]
    minimum_weight: float  # lower bound of the weights, so that f* is positive wherever f is (section V.C.3)
    minimum_events: int  # a piece in which a sample has fewer events keeps its theta (section V.C.4)

    @classmethod
    def start(cls, model: Tiltable, minimum_weight: float, minimum_events: int) -> "PiecewiseFamily":
        """Return the family with which a search starts: the model, with small weights raised to the bound.

        A model that is no mixture is one piece.
        """
        if not isinstance(model, PiecewiseMixture):
            model = PiecewiseMixture((1.0,), (model,))
        weights = bounded_weights(np.asarray(model.weights), minimum_weight)
        return cls(model, (0.0,) * len(weights), weights, minimum_weight, minimum_events)

    @property
    def distribution(self) -> PiecewiseMixture:
        """f* with the current parameters."""
        return self.model.accelerated(self.thetas, self.weights)

    def update(self, x: Array, weight: Array) -> "PiecewiseFamily":
        """Return the family with new weights, and a new theta of every piece with enough events.

        The new weight of a piece is its share of the sum of the importance weights, or the lower bound if the
        share is smaller. The new theta of a piece makes its mean equal to the weighted mean of the events in
        the piece. The theta of an unbounded tail may not be negative: if f* had a lighter tail than f, the
        likelihood ratios could have an infinite variance, which a sample does not reveal. The events have
        values x and importance weights, shape (n,).
        """
        piece, shares = self.model.piece_index(x), self._shares(x, weight)
        # Subnormal weights have lost digits, so a mean that is computed only from them would be inaccurate.
        heavy = weight > np.finfo(float).tiny
        thetas = list(self.thetas)
        for index, component in enumerate(self.model.components):
            inside = (piece == index) & heavy
            if np.count_nonzero(inside) >= self.minimum_events:
                mean = _inner_mean(float(np.average(x[inside], weights=weight[inside])), component)
                theta = match_mean(component, mean)
                thetas[index] = max(theta, 0.0) if math.isinf(component.upper) else theta
        return replace(self, thetas=tuple(thetas), weights=bounded_weights(shares, self.minimum_weight))

    def is_determined(self, x: Array, weight: Array) -> bool:
        """Return whether each piece with a share of the weight of at least `LARGE` has enough events."""
        counts = np.bincount(self.model.piece_index(x), minlength=len(self.weights))
        return bool(np.all((counts >= self.minimum_events) | (self._shares(x, weight) < LARGE)))

    def _shares(self, x: Array, weight: Array) -> Array:
        """Return the share of each piece in the sum of the weights of the events, shape (k,)."""
        inside = self.model.piece_index(x)
        return np.bincount(inside, weights=weight, minlength=len(self.weights)) / weight.sum()

    @property
    def tail_is_full(self) -> bool:
        """Whether the tail has its largest possible weight, with all other weights at the lower bound."""
        return self.weights[-1] >= 1 - (len(self.weights) - 1) * self.minimum_weight - 1e-9

    def raised(self, step: float, x: Array | None) -> "PiecewiseFamily":
        """Return the family with truncation points one step higher if its tail has its largest weight.

        If the values x of events are given, the last truncation point stays at least one step below all.
        """
        if not (step > 0 and self.tail_is_full):
            return self
        has_room = x is None or self.model.knots[-1] + 2 * step <= x.min()
        return self.shifted(step) if has_room else self

    def shifted(self, shift: float) -> "PiecewiseFamily":
        """Return the family with the truncation points between pieces moved up by ``shift`` (V.C.5).

        The lower end of the first piece is not moved.
        """
        bounds = [self.model.lower, *(knot + shift for knot in self.model.knots), math.inf]
        return replace(self, model=self.model.with_bounds(bounds))

    def parameters(self) -> dict[str, float]:
        """Return the weight, theta and lower bound of each piece, counted from 1."""
        pieces = zip(self.weights, self.thetas, self.model.components, strict=True)
        return {
            f"{name}_{index}": value
            for index, (weight, theta, component) in enumerate(pieces, start=1)
            for name, value in (("weight", weight), ("theta", theta), ("from", component.lower))
        }


# A parametric family of f* for one variable, with its current parameters.
ProposalFamily = SingleFamily | PiecewiseFamily


def bounded_weights(shares: Array, minimum: float) -> tuple[float, ...]:
    """Return weights that are proportional to given shares, are at least ``minimum``, and sum to one.

    Shares that would be below the minimum are raised to it, and the others are scaled. Among all weights with
    this lower bound, the result maximises sum_i shares_i log weights_i. ValueError is raised if k times the
    minimum is not between 0 and 1.
    """
    if not 0 < minimum * shares.size < 1:
        raise ValueError(
            f"{shares.size} weights cannot sum to one and each be at least {minimum}; the minimum must be "
            f"positive and below {1 / shares.size:.3g}"
        )
    low = np.zeros(shares.size, dtype=bool)
    while True:
        free = np.where(low, 0.0, shares)
        weights = np.where(low, minimum, free / free.sum() * (1 - minimum * low.sum()))
        if np.all(weights >= minimum):
            return tuple(weights.tolist())
        low |= weights < minimum


def _inner_mean(mean: float, component: Tiltable) -> float:
    """Move a mean at least 2 % of the width of a bounded piece away from its edges.

    A mean at an edge would give a distribution f* that is concentrated there.
    """
    if math.isinf(component.upper):
        return mean
    margin = 0.02 * (component.upper - component.lower)
    return min(max(mean, component.lower + margin), component.upper - margin)
