"""The directions in a space of many normal scores on which the outcomes of the runs depend.

The graded outcomes are regressed on z M and on the distance of z from the origin. The size of a column of M
is the inverse of a length (Tripathy, Bilionis and Gonzalez 2016). A small new column v changes the log
evidence by v' L v, so that it starts along the eigenvector of L with the largest eigenvalue. Arbitrary
directions are compared with single inputs, with a cost for the number of parameters.
"""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from fewruns.arrays import Array, Flags
from fewruns.constants import (
    AMPLITUDE_SPREAD,
    COST,
    FIRST_NOISE,
    LOG_DIRECTION_BOUNDS,
    MOST_DIRECTIONS,
    MOST_RUNS,
    MOST_STEPS,
    NOISE,
    OUTWARD,
    OUTWARD_SPREAD,
    STARTS,
)
from fewruns.gaussian_process import covariance_of_runs, negative_log_posterior, thinned
from fewruns.graded import evidence_of, graded
from fewruns.pools import outward

# Prior mean and standard deviation of three logarithms: inverse length outward, amplitude and noise.
CENTRE = np.log([OUTWARD, 1.0, NOISE[0]])
SCALE = np.array([OUTWARD_SPREAD, AMPLITUDE_SPREAD, NOISE[1]])


def learn_directions(z: Array, happened: Flags, score: Array, before: Array | None) -> Array:
    """Return the directions on which the outcomes depend, divided by their lengths, as columns, shape (d, k).

    Earlier directions, ``before``, are a further starting point of the optimisation.
    """
    outcome = graded(happened, score)
    kept = thinned(np.argsort(outcome, kind="stable"), MOST_RUNS)
    regression = _Regression(z[kept], outcome[kept])
    first = np.log([OUTWARD, 1.0, FIRST_NOISE])
    none = regression.optimise(_Model(np.zeros((z.shape[1], 0)), first))
    found = [regression.grown(none, single=single) for single in (False, True)]
    if before is not None:
        again = regression.optimise(_Model(before, first))
        found.append(regression.grown(again, single=not again.free.all()))
    return min(found, key=lambda model: model.loss).directions


@dataclass(frozen=True)
class _Model:
    """The parameters of the regression."""

    # The matrix M, shape (d, k); an entry that is exactly 0 is fixed, and all others are parameters.
    directions: Array
    others: Array  # logarithms of the inverse length outward, of the amplitude and of the noise, shape (3,)
    loss: float = math.inf  # negative log posterior density plus the cost of the parameters

    @property
    def free(self) -> NDArray[np.bool_]:
        """Whether each entry of the matrix M is a free parameter, shape (d, k)."""
        return self.directions != 0

    @property
    def cost(self) -> float:
        """The cost of the parameters, without those of a rotation of the columns that changes nothing."""
        (d, k), inputs = self.directions.shape, self.free.any(axis=1).sum()
        turned = k * (k - 1) / 2 if self.free.sum() == inputs * k else 0
        return COST * (self.free.sum() - turned) + (math.log(d) * inputs if inputs < d else 0.0)

    @property
    def vector(self) -> Array:
        """All parameters of the model in one vector."""
        return np.append(self.directions[self.free], self.others)

    def at(self, vector: Array) -> Self:
        """Return the model whose parameters have the values in ``vector``, in the order of `vector`."""
        directions = np.zeros(self.directions.shape)
        directions[self.free] = vector[: -len(self.others)]
        return type(self)(directions, vector[-len(self.others) :])

    def with_column(self, column: Array) -> Self:
        """Return the model with an additional column of M, shape (d,)."""
        return type(self)(np.column_stack([self.directions, column]), self.others)


class _Regression:
    """Gaussian process regression of outcomes on a few directions, with its posterior density."""

    def __init__(self, z: Array, outcome: Array) -> None:
        self._z, self._outcome = z, outcome
        self._outward = outward((z * z).sum(1), z.shape[1])

    def optimise(self, model: _Model) -> _Model:
        """Return the model at a maximum of the posterior density, found from a given model by L-BFGS-B."""
        free = model.free
        bounds = [(None, None)] * int(free.sum()) + [*LOG_DIRECTION_BOUNDS]

        def loss(vector: Array) -> tuple[float, Array]:
            value, gradient, _ = self.posterior(model.at(vector), free)
            return value, gradient

        steps = {"maxiter": MOST_STEPS}
        found = minimize(loss, model.vector, method="L-BFGS-B", jac=True, bounds=bounds, options=steps)
        return replace(model.at(found.x), loss=float(found.fun) + model.cost)

    def grown(self, model: _Model, *, single: bool) -> _Model:
        """Return a model with one to `MOST_DIRECTIONS` columns, as long as each reduces the loss."""
        d, k = model.directions.shape
        while k < min(MOST_DIRECTIONS, d - 1):
            _, _, growth = self.posterior(model, model.free)
            if single:
                gain = np.where(model.free.any(axis=1), -np.inf, np.diag(growth))
                column = np.eye(d)[gain.argmax()]
            else:
                column = np.linalg.eigh(growth)[1][:, -1]
            tried = [model.with_column(start * column) for start in STARTS]
            best = min(tried, key=lambda other: self.posterior(other, other.free)[0])
            wider = self.optimise(best)
            if k > 0 and wider.loss > model.loss:
                break
            model, k = wider, k + 1
        return model

    def posterior(self, model: _Model, free: NDArray[np.bool_]) -> tuple[float, Array, Array]:
        """Return the negative log posterior density, its gradient, and the matrix L of the module."""
        along, others = model.directions, model.others
        scale, (variance, noise) = math.exp(others[0]), np.exp(2 * others[1:])
        points = np.column_stack([self._z @ along, self._outward * scale])
        covariance, slope = covariance_of_runs(points, variance, with_slope=True)
        evidence, outer = evidence_of(covariance, self._outcome, noise)
        by_square = -0.5 * variance * slope * outer  # derivative with respect to the squared distances
        growth = _sum_over_pairs(self._z, by_square)
        by_outward = 2 * scale**2 * _sum_over_pairs(self._outward[:, None], by_square).item()
        by_others = [by_outward, 2 * (outer * covariance).sum(), 2 * noise * np.trace(outer)]
        gradient = np.append((2 * growth @ along)[free], by_others)
        width = np.sqrt(np.broadcast_to(free.sum(axis=0), free.shape)[free])  # 1 / prior standard deviation
        score = np.append(along[free] * width, (others - CENTRE) / SCALE)
        value, slope_of_loss = negative_log_posterior(evidence, gradient, score, np.append(1 / width, SCALE))
        return float(value), slope_of_loss, growth


def _sum_over_pairs(z: Array, weight: Array) -> Array:
    """Return the sum over all pairs of weight_ij (z_i - z_j) (z_i - z_j)', shape (d, d)."""
    return 2 * (z.T @ (weight.sum(axis=1)[:, None] * z) - z.T @ (weight @ z))
