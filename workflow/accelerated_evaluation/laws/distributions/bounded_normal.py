"""Bounded normal distribution (paper, section III.B.2)."""

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.special import erfcx, log_ndtr, ndtri_exp

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import ConvergenceError
from accelerated_evaluation.laws.distributions.bounded_exponential import LEAST, Bounded
from accelerated_evaluation.laws.distributions.described import Parameter, distribution
from accelerated_evaluation.laws.distributions.mixture import Mixture

TOLERANCE = 1e-10  # gain of log-likelihood for each observation below which EM has converged
_NODES, _NODE_WEIGHTS = np.polynomial.legendre.leggauss(12)
_MOMENT_NODES, _MOMENT_WEIGHTS = np.polynomial.legendre.leggauss(64)


@distribution("bounded normal")
@dataclass(frozen=True)
class BoundedNormal(Bounded):
    """Normal distribution with ``location`` and ``sd``, conditional on ``[lower, upper)``."""

    sd: float  # of the unconditional normal distribution, positive
    lower: float = 0.0
    upper: float = math.inf
    # Mean of the unconditional normal distribution. It is 0 for the distributions that the paper fits, and
    # theta sd^2 after tilting such a distribution by theta.
    location: float = 0.0

    parameters: ClassVar[Mapping[str, Parameter]] = {"sd": Parameter(power=1, symbol=r"\sigma")}

    def __post_init__(self) -> None:
        if not self.lower < self.upper:
            raise ValueError(f"bounds must satisfy lower < upper, got [{self.lower}, {self.upper})")
        if not (self.sd > 0 and math.isfinite(self.sd) and math.isfinite(self.location)):
            raise ValueError(f"sd must be positive and finite, got sd {self.sd}, location {self.location}")

    @classmethod
    def from_second_moment(cls, second_moment: float, lower: float, upper: float) -> "BoundedNormal":
        """Return the bounded normal with location 0 on [lower, upper), lower >= 0, that has the given E X^2.

        This solves the maximum-likelihood equation, since E X^2 increases strictly with the standard
        deviation. ConvergenceError is raised if no standard deviation gives the moment because the sample is
        uniform or increasing, or if the moment is so small that squares lose accuracy.
        """
        if second_moment < LEAST**2:
            raise ConvergenceError(
                f"bounded normal on [{lower:g}, {upper:g})",
                reached=f"second moment {second_moment:g}",
                limit=f"{LEAST**2:g}, below which squares lose their digits",
                change="Check the data for a wrong unit, or for rounding errors in place of zeros.",
            )
        scale = math.sqrt(second_moment)

        def excess(log_sd: float) -> float:
            return cls(math.exp(log_sd), lower, upper).second_moment() - second_moment

        low, high = math.log(scale) - 7, math.log(scale) + 7
        if not excess(low) < 0 < excess(high):
            flattest = second_moment + excess(high)
            raise ConvergenceError(
                f"bounded normal on [{lower:g}, {upper:g})",
                reached=f"second moment {second_moment:g}",
                limit=f"{flattest:g}, that of a uniform density",
                change="The density does not decrease from the lower bound; use bounded exponential pieces "
                "(configuration key models) or move the knots.",
            )
        return cls(math.exp(brentq(excess, low, high, xtol=1e-13)), lower, upper)

    @classmethod
    def fit(cls, x: Array, lower: float, upper: float) -> "BoundedNormal":
        """Return the maximum-likelihood fit with location 0 to a sample x, shape (n,), on [lower, upper).

        ``lower`` must not be negative. The errors are those of `from_second_moment`.
        """
        return cls.from_second_moment(float(np.mean(np.square(x))), lower, upper)

    @classmethod
    def fit_mixture(
        cls,
        x: Array,
        lower: float,
        upper: float,
        components: int,
        *,
        maximum_iterations: int = 2000,
        on_iteration: Callable[[float], None] = lambda _: None,
    ) -> Mixture:
        """Return a mixture of bounded normals with location 0, fitted by EM (paper, appendix B).

        Each iteration consists of three EM steps. The fit has converged when an iteration increases the
        log-likelihood by less than `TOLERANCE` per observation. ConvergenceError is raised if it has not
        after ``maximum_iterations``. ``on_iteration`` is called in each iteration with the log-likelihood,
        which never decreases. The sample is on [lower, upper), lower >= 0.
        """
        squares, shares = np.square(x), np.full(components, 1 / components)
        sds = math.sqrt(squares.mean()) * np.geomspace(0.5, 1.5, components)
        mixture, previous = Mixture(shares, [cls(sd, lower, upper) for sd in sds.tolist()]), -math.inf
        for _ in range(maximum_iterations):
            first, log_likelihood = _em_step(mixture, squares)
            on_iteration(log_likelihood)
            if log_likelihood - previous < TOLERANCE * x.size:
                return _by_sd(mixture)
            mixture, previous = _em_leap(mixture, first, squares), log_likelihood
        raise ConvergenceError(
            f"EM for {components} bounded normals on [{lower:g}, {upper:g})",
            reached=f"log-likelihood {previous:.6f}",
            limit=f"{maximum_iterations} iterations",
            change="Use fewer components or more data.",
        )

    def _peak(self, low: Array | float, high: Array | float) -> Array:
        return np.clip(self.location, low, high)

    def _log_relative(self, x: ArrayLike, reference: ArrayLike) -> Array:
        distances = np.subtract(x, self.location) + np.subtract(reference, self.location)
        return -np.subtract(x, reference) * distances / (2 * self.sd**2)

    def _integral(self, low: Array | float, high: Array | float) -> Array:
        peak = self._peak(low, high)
        offset = np.abs(peak - self.location)
        return self._fall(offset, peak - low) + self._fall(offset, high - peak)

    def _fall(self, offset: Array, width: Array) -> Array:
        """Integral of the density over [offset, offset + width], divided by the density at ``offset``.

        Both are distances from the location.
        """
        if not np.any(width):  # for example if the peak is at a bound of the support
            return np.zeros(np.broadcast_shapes(np.shape(offset), np.shape(width)))
        exponent = width * (2 * offset + width) / (2 * self.sd**2)
        scale = self.sd * math.sqrt(2)
        far = erfcx(offset / scale) - np.exp(-exponent) * erfcx((offset + width) / scale)
        far = far * scale * math.sqrt(math.pi) / 2
        short = exponent < 1
        if not np.any(short):
            return far
        # On short intervals the two terms are nearly equal, and the density hardly changes, so that a
        # quadrature is accurate.
        width = np.where(short, width, 0.0)[..., None]
        t = width * (_NODES + 1) / 2
        density = np.exp(-t * (2 * offset[..., None] + t) / (2 * self.sd**2))
        near = (density * _NODE_WEIGHTS).sum(axis=-1) * width[..., 0] / 2
        return np.where(short, near, far)

    def ppf(self, q: ArrayLike) -> Array:
        """Return the quantile x with P(X <= x) = q (paper, appendix A), which is computed in logarithms."""
        q = np.asarray(q, dtype=float)
        with np.errstate(divide="ignore"):
            return self._quantile(np.log(q), np.log1p(-q))

    def isf(self, q: ArrayLike) -> Array:
        """Return x with P(X > x) = q, accurate for small q."""
        q = np.asarray(q, dtype=float)
        with np.errstate(divide="ignore"):
            return self._quantile(np.log1p(-q), np.log(q))

    def _quantile(self, log_below: Array, log_above: Array) -> Array:
        """Return the point with the given log shares of the mass below and above it."""
        a, b = ((bound - self.location) / self.sd for bound in (self.lower, self.upper))
        log_cdf = np.logaddexp(log_above + log_ndtr(a), log_below + log_ndtr(b))
        log_sf = np.logaddexp(log_above + log_ndtr(-a), log_below + log_ndtr(-b))
        # The side with the smaller probability is inverted, because it is more accurate.
        side, smaller = np.where(log_cdf < log_sf, 1, -1), np.minimum(np.minimum(log_cdf, log_sf), 0)
        standardised = side * ndtri_exp(smaller)
        return np.clip(self.location + self.sd * standardised, self.lower, self.upper)

    def mean(self) -> float:
        """Return the mean E X."""
        distance, share = self._quadrature()
        return self._mode + float((distance * share).sum())

    def second_moment(self) -> float:
        """Return E X^2, which the maximum-likelihood equation of ``sd`` sets equal to the sample moment."""
        distance, share = self._quadrature()
        return float((np.square(self._mode + distance) * share).sum())

    def _quadrature(self) -> tuple[Array, Array]:
        """Return Gauss-Legendre nodes, as distances from the mode, and their shares of the probability.

        The nodes span the part of the support where the density is above exp(-40) of its largest value.
        """
        mode = self._mode
        offset = abs(mode - self.location)
        reach = 80 * self.sd**2 / (offset + math.sqrt(offset**2 + 80 * self.sd**2))
        low, high = max(self.lower - mode, -reach), min(self.upper - mode, reach)
        distance = (low + high) / 2 + (high - low) / 2 * _MOMENT_NODES
        share = _MOMENT_WEIGHTS * np.exp(self._log_relative(mode + distance, mode))
        return distance, share / share.sum()

    theta_limit = math.inf

    def tilt(self, theta: float) -> "BoundedNormal":
        """Return the distribution with density proportional to exp(theta x) times this density (IV.B).

        It is a bounded normal distribution whose location is larger by theta sd^2.
        """
        return BoundedNormal(self.sd, self.lower, self.upper, self.location + theta * self.sd**2)


def _em_step(mixture: Mixture, squares: Array) -> tuple[Mixture, float]:
    """Take one EM step, given the squares of the sample, shape (n,).

    Return the new mixture, and the log-likelihood of the mixture before the step.
    """
    lower, upper = mixture.lower, mixture.upper
    joint = np.stack(
        [
            math.log(p) + f.logpdf(lower) - (squares - lower**2) / (2 * f.sd**2)
            for p, f in zip(mixture.weights, mixture.components, strict=True)
        ]
    )
    total = np.logaddexp.reduce(joint)
    responsibility = np.exp(joint - total)
    share = responsibility.sum(axis=1)
    # No matrix product is used, because its rounding depends on the number of threads.
    second_moments = (responsibility * squares).sum(axis=1) / share
    components = [BoundedNormal.from_second_moment(float(moment), lower, upper) for moment in second_moments]
    return Mixture(share / share.sum(), components), float(total.sum())


def _em_leap(mixture: Mixture, first: Mixture, squares: Array) -> Mixture:
    """Take the second EM step of an iteration and, if extrapolation helps, a third one from there.

    EM converges slowly if the normals overlap, because its steps then become short. Squared extrapolation
    (Varadhan and Roland 2008) continues in the direction of the first two steps. The extrapolated point is
    used only if its likelihood is not lower than the likelihood after the first step.
    """
    second, at_first = _em_step(first, squares)
    # The extrapolated point may lie outside the range of the parameters; the second step is then returned.
    with suppress(ConvergenceError, ValueError):
        stabilized, at_extrapolated = _em_step(_extrapolate((mixture, first, second)), squares)
        if at_extrapolated >= at_first:
            return stabilized
    return second


@np.errstate(over="ignore", invalid="ignore")
def _extrapolate(path: tuple[Mixture, Mixture, Mixture]) -> Mixture:
    """Extrapolate three mixtures, in log shares and log standard deviations, or raise ValueError.

    The error means that the result is infinite or not a number; see `_em_leap`.
    """
    start, first, second = (
        np.log([*mixture.weights, *(component.sd for component in mixture.components)]) for mixture in path
    )
    step, bend = first - start, second - 2 * first + start
    length = min(-math.sqrt(step @ step / (bend @ bend)), -1.0) if np.any(bend) else -1.0
    shares, sds = np.split(np.exp(start - 2 * length * step + length**2 * bend), 2)
    bounds = path[-1].lower, path[-1].upper
    return Mixture(shares / shares.sum(), [BoundedNormal(sd, *bounds) for sd in sds.tolist()])


def _by_sd(mixture: Mixture) -> Mixture:
    """Order the components by standard deviation, so that equal fits give equal files."""
    order = np.argsort([component.sd for component in mixture.components])
    return Mixture([mixture.weights[i] for i in order], [mixture.components[i] for i in order])
