"""Factors of the hazard where only a few records are, which vary smoothly over lead speed and range.

Under a law, the cumulative hazards of the records have a unit exponential distribution at every place, that
is, at every pair of lead speed and range. The hazard of the closing speed is multiplied by a factor in each
layer of the cumulative hazard, beyond the levels that 100, 10 and 1 records should exceed. In layer l, the
factor at a place is

    f_l(place) = common_l exp(field_l(place)).

The common factors have independent gamma priors. The fields say how the factors vary over the places. They
are sums of the splines by which the scale of the excess varies, and have a Gaussian process as their prior.
The field of a layer continues the field of the layer above it: it is equal to that field plus a process with
the same distribution as the field of the first layer. The standard deviation of this process decides how much
the factors of different places are pooled. Its posterior follows from the records, so that it is small if
the records support one factor for all places.

Given the fields, the common factors have gamma posteriors and are integrated out. What remains is a concave
function of the fields plus their Gaussian log prior, and its normal (Laplace) approximation is accurate.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, reduce
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.special import softmax

from accelerated_evaluation.base.arrays import Array, numbers_in
from accelerated_evaluation.base.compiling import cached_njit
from accelerated_evaluation.base.linear_systems import solve
from accelerated_evaluation.laws.smooth.splines import Basis

RECORDS = np.array([100, 10, 1])  # numbers of records that are expected beyond the levels
# Shape and rate of the gamma prior of a common factor. With probability 80 % it is between 0.27 and 1.94. For
# comparison: from 3 to 9 scales above the threshold, the hazard of a generalised Pareto law of shape 0.3
# changes by a factor of 0.5, and that of a law of shape -0.1, which ends after 10 scales, by a factor of 7.
SHAPE = 2.0
# Standard deviations of the change of the log factor of a place from one layer to the next, which are equally
# probable before the records are known. The largest is the prior standard deviation of log common factors.
DEVIATIONS = (0.0, 0.2, 0.4, 0.6, 0.8)
CORRELATION = 0.5  # length scale of the fields, as a share of the interval of each variable
KEPT = 0.95  # share of the variance of the fields that their principal components represent
STEPS, TOLERANCE = 30, 1e-4  # largest number of Newton steps; gain in log density at which they end


@dataclass(frozen=True)
class Layers:
    """Factors of the hazard in layers of the cumulative hazard; there is no factor below the first level."""

    levels: Array  # cumulative hazards at which the layers begin, rising, (layers,)
    factors: Array  # in each layer, (layers,), (layers, n) for n places, or (layers, K, n) for K draws

    def only(self, places: NDArray[np.intp] | slice | None) -> Self:
        """Return the factors at some places, by index; at all places without it."""
        return self if places is None else replace(self, factors=self.factors[..., places])

    def cumulative(self, original: Array) -> Array:
        """Return the cumulative hazard with the factors, given the one without them, of the same shape."""
        value = np.minimum(original, self.levels[0])
        # The hazard of a Gompertz tail grows exponentially, up to the largest number there is. A factor
        # above 1 then makes it infinite, which is right: the probability of an excess is 0 either way.
        with np.errstate(over="ignore"):
            for level, width, factor in zip(self.levels, self._widths, self.factors, strict=True):
                value = value + factor * np.clip(original - level, 0, width)
        return value

    def original(self, cumulative: Array) -> Array:
        """Return the cumulative hazard without the factors; the inverse of `cumulative`."""
        value, rest = np.minimum(cumulative, self.levels[0]), cumulative - self.levels[0]
        for width, factor in zip(self._widths, self.factors, strict=True):
            value = value + np.clip(rest / factor, 0, width)
            rest = rest - factor * width
        return value

    def log_density_ratio(self, original: Array) -> Array:
        """Return log(density with the factors / density without them), given the original hazards."""
        log_factor = np.zeros(1)
        for level, factor in zip(self.levels, np.log(self.factors), strict=True):
            log_factor = np.where(original > level, factor, log_factor)
        with np.errstate(invalid="ignore"):  # where the hazard is infinite, the density is 0 in any case
            change = original - self.cumulative(original)
        return np.where(np.isinf(original), 0.0, log_factor + change)

    @property
    def _widths(self) -> Array:
        return np.diff(self.levels, append=np.inf)


@dataclass(frozen=True)
class FarTail:
    """Factors of the hazard in each layer as functions of the place."""

    levels: Array  # cumulative hazards at which the layers begin, rising, (layers,)
    # Coefficients of the p splines of the log factor, (layers, p), or (layers, K, p) for K draws.
    log_factors: Array

    @classmethod
    def stacked(cls, tails: Sequence[Self]) -> Self:
        """Return the far tails of K draws of a law, which have the same levels, as one object."""
        return cls(tails[0].levels, np.stack([tail.log_factors for tail in tails], axis=1))

    def at(self, splines: Array) -> Layers:
        """Return the factors at n places, given the values of their splines, (n, p)."""
        return Layers(self.levels, np.exp(self.log_factors @ splines.T))

    def content(self) -> dict[str, Any]:
        """Return the content of the law file: levels and coefficients of the log factors."""
        return {"levels": self.levels.tolist(), "log_factors": self.log_factors.tolist()}

    @classmethod
    def from_content(cls, content: Mapping[str, Any]) -> Self:
        """Build the far tail from the value that `content` returned."""
        return cls(numbers_in(content["levels"]), numbers_in(content["log_factors"]))


@dataclass(frozen=True)
class FarPrior:
    """Prior of the factors of a far tail."""

    shape: float = SHAPE  # shape and rate of the gamma prior of the common factors
    deviations: tuple[float, ...] = DEVIATIONS  # equally probable standard deviations of the fields

    def posterior(
        self, cumulative: Array, splines: Array, bases: tuple[Basis, ...], levels: Array
    ) -> "FarPosterior":
        """Return the posterior, given cumulative hazards of n records, and splines at their places, (n, p).

        The mean of the fields over the places of the records is 0. Records below the first of the ``levels``
        serve only for this purpose.
        """
        beyond = cumulative > levels[0]
        components, centre = field_components(bases), splines.sum(axis=0) / max(len(splines), 1)
        inside = np.clip(cumulative[beyond] - levels[:, None], 0, np.diff(levels, append=np.inf)[:, None])
        reached = cumulative[beyond] > levels[:, None]
        ended = reached & ~np.vstack([reached[1:], np.zeros(reached.shape[1], dtype=bool)])
        fields = (splines[beyond] - centre) @ components
        # The splines sum to 1, so that a constant is a change of all coefficients.
        return FarPosterior(self, levels, ended, inside, fields, components - centre @ components)


@lru_cache
def field_components(bases: tuple[Basis, ...]) -> Array:
    """Return the principal components of the fields, scaled by their standard deviations, shape (p, J).

    The coefficients of the splines have the covariance of a Gaussian process with a squared exponential
    kernel of variance 1, evaluated where the splines have their maxima.
    """

    def kernel(basis: Basis) -> Array:
        middles = np.arange(basis.size) / basis.segments
        return np.exp(-((middles[:, None] - middles) ** 2) / (2 * CORRELATION**2))

    variances, vectors = np.linalg.eigh(reduce(np.kron, map(kernel, bases)))
    kept = np.flatnonzero(np.cumsum(variances) > (1 - KEPT) * variances.sum())
    return vectors[:, kept] * np.sqrt(variances[kept])


@dataclass(frozen=True)
class FarPosterior:
    """Posterior of the factors of a far tail, given the cumulative hazards of n records under a law.

    The fields are linear functions of variables z with independent standard normal priors, one for each of J
    components in each layer.
    """

    prior: FarPrior
    levels: Array  # cumulative hazards at which the layers begin, (layers,)
    ended: NDArray[np.bool_]  # whether a record ends in a layer, (layers, n)
    inside: Array  # part of the cumulative hazard of a record that is in a layer, (layers, n)
    fields: Array  # values of the components at the places of the records, (n, J)
    components: Array  # coefficients of the splines of the components, (p, J)

    def mean(self) -> FarTail:
        """Return the far tail with the posterior means of the fields, and of the factors given these."""
        fields = np.tensordot(self._evidence, [mode.fields(np.zeros_like(mode.z)) for mode in self._modes], 1)
        return self._tail(fields, self._shapes / self._rates(fields))

    def drawn(self, generator: np.random.Generator) -> FarTail:
        """Return a far tail with factors drawn from their posterior."""
        mode = self._modes[generator.choice(len(self._modes), p=self._evidence)]
        noise = generator.standard_normal(mode.z.size)
        fields = mode.fields(solve_triangular(cholesky(mode.information), noise))
        return self._tail(fields, generator.gamma(self._shapes) / self._rates(fields))

    def _tail(self, fields: Array, common: Array) -> FarTail:
        return FarTail(self.levels, np.log(common)[:, None] + fields @ self.components.T)

    @property
    def _shapes(self) -> Array:
        """Shapes of the gamma posteriors of the common factors, (layers,)."""
        return self.prior.shape + self.ended.sum(axis=1)

    def _rates(self, fields: Array) -> Array:
        """Return the rates of these posteriors, (layers,), given coefficients of the fields, (layers, J)."""
        return self.prior.shape + np.sum(self.inside * np.exp(fields @ self.fields.T), axis=1)

    @cached_property
    def _modes(self) -> list["Mode"]:
        """The posterior of the fields for each standard deviation; each search begins at the mode before."""
        modes, z = [], np.zeros((self.levels.size, self.fields.shape[1]))
        records = self.ended @ self.fields, self.inside, self.fields, self._shapes, self.prior.shape
        for deviation in self.prior.deviations:
            modes.append(Mode(deviation, *_maximise(deviation, z, *records)))
            z = modes[-1].z
        return modes

    @cached_property
    def _evidence(self) -> Array:
        """Posterior probabilities of the standard deviations."""
        return softmax([mode.log_evidence for mode in self._modes])


@dataclass(frozen=True)
class Mode:
    """Normal approximation of the posterior of the fields, given their standard deviation."""

    deviation: float
    z: Array  # the mode, (layers, J)
    information: Array  # at the mode, about z.ravel()
    log_evidence: float  # log of the marginal likelihood of the standard deviation

    def fields(self, away: Array) -> Array:
        """Return the coefficients of the fields, (layers, J), at the mode plus a difference of z."""
        return self.deviation * np.cumsum(self.z + away.reshape(self.z.shape), axis=0)


def levels_of(size: int, lowest: float) -> Array:
    """Return the cumulative hazards beyond which `RECORDS` of so many records are expected, shape (layers,).

    A level is not below ``lowest``.
    """
    return np.maximum(np.log(size / RECORDS), lowest)


@cached_njit()
def _maximise(
    deviation: float, z: Array, ended: Array, inside: Array, fields: Array, shapes: Array, rate: float
) -> tuple[Array, Array, float]:
    """Return the mode, (layers, J), the information there and the log evidence; see `_derivatives`."""
    for _ in range(STEPS):
        log_evidence, slope, information = _derivatives(z, deviation, ended, inside, fields, shapes, rate)
        pivots, step = information.copy(), slope.copy()
        solve(pivots, step)
        for row in range(z.size):
            log_evidence -= math.log(pivots[row, row]) / 2
        if np.sum(step * slope) < TOLERANCE:
            break
        z = z + step.reshape(z.shape)
    return z, information, log_evidence


@cached_njit()
def _derivatives(
    z: Array, deviation: float, ended: Array, inside: Array, fields: Array, shapes: Array, rate: float
) -> tuple[float, Array, Array]:
    """Return the log posterior density of z, (layers, J), its gradient and its information, up to a constant.

    The common factors are integrated out, and the information consists of minus the second derivatives.
    ``ended``, (layers, J), are sums of the ``fields`` of the records that end in each layer. For matrices of
    this size, loops are faster than products of matrices, and they compile in a small part of the time.
    """
    layers, size = z.shape
    log_density, field = 0.0, np.zeros(size)
    gradient, information = (-z).ravel(), np.eye(z.size)
    for layer in range(layers):
        of_rate, mean, squares = rate, np.zeros(size), np.zeros((size, size))
        for one in range(size):
            # The field of a layer is the sum of the changes up to it.
            field[one] += deviation * z[layer, one]
        for record in np.flatnonzero(inside[layer]):
            log_risk = 0.0
            for one in range(size):
                log_risk += fields[record, one] * field[one]
            at_risk = inside[layer, record] * math.exp(log_risk)
            of_rate += at_risk
            for one in range(size):
                mean[one] += at_risk * fields[record, one]
                for two in range(one + 1):
                    squares[one, two] += at_risk * fields[record, one] * fields[record, two]
        log_density -= shapes[layer] * math.log(of_rate)
        for one in range(size):
            log_density += ended[layer, one] * field[one] - z[layer, one] ** 2 / 2
            for row in range(one, (layer + 1) * size, size):
                gradient[row] += deviation * (ended[layer, one] - shapes[layer] * mean[one] / of_rate)
                for column in range((layer + 1) * size):
                    two = column % size
                    centred = squares[max(one, two), min(one, two)] - mean[one] * mean[two] / of_rate
                    information[row, column] += deviation**2 * shapes[layer] * centred / of_rate
    return log_density, gradient, information
