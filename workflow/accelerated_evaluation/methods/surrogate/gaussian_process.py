"""The surrogate of an event: the predicted probability of the event at any point.

This is Gaussian process classification of the flags: the probability is Phi(latent), where the latent
function is a Gaussian process. Its posterior is approximated by expectation propagation (Rasmussen and
Williams 2006, section 3.6). The lengths and the amplitude are those with the largest posterior density. Of
several sets of axes, the one with the largest such maximum is used.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotrs, dtrtri, dtrtrs
from scipy.optimize import minimize
from scipy.spatial import cKDTree
from scipy.special import log_ndtr, ndtr

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.compiling import cached_njit
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.methods.surrogate.constants import (
    AMPLITUDE,
    AMPLITUDE_SPREAD,
    DAMPING,
    FEW,
    FIRST_PRECISION,
    LEARNING_STEPS,
    LEAST_PRECISION,
    LEAST_VARIANCE,
    LENGTH,
    LENGTH_SPREAD,
    LOG_AMPLITUDE_BOUNDS,
    LOG_LENGTH_BOUNDS,
    MOST_RUNS,
    ROUGHLY_SETTLED,
    SETTLED,
    SWEEPS,
    VEHICLE_LENGTH,
)
from accelerated_evaluation.methods.surrogate.kernel import (
    covariance_between,
    covariance_of_runs,
    evidence_gradient,
    negative_log_posterior,
    thinned,
)

LOG_ROOT_2PI = 0.5 * math.log(2 * math.pi)


@cached_njit()
def _scale_both_sides(covariance: Array, root: Array, scaled: Array) -> None:
    """Write the lower triangle of I + S^1/2 K S^1/2 to ``scaled``, for a diagonal S^1/2 in ``root``."""
    for i in range(len(root)):
        for j in range(i):
            scaled[i, j] = root[i] * covariance[i, j] * root[j]
        scaled[i, i] = 1 + root[i] * covariance[i, i] * root[i]


def _log_evidence(
    factor: Array, sites: tuple[Array, Array], mean: Array, cavity: tuple[Array, Array], log_mass: Array
) -> float:
    """Return the log evidence of the flags by expectation propagation (Rasmussen and Williams, eq. 3.65).

    Parameters
    ----------
    factor
        Cholesky factor of I + S^1/2 K S^1/2, shape (n, n).
    sites, cavity
        Precision and precision times mean of the sites; precision and mean of the cavities; shapes (n,).
    mean, log_mass
        Posterior mean of the latent function, and log probability of each flag under its cavity, shapes (n,).
    """
    (precision, shift), (rest, centre) = sites, cavity
    both = precision + rest
    return (
        log_mass.sum()
        - np.log(np.diag(factor)).sum()
        + 0.5 * (np.log1p(precision / rest).sum() + shift @ mean - (shift * shift / both).sum())
        + 0.5 * (centre * rest / both * (precision * centre - 2 * shift)).sum()
    )


def selected_runs(runs: Array, event: NDArray[np.bool_], most: int) -> NDArray[np.intp]:
    """Return the indices of at most ``most`` runs to which a surrogate is fitted.

    If there are more runs, one half of the selection are those nearest to the boundary of the event, which
    are those with the smallest distance to a run of the opposite flag. The other half are runs at equal
    intervals in the order in which they were made, so that they represent all other regions.

    Parameters
    ----------
    runs
        Points in units of the lengths, shape (n, d).
    event
        Whether the event happened in each run, shape (n,).
    most
        Largest number of runs to return.
    """
    n = len(event)
    if n <= most:
        return np.arange(n)
    distance = np.full(n, np.inf)
    if event.any() and not event.all():
        distance[event] = cKDTree(runs[~event]).query(runs[event])[0]
        distance[~event] = cKDTree(runs[event]).query(runs[~event])[0]
    return thinned(np.argsort(distance, kind="stable"), most)


@dataclass(frozen=True)
class Predecessor:
    """Runs of a vehicle that is similar to the one under test, for example an earlier version of it.

    Attributes
    ----------
    z, happened
        Normal scores, shape (m, d), and whether the event happened, shape (m,).
    """

    z: Array
    happened: NDArray[np.bool_]

    def check(self, dimension: int) -> None:
        """Check that the runs can be used for a problem with a given number of normal scores.

        Raises
        ------
        InputError
            If there are more than `FEW` normal scores. The directions on which the event depends are then
            learnt from the scores of the runs, which are not known for a predecessor.
        ValueError
            If the shapes do not agree, or there is no event.
        """
        if dimension > FEW:
            change = "Leave the predecessor out: it would not save runs here."
            raise InputError(
                "predecessor", seen=f"{dimension} inputs", expected=f"at most {FEW}", change=change
            )
        if self.z.shape != (len(self.happened), dimension):
            raise ValueError(f"predecessor: points of shape {self.z.shape} for {len(self.happened)} flags")
        if not self.happened.any():
            raise ValueError("predecessor: no event in its runs")


class EventSurrogate:
    """Predicted probability of the event at any point, given the flags of the simulated points.

    The covariance of the latent function is that of `kernel`. If there is a predecessor, the points have one
    additional coordinate, 0 for the vehicle under test and 1 for the predecessor. The length of this
    coordinate is learnt like all others, and determines how much information the runs of one vehicle contain
    about the other.

    Parameters
    ----------
    dimension
        Number d of normal scores.
    predecessor
        Runs of a similar vehicle; None if there is none.
    amplitude
        Prior median of the amplitude, in units of the probit.

    Attributes
    ----------
    axes
        Directions along which the lengths are measured, as columns, shape (d, d).
    theta
        Logarithms of the lengths and of the amplitude, shape (d + 1,), or (d + 2,) with a predecessor.
    sites
        Precision, and precision times mean, of the Gaussian factor that approximates the likelihood of each
        flag, those of the predecessor first, shape (2, m + n).
    """

    def __init__(
        self, dimension: int, predecessor: Predecessor | None = None, amplitude: float = AMPLITUDE
    ) -> None:
        self._predecessor = predecessor
        lengths = [LENGTH * math.sqrt(dimension)] * dimension
        lengths += [VEHICLE_LENGTH] if predecessor else []
        self.axes = np.eye(dimension)
        self.theta = np.log([*lengths, amplitude])
        self.sites = np.empty((2, 0))
        self._kept = np.arange(0)
        self._centre = self.theta.copy()
        self._scale = np.array([*[LENGTH_SPREAD] * len(lengths), AMPLITUDE_SPREAD])

    def fit(self, z: Array, event: NDArray[np.bool_], *, learn: bool, turned: Sequence[Array] = ()) -> None:
        """Fit the surrogate to runs of the vehicle under test; its attributes are updated.

        Parameters
        ----------
        z, event
            Normal scores, shape (n, d), and flags, shape (n,); earlier runs first.
        learn
            Whether to learn axes, lengths and amplitude again.
        turned
            Axes that are compared with the original coordinates, each of shape (d, d).
        """
        if self._predecessor is not None:
            event = np.append(self._predecessor.happened, event)
        sign = np.where(event, 1.0, -1.0)
        if learn:
            found = [self._learn(axes, z, sign) for axes in (np.eye(z.shape[1]), *turned)]
            _, self.axes, self.theta = min(found, key=itemgetter(0))
            self.sites = np.empty((2, 0))
        runs, sign = self._keep(z, sign)
        self._lengths, self._variance = np.exp(self.theta[:-1]), math.exp(2 * self.theta[-1])
        self._runs = runs / self._lengths
        covariance, _ = covariance_of_runs(self._runs, self._variance)
        _, self._factor, self._root, self._weights = self._propagate(covariance, sign, tolerance=SETTLED)

    def _learn(self, axes: Array, z: Array, sign: Array) -> tuple[float, Array, Array]:
        """Return the smallest loss along given axes, the axes, and theta, optimised from the prior median."""
        self.axes, self.theta, self.sites = axes, self._centre.copy(), np.empty((2, 0))
        kept = self._keep(z, sign)
        bounds = [LOG_LENGTH_BOUNDS] * (len(self.theta) - 1) + [LOG_AMPLITUDE_BOUNDS]
        steps = {"maxiter": LEARNING_STEPS}
        found = minimize(self._loss, self.theta, kept, "L-BFGS-B", jac=True, bounds=bounds, options=steps)
        return float(found.fun), axes, found.x

    def _keep(self, z: Array, sign: Array) -> tuple[Array, Array]:
        """Return the runs for the fit, those of the predecessor first, and their signs; add missing sites."""
        runs = self._placed(z)
        if (other := self._predecessor) is not None:
            runs = np.vstack([np.column_stack([other.z @ self.axes, np.ones(len(other.z))]), runs])
        new = np.repeat([[FIRST_PRECISION], [0.0]], len(sign) - self.sites.shape[1], axis=1)
        self.sites = np.hstack([self.sites, new])
        self._kept = selected_runs(runs / np.exp(self.theta[:-1]), sign > 0, MOST_RUNS)
        return runs[self._kept], sign[self._kept]

    def probability(self, z: Array) -> Array:
        """Return the predicted probability of the event, shape (m,), at points z, shape (m, d)."""
        covariance = covariance_between(self._placed(z) / self._lengths, self._runs, self._variance)[0]
        mean = covariance @ self._weights
        covariance *= self._root
        # The transpose has the column order of LAPACK, so it is not copied.
        scaled = dtrtrs(self._factor, covariance.T, lower=1, overwrite_b=1)[0]
        variance = np.maximum(2 * self._variance - np.einsum("ij,ij->j", scaled, scaled), 0.0)
        return ndtr(mean / np.sqrt(1 + variance))

    def _placed(self, z: Array) -> Array:
        """Return points in coordinates along the axes, with the coordinate of the vehicle under test."""
        z = z @ self.axes
        return z if self._predecessor is None else np.column_stack([z, np.zeros(len(z))])

    def _propagate(
        self, covariance: Array, sign: Array, tolerance: float
    ) -> tuple[float, Array, Array, Array]:
        """Run expectation propagation until a step changes the log evidence by less than ``tolerance``.

        All sites are updated at once. The results are the log evidence, the Cholesky factor of
        I + S^1/2 K S^1/2, the diagonal of S^1/2, and the weights K^-1 m of the posterior mean m.
        """
        (precision, shift), previous = self.sites[:, self._kept], math.inf
        for _ in range(SWEEPS):
            root = np.sqrt(precision)
            factor = np.empty(covariance.shape, order="F")  # the column order of LAPACK avoids a copy
            _scale_both_sides(covariance, root, factor)
            factor, _ = dpotrf(factor, lower=1, clean=1, overwrite_a=1)
            inverse = dtrtri(factor, lower=1)[0]
            diagonal = np.einsum("ij,ij->j", inverse, inverse)  # of the inverse of I + S^1/2 K S^1/2
            variance = np.maximum(1 - diagonal, LEAST_VARIANCE) / precision
            weights = shift - root * dpotrs(factor, root * (covariance @ shift), lower=1)[0]
            mean = covariance @ weights
            # The cavity is the posterior without the site itself.
            rest = np.maximum(1 / variance - precision, LEAST_PRECISION)
            centre = (mean / variance - shift) / rest
            width = np.sqrt(1 + 1 / rest)
            score = sign * centre / width
            log_mass = log_ndtr(score)
            evidence = _log_evidence(factor, (precision, shift), mean, (rest, centre), log_mass)
            if abs(evidence - previous) < tolerance:
                break
            previous = evidence
            # The new site is such that cavity times site has the moments of cavity times probit. The ratio of
            # the normal density to its integral is computed from logarithms, because both may underflow.
            hazard = np.exp(-0.5 * score * score - LOG_ROOT_2PI - log_mass)
            matched_mean = centre + sign * hazard / (rest * width)
            matched_variance = 1 / rest - hazard * (score + hazard) / (rest * width) ** 2
            target = np.maximum(1 / matched_variance - rest, LEAST_PRECISION)
            precision = (1 - DAMPING) * precision + DAMPING * target
            shift = (1 - DAMPING) * shift + DAMPING * (matched_mean / matched_variance - centre * rest)
        self.sites[:, self._kept] = precision, shift
        return evidence, factor, root, weights

    def _loss(self, theta: Array, z: Array, sign: Array) -> tuple[float, Array]:
        """Return the negative log posterior density of log lengths and log amplitude, and its gradient."""
        variance = math.exp(2 * theta[-1])
        runs = z / np.exp(theta[:-1])
        covariance, slope = covariance_of_runs(runs, variance, with_slope=True)
        evidence, factor, root, weights = self._propagate(covariance, sign, tolerance=ROUGHLY_SETTLED)
        inverse = dtrtrs(factor, np.diag(root), lower=1)[0]
        outer = 0.5 * (np.outer(weights, weights) - inverse.T @ inverse)
        gradient = evidence_gradient(runs, covariance, slope, outer, variance)
        return negative_log_posterior(evidence, gradient, (theta - self._centre) / self._scale, self._scale)
