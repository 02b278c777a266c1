"""A smooth hazard: a nonparametric distribution of a positive variable given two covariates.

The log hazard is a tensor product of penalised splines of the two covariates and of the variable itself. The
data are binned, and the hazard is constant within a bin of the variable. The number of records in a bin is
then Poisson distributed given the time at risk in the bin (Holford 1980), so the fit is a Poisson regression
on arrays. "Time" is the term of survival analysis for the variable, which is a closing speed or a logarithm
of a range here. The smoothing parameters of the three directions maximize the marginal likelihood (Wood and
Fasiolo 2017).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import ConvergenceError
from accelerated_evaluation.laws.smooth.splines import Basis, Constant, Penalty, Tensor

ITERATIONS = 100  # largest number of Newton steps
TOLERANCE = 1e-5  # the iterations end if a Newton step is expected to gain less in log likelihood
SMALLEST_STEP = 1e-4  # smallest factor of a Newton step
ROUNDING = 1e-12  # relative rounding error of the log likelihood
SHORTEST = 1e-15  # least time at risk in a bin with records; with none the hazard would be infinite
LOG_HAZARD_MAX = 50.0  # prevents overflow in trial steps and in extrapolations from few records


@dataclass(frozen=True)
class HazardGrid:
    """Bins of two covariates and of the variable, and the spline bases over them."""

    # Of the two covariates and of the variable. The bins of the variable begin at 0 and are equally wide, and
    # beyond the last bin, the hazard is that of the last bin.
    edges: tuple[Array, Array, Array]
    bases: tuple[Basis | Constant, Basis | Constant, Basis]

    @cached_property
    def tensor(self) -> Tensor:
        """The tensor product of the bases, evaluated at the middles of the bins."""
        middles = [(edges[1:] + edges[:-1]) / 2 for edges in self.edges]
        return Tensor(tuple(basis(middle) for basis, middle in zip(self.bases, middles, strict=True)))

    def count(self, first: Array, second: Array, value: Array) -> "Binned":
        """Return the number of values in each bin, and the total time at risk in each bin."""
        shape = tuple(edges.size - 1 for edges in self.edges)
        place = [
            np.clip(np.searchsorted(edges, x, side="right") - 1, 0, edges.size - 2)
            for edges, x in zip(self.edges, (first, second, value), strict=True)
        ]
        index, size = np.ravel_multi_index(place, shape), int(np.prod(shape))
        counts = np.bincount(index, minlength=size).reshape(shape)
        spent = np.bincount(index, value - self.edges[2][place[2]], size).reshape(shape)
        later = np.cumsum(counts[..., ::-1], axis=2)[..., ::-1] - counts
        return Binned(counts, spent + later * np.diff(self.edges[2]))


@dataclass(frozen=True)
class Binned:
    """Counts of records and time at risk in each bin of a grid.

    A value on the lower edge of its bin, which is common for rounded records, has no time at risk in the bin.
    A small positive time is used instead, so that the hazard remains finite.
    """

    counts: Array
    exposure: Array

    def __post_init__(self) -> None:
        at_risk = np.where(self.counts > 0, np.maximum(self.exposure, SHORTEST), self.exposure)
        object.__setattr__(self, "exposure", at_risk)

    def __sub__(self, other: "Binned") -> "Binned":
        return Binned(self.counts - other.counts, np.maximum(self.exposure - other.exposure, 0))


@dataclass(frozen=True)
class SmoothHazard:
    """A fitted smooth hazard."""

    grid: HazardGrid
    coefficients: Array  # of the log hazard, with the shape of the tensor product
    smoothing: tuple[float, ...] = (1.0, 1.0, 1.0)  # smoothing parameters of the three directions
    # Upper Cholesky factor of the penalised information, with which coefficients are drawn from the
    # posterior; None if the law was read from a file.
    factor: Array | None = None

    def cumulative(self, splines: Array) -> "Cumulative":
        """Return n piecewise linear cumulative hazards, given products of splines of shape (n, p)."""
        along = np.tensordot(self.coefficients, self.grid.tensor.matrices[2], (2, 1))
        # Bins are the first axis in memory, because sums over them are then several times faster.
        hazard = along.reshape(-1, along.shape[2]).T @ splines.T
        np.exp(np.clip(hazard, -LOG_HAZARD_MAX, LOG_HAZARD_MAX, out=hazard), out=hazard)
        table = np.zeros((len(hazard) + 1, len(splines)))
        np.multiply(hazard, np.diff(self.grid.edges[2])[:, None], out=table[1:])
        for below, row in pairwise(table):
            row += below
        return Cumulative(self.grid.edges[2], hazard.T, table.T)

    def drawn(self, generator: np.random.Generator) -> "SmoothHazard":
        """Return the hazard with coefficients drawn from their approximately normal posterior.

        The roughness penalty acts as the prior.
        """
        noise = solve_triangular(self.factor, generator.standard_normal(self.coefficients.size))
        return replace(self, coefficients=self.coefficients + noise.reshape(self.coefficients.shape))


@dataclass(frozen=True)
class Cumulative:
    """Cumulative hazards as functions of the variable, given n values of the covariates."""

    edges: Array  # of the bins of the variable, (bins + 1,), equally spaced from 0 on
    hazard: Array  # hazard in each bin, (n, bins)
    table: Array  # cumulative hazard at the edges, (n, bins + 1)

    def at(self, value: Array, row: Array | None = None) -> Array:
        """Return the cumulative hazard at one value for each function (of index ``row``)."""
        bin_ = self.bin_of(value)
        # One index into the flat arrays, in which bins are the first axis.
        place = bin_ * len(self.table) + (np.arange(value.size) if row is None else row)
        table, hazard = self.table.T.ravel(), self.hazard.T.ravel()
        return table[place] + hazard[place] * (value - self.edges[bin_])

    def at_all(self, values: Array, part: slice) -> Array:
        """Return the cumulative hazards of a slice of k functions at the same m values, shape (m, k)."""
        bin_ = self.bin_of(values)
        table, hazard = (numbers.T[bin_, part] for numbers in (self.table, self.hazard))
        return table + hazard * (values - self.edges[bin_])[:, None]

    def rate(self, value: Array, row: Array | None = None) -> Array:
        """Return the hazard at given values of the variable, one value for each function.

        If ``row``, an array of indices of functions, is given, there is one value for each of its elements.
        """
        return self.hazard[np.arange(value.size) if row is None else row, self.bin_of(value)]

    def bin_of(self, value: Array) -> Array:
        """Return the index of the bin of each value; values beyond the last edge belong to the last bin.

        All bins are equally wide, so a division replaces the search for the bin, which is five times as fast.
        Because of rounding, it may put a value near an edge into the wrong bin. A comparison with the edges
        corrects this.
        """
        last = self.edges.size - 2
        bin_ = np.fmax(np.fmin(value / self.edges[1], last), 0).astype(int)
        bin_ -= value < self.edges[bin_]
        bin_ += value >= self.edges[bin_ + 1]
        return np.clip(bin_, 0, last)

    def inverse(self, level: ArrayLike) -> Array:
        """Return the value at which each of n cumulative hazards reaches its level, shape (n,)."""
        level = np.broadcast_to(np.asarray(level, dtype=float), len(self.table))
        bin_ = np.clip((self.table <= level[:, None]).sum(axis=1) - 1, 0, self.edges.size - 2)
        row = np.arange(len(self.table))
        return self.edges[bin_] + (level - self.table[row, bin_]) / self.hazard[row, bin_]


def fit_hazard(
    grid: HazardGrid,
    data: Binned,
    *,
    start: SmoothHazard | None = None,
) -> SmoothHazard:
    """Return a smooth hazard fitted to binned data by penalised Poisson regression.

    An earlier fit as ``start`` supplies starting values and the smoothing parameters, which are otherwise
    estimated. ConvergenceError is raised if the Newton iteration does not converge.
    """
    problem, known = _Problem(grid.tensor, data), None
    if start is None:
        begin = np.full(problem.tensor.shape, np.log(data.counts.sum() / data.exposure.sum()))
    else:
        begin, known = start.coefficients, start.smoothing
    coefficients, factor, smoothing = Penalty.of(grid.bases).maximised(problem.newton, begin, known)
    return SmoothHazard(grid, coefficients, smoothing, factor)


@dataclass(frozen=True)
class _Problem:
    """The penalised Poisson regression of one set of data."""

    tensor: Tensor
    data: Binned

    def newton(self, coefficients: Array, precision: Array) -> tuple[Array, Array]:
        """Return the coefficients that maximize the penalised likelihood, found from given coefficients.

        The second result is the Cholesky factor of the information there. ``precision`` is the precision
        matrix of the normal prior of the coefficients.
        """
        objective, hazard = self._objective(coefficients, precision)
        for _ in range(ITERATIONS):
            expected = self.data.exposure * hazard
            factor, _ = cho_factor(self.tensor.gram(expected) + precision)
            gradient = (
                self.tensor.transposed(self.data.counts - expected).ravel() - precision @ coefficients.ravel()
            )
            step = cho_solve((factor, False), gradient)
            gain, size = float(step @ gradient), 1.0
            while size > SMALLEST_STEP:
                trial = coefficients + size * step.reshape(coefficients.shape)
                value, hazard = self._objective(trial, precision)
                if value >= objective - ROUNDING * abs(objective):
                    break
                size /= 2
            coefficients, objective = trial, value
            if gain < TOLERANCE:
                return coefficients, np.triu(factor)
        change = "Use fewer splines."
        reached = f"a gain of {gain:.2g} in log likelihood"
        raise ConvergenceError("the smooth hazard", reached=reached, limit=f"{TOLERANCE:g}", change=change)

    def _objective(self, coefficients: Array, precision: Array) -> tuple[float, Array]:
        """Return the penalised log likelihood, and the hazard in each bin."""
        log_hazard = np.minimum(self.tensor.values(coefficients), LOG_HAZARD_MAX)
        flat, hazard = coefficients.ravel(), np.exp(log_hazard)
        likelihood = np.sum(self.data.counts * log_hazard - self.data.exposure * hazard)
        return float(likelihood - flat @ precision @ flat / 2), hazard
