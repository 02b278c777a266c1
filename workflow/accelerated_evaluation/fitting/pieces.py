"""Maximum likelihood for the pieces of a piecewise mixture (paper, section III.B)."""

import math
from collections.abc import Callable
from contextlib import suppress

import numpy as np
from scipy.optimize import brentq

from accelerated_evaluation.distributions import BoundedExponential, BoundedNormal, Mixture
from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.errors import ConvergenceError

Piece = BoundedExponential | BoundedNormal | Mixture


def fit_exponential(x: Array, lower: float, upper: float) -> BoundedExponential:
    """Fit a bounded exponential to x, shape (n,), on [lower, upper): its mean is the sample's mean."""
    return BoundedExponential.from_mean(float(np.mean(x)), lower, upper)


def fit_normal(second_moment: float, lower: float, upper: float) -> BoundedNormal:
    """Fit a bounded normal with mean 0 on [lower, upper), lower >= 0, to a sample's second moment.

    The maximum-likelihood equation matches E X^2, which rises strictly with the standard deviation.

    Raises
    ------
    ConvergenceError
        If the sample is too flat or rising for any standard deviation.
    """
    scale = math.sqrt(second_moment)

    def excess(log_sd: float) -> float:
        return BoundedNormal(math.exp(log_sd), lower, upper).second_moment() - second_moment

    low, high = math.log(scale) - 7, math.log(scale) + 7
    if not excess(low) < 0 < excess(high):
        flattest = second_moment + excess(high)
        raise ConvergenceError(
            f"bounded normal on [{lower:g}, {upper:g})",
            reached=f"second moment {second_moment:g}",
            limit=f"{flattest:g}, that of a uniform density",
            change="The data do not fall from the lower bound; use an exponential piece or move the knots.",
        )
    return BoundedNormal(math.exp(brentq(excess, low, high, xtol=1e-13)), lower, upper)


def fit_normal_mixture(
    x: Array,
    lower: float,
    upper: float,
    components: int,
    *,
    tolerance: float = 1e-10,
    maximum_iterations: int = 2000,
    on_iteration: Callable[[float], None] = lambda _: None,
) -> Mixture:
    """Fit a mixture of bounded normals with mean 0 by Expectation-Maximization (paper, appendix B).

    EM creeps where the normals overlap, so every third step extrapolates the two before it (squared
    extrapolation, Varadhan and Roland 2008) and is kept only if the likelihood rises.

    Parameters
    ----------
    x
        Sample, shape (n,), on [lower, upper), lower >= 0.
    lower, upper
        Bounds of the piece.
    components
        Number m of normals.
    tolerance, maximum_iterations
        It has converged when three steps gain less log-likelihood than ``tolerance`` per observation.
    on_iteration
        Called with the log-likelihood after every three steps; it never falls.

    Raises
    ------
    ConvergenceError
        If it has not converged after ``maximum_iterations``.
    """
    squares = np.square(x)
    spread = math.sqrt(squares.mean()) * np.geomspace(0.5, 1.5, components)
    mixture = Mixture(
        np.full(components, 1 / components), [BoundedNormal(sd, lower, upper) for sd in spread.tolist()]
    )
    previous = -math.inf
    for _ in range(maximum_iterations):
        first, log_likelihood = _em_step(mixture, squares)
        on_iteration(log_likelihood)
        if log_likelihood - previous < tolerance * x.size:
            return _by_sd(mixture)
        previous = log_likelihood
        second, at_first = _em_step(first, squares)
        path, mixture = (mixture, first, second), second
        with suppress(ConvergenceError, ValueError):
            stabilized, at_extrapolated = _em_step(_extrapolate(path), squares)
            if at_extrapolated >= at_first:
                mixture = stabilized
    raise ConvergenceError(
        f"EM for {components} bounded normals on [{lower:g}, {upper:g})",
        reached=f"log-likelihood {previous:.6f}",
        limit=f"{maximum_iterations} iterations",
        change="Use fewer components or more data.",
    )


def _em_step(mixture: Mixture, squares: Array) -> tuple[Mixture, float]:
    """One E and M step on the squared sample; also the log-likelihood of the mixture it began with."""
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
    # Not a product of matrices, whose rounding depends on the number of threads.
    second_moments = (responsibility * squares).sum(axis=1) / share
    components = [fit_normal(float(moment), lower, upper) for moment in second_moments]
    return Mixture(share / share.sum(), components), float(total.sum())


@np.errstate(over="ignore", invalid="ignore")
def _extrapolate(path: tuple[Mixture, Mixture, Mixture]) -> Mixture:
    """Squared extrapolation of three successive mixtures, in log shares and log standard deviations.

    Raises
    ------
    ValueError
        If it leads out of the range of numbers.
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
    """Order the components by standard deviation, so that equal fits are written equally."""
    order = np.argsort([component.sd for component in mixture.components])
    return Mixture([mixture.weights[i] for i in order], [mixture.components[i] for i in order])


def fit_piece(x: Array, lower: float, upper: float, family: str, components: int = 1) -> Piece:
    """Fit one piece: ``family`` is exponential or normal, the latter with any number of components."""
    if family == "exponential":
        return fit_exponential(x, lower, upper)
    if family != "normal":
        raise ValueError(f"family must be exponential or normal, got {family!r}")
    if components == 1:
        return fit_normal(float(np.mean(np.square(x))), lower, upper)
    return fit_normal_mixture(x, lower, upper, components)
