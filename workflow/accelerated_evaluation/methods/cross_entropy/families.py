"""Families of accelerated distributions of one variable and their Cross-Entropy updates (section V.B)."""

import math
from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.distributions import BoundedExponential, PiecewiseMixture, Tiltable, match_mean


class ProposalFamily(Protocol):
    """A parametric family of f* for one variable, with its current parameters."""

    @property
    def distribution(self) -> Tiltable:
        """The distribution with the current parameters."""

    def update(self, x: Array, weight: Array) -> Self:
        """Maximize sum_n weight_n log f_theta(x_n) over the parameters (the Cross-Entropy step).

        ``x`` and ``weight`` have shape (n,); only events, with positive weights, are passed.
        """

    def parameters(self) -> dict[str, float]:
        """Return the parameters by name, for the trace."""


@dataclass(frozen=True)
class SingleFamily:
    """One exponential on [lower, inf): the authors' earlier, single parametric f*."""

    distribution: BoundedExponential

    @classmethod
    def start(cls, model: Tiltable) -> "SingleFamily":
        """Start at the exponential that has the mean of the model."""
        return cls(BoundedExponential.from_mean(model.mean(), model.lower))

    def update(self, x: Array, weight: Array) -> "SingleFamily":
        """Match the weighted mean of the events."""
        mean = float(np.average(x, weights=weight))
        return SingleFamily(BoundedExponential.from_mean(mean, self.distribution.lower))

    def parameters(self) -> dict[str, float]:
        """Return the rate."""
        return {"rate": self.distribution.rate}


@dataclass(frozen=True)
class PiecewiseFamily:
    """The family in which every piece of the model has its own tilt and weight (18 parameters in all).

    Parameters
    ----------
    model
        The pieces that are tilted: f, or f with shifted truncation points.
    thetas, weights
        Tilt and weight of each of the k pieces.
    minimum_weight
        Lower bound of the weights, so that f* keeps the support of f (section V.C.3).
    minimum_events
        A piece with fewer events keeps its theta (section V.C.4).
    """

    model: PiecewiseMixture
    thetas: tuple[float, ...]
    weights: tuple[float, ...]
    minimum_weight: float
    minimum_events: int

    @classmethod
    def start(cls, model: PiecewiseMixture, minimum_weight: float, minimum_events: int) -> "PiecewiseFamily":
        """Start at the model itself, with weights raised to the lower bound."""
        weights = bounded_weights(np.asarray(model.weights), minimum_weight)
        return cls(model, (0.0,) * len(weights), weights, minimum_weight, minimum_events)

    @property
    def distribution(self) -> PiecewiseMixture:
        """f* with the current parameters."""
        return self.model.accelerated(self.thetas, self.weights)

    def update(self, x: Array, weight: Array) -> "PiecewiseFamily":
        """Update the weights (equation pi_update), and the theta of every piece with enough events.

        The theta of an unbounded tail is not allowed to be negative. With a lighter tail than that of f, the
        likelihood ratios could have an infinite variance, which samples do not show.
        """
        piece = self.model.piece_index(x)
        shares = np.bincount(piece, weights=weight, minlength=len(self.weights)) / weight.sum()
        # A weight that underflows has lost its digits, and a piece with no other has lost its mean.
        heavy = weight > np.finfo(float).tiny
        thetas = list(self.thetas)
        for index, component in enumerate(self.model.components):
            inside = (piece == index) & heavy
            if np.count_nonzero(inside) >= self.minimum_events:
                mean = _inner_mean(float(np.average(x[inside], weights=weight[inside])), component)
                theta = match_mean(component, mean)
                thetas[index] = max(theta, 0.0) if math.isinf(component.upper) else theta
        return replace(self, thetas=tuple(thetas), weights=bounded_weights(shares, self.minimum_weight))

    @property
    def tail_is_full(self) -> bool:
        """Whether the tail piece has the largest weight that the lower bound allows."""
        return self.weights[-1] >= 1 - (len(self.weights) - 1) * self.minimum_weight - 1e-9

    def shifted(self, shift: float) -> "PiecewiseFamily":
        """Return the family with its truncation points moved up by ``shift`` (section V.C.5).

        The first truncation point is not moved.
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


def bounded_weights(shares: Array, minimum: float) -> tuple[float, ...]:
    """Raise shares below ``minimum`` to it, and scale the others so that the sum is one.

    Among all weights with this bound, the result maximizes sum_i shares_i log weights_i.

    Raises
    ------
    ValueError
        If the sum of the bounds exceeds one.
    """
    if not 0 < minimum * shares.size < 1:
        raise ValueError(f"{shares.size} weights cannot all be at least {minimum}, positive, and sum to one")
    low = np.zeros(shares.size, dtype=bool)
    while True:
        free = np.where(low, 0.0, shares)
        weights = np.where(low, minimum, free / free.sum() * (1 - minimum * low.sum()))
        if np.all(weights >= minimum):
            return tuple(weights.tolist())
        low |= weights < minimum


def _inner_mean(mean: float, component: Tiltable) -> float:
    """Keep a mean from the very edge of a bounded piece, where f* would become a needle."""
    if math.isinf(component.upper):
        return mean
    margin = 0.02 * (component.upper - component.lower)
    return min(max(mean, component.lower + margin), component.upper - margin)
