"""Maximum-likelihood estimates of the parameters of the candidate families.

Each function takes a sample of shape (n,): y = x - lower for families on a half-line, and x itself for
families on the whole line. The values lie inside the support and are not all equal. The function returns the
estimates in the order of `candidate_families`, where the densities are listed. If the likelihood has no
maximum, it raises NoMaximumError with the reason.

A likelihood equation with one root is solved by bracketing. A profile likelihood of one parameter is
evaluated on a grid and refined. The other likelihoods are maximized by gradient methods. Three likelihoods
are unbounded, and are maximized on a restricted set: shape >= -1 and an end of the support at a distance of
at least 1e-12 of the data's span (generalized Pareto, generalized extreme value), and more than k / (n - k)
degrees of freedom, where k is the largest number of equal values (t location-scale).
"""

from collections.abc import Callable
from functools import wraps

import numpy as np
from scipy import optimize, special

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import StudyError

Estimator = Callable[[Array], tuple[float, ...]]
Objective = Callable[[Array], tuple[float, Array]]

# Largest gradient per observation at a maximum, with respect to logarithms of parameters of a standardised
# sample. The error of the log-likelihood is then about n 1e-12.
GRADIENT_LIMIT = 1e-6
MOST_DEGREES = 1e6  # degrees of freedom above which the t distribution is regarded as normal
TO_ONE = np.concatenate([np.linspace(0, 0.9, 10), 1 - np.logspace(-1.3, -12, 33)])  # from 0 to almost 1


class NoMaximumError(StudyError):
    """Error for a family whose likelihood has no maximum for the sample; the message states the reason."""


def _root(gradient: Callable[[float], float], low: float, high: float) -> float:
    """Return the root of a function between two points; raise NoMaximumError without a change of sign."""
    if not gradient(low) * gradient(high) < 0:
        raise NoMaximumError("the values differ too little for double precision")
    return optimize.brentq(gradient, low, high, xtol=1e-14 * high)


def _climb(negative: Objective, starts: list[list[float]], bounds: list[tuple] | None = None) -> Array:
    """Return the best minimum reached from several starting points; it may be on a bound."""
    options = {"ftol": 1e-16, "gtol": GRADIENT_LIMIT / 100, "maxiter": 500}
    search = {"method": "L-BFGS-B", "jac": True, "bounds": bounds, "options": options}
    best = min((optimize.minimize(negative, start, **search) for start in starts), key=lambda end: end.fun)
    if bounds is not None and any(v in bound for v, bound in zip(best.x, bounds, strict=True)):
        return best.x
    gradient = np.abs(best.jac).max()
    if not gradient <= GRADIENT_LIMIT:
        raise NoMaximumError(f"no convergence: gradient {gradient:.1e} per value, limit {GRADIENT_LIMIT:.0e}")
    return best.x


def _scan(profile: Callable[[float], float], grid: Array) -> float:
    """Return the maximum point of `profile`: on a grid, and then between the neighbours of the best point."""
    values = [profile(t) for t in grid]
    i = int(np.argmax(values))
    low, high = grid[max(i - 1, 0)], grid[min(i + 1, grid.size - 1)]
    inside = optimize.minimize_scalar(
        lambda t: -profile(t), bounds=(low, high), method="bounded", options={"xatol": 1e-10 * (high - low)}
    )
    return float(inside.x if -inside.fun > values[i] else grid[i])


def _standardised(estimate: Estimator) -> Estimator:
    """Decorate an estimator of (location, scale, ...) so that it is applied to a standardised sample.

    The sample is (x - mean) / standard deviation. The estimates are transformed back to x.
    """

    @wraps(estimate)
    def fit(x: Array) -> tuple[float, ...]:
        mean, deviation = x.mean(), x.std()
        location, scale, *rest = estimate((x - mean) / deviation)
        return mean + deviation * location, deviation * scale, *rest

    return fit


def fit_beta(y: Array) -> tuple[float, float]:
    """Return the maximum-likelihood estimates of the two shapes of the beta distribution, given a sample y.

    The log-likelihood is strictly concave in the shapes.
    """
    log_means = np.array([np.log(y).mean(), np.log1p(-y).mean()])

    def negative(log_shapes: Array) -> tuple[float, Array]:
        shapes = np.exp(log_shapes)
        gradient = special.psi(shapes) - special.psi(shapes.sum()) - log_means
        return special.betaln(*shapes) - (shapes - 1) @ log_means, shapes * gradient

    mean = y.mean()
    total = mean * (1 - mean) / y.var() - 1
    return tuple(np.exp(_climb(negative, [[np.log(mean * total), np.log((1 - mean) * total)]])))


def fit_birnbaum_saunders(y: Array) -> tuple[float, float]:
    """Return the maximum-likelihood shape and scale of the Birnbaum-Saunders distribution, given a sample y.

    The likelihood equation of the scale has one root between the harmonic and the arithmetic mean of the
    sample (Birnbaum and Saunders 1969).
    """
    arithmetic, harmonic = y.mean(), 1 / (1 / y).mean()

    def gradient(scale: float) -> float:
        k = 1 / (1 / (scale + y)).mean()
        return scale**2 - scale * (2 * harmonic + k) + harmonic * (arithmetic + k)

    scale = _root(gradient, harmonic, arithmetic)
    return np.sqrt(arithmetic / scale + scale / harmonic - 2), scale


def fit_exponential(y: Array) -> tuple[float]:
    """Return the maximum-likelihood rate of the exponential distribution, 1 / mean, given a sample y."""
    return (1 / y.mean(),)


def _minima(x: Array, most: float = np.inf) -> tuple[float, float]:
    """Return location and scale (at most `most`) of the extreme value distribution of minima.

    The scale is the only root of (mean weighted by exp(x / scale)) - mean - scale, which decreases with the
    scale. The root is below max - mean and above (max - mean) / (3 log n + 1), and therefore above
    (max - mean) / 1000.
    """
    top, mean = x.max(), x.mean()

    def gradient(scale: float) -> float:
        weights = np.exp((x - top) / scale)
        return weights @ x / weights.sum() - mean - scale

    scale = min(_root(gradient, 1e-3 * (top - mean), top - mean), most)
    return top + scale * np.log(np.exp((x - top) / scale).mean()), scale


@_standardised
def fit_extreme_value(x: Array) -> tuple[float, float]:
    """Return the maximum-likelihood location and scale of the extreme value distribution of minima.

    Argument x is the sample.
    """
    return _minima(x)


def fit_gamma(y: Array) -> tuple[float, float]:
    """Return the maximum-likelihood estimates of shape and scale of the gamma distribution, given a sample y.

    The likelihood equation is log(shape) - psi(shape) = log(mean y) - mean(log y). Its left side lies between
    1 / (2 shape) and 1 / shape, which gives a bracket for the root.
    """
    gap = -np.log(y / y.mean()).mean()
    shape = _root(lambda k: np.log(k) - special.psi(k) - gap, 0.5 / gap, 1 / gap)
    return shape, y.mean() / shape


def _log_ratio(theta: float, x: Array) -> Array:
    """Return log(1 + theta x) / theta, which is x for theta = 0."""
    return np.log1p(theta * x) / theta if theta else x


def _capped(scale: float, theta: float) -> float:
    """Return the scale, reduced if necessary so that shape = theta scale >= -1."""
    return min(scale, -1 / theta) if theta < 0 else scale


def _interior(theta: float, grid: Array) -> float:
    """Return theta; raise NoMaximumError if it is at an end of the grid."""
    if theta in (grid[0], grid[-1]):
        towards = "shape -1, below which it is unbounded" if theta == grid[0] else "infinite shapes"
        raise NoMaximumError(f"the likelihood has no interior maximum: it rises towards {towards}")
    return theta


@_standardised
def fit_generalized_extreme_value(x: Array) -> tuple[float, float, float]:
    """Return the maximum-likelihood location, scale and shape of the generalized extreme value distribution.

    Argument x is the sample. The profile likelihood of a parameter theta is maximized. For fixed theta,
    w = -log(1 + theta x) / theta has the extreme value distribution of minima, with the scale shape / theta.
    """
    grid = np.concatenate([-TO_ONE[::-1] / x.max(), TO_ONE[1:] / -x.min()])

    def law(theta: float) -> tuple[float, float, float]:
        w = -_log_ratio(theta, x)
        return w.mean(), *_minima(w, _capped(np.inf, theta))

    def profile(theta: float) -> float:
        mean, location, scale = law(theta)
        return (mean - location) / scale - 1 - np.log(scale) + theta * mean

    theta = _interior(_scan(profile, grid), grid)
    _, location, scale = law(theta)
    centre = np.expm1(-location * theta) / theta if theta else -location
    return centre, scale * np.exp(-location * theta), theta * scale


def fit_generalized_pareto(y: Array) -> tuple[float, float]:
    """Return the maximum-likelihood shape and scale of the generalized Pareto distribution, given a sample y.

    The profile likelihood of theta = shape / scale is maximized. For fixed theta, log(1 + theta y) / theta
    has an exponential distribution with mean ``scale``.
    """
    unit = y / y.mean()
    grid = np.concatenate([-TO_ONE[::-1] / unit.max(), np.logspace(-3, 12, 46)])

    def profile(theta: float) -> float:
        mean = _log_ratio(theta, unit).mean()
        scale = _capped(mean, theta)
        return -np.log(scale) - mean / scale - theta * mean

    theta = _interior(_scan(profile, grid), grid)
    scale = _log_ratio(theta, unit).mean()
    return theta * scale, y.mean() * scale


def fit_inverse_gaussian(y: Array) -> tuple[float, float]:
    """Return the maximum-likelihood mean and shape of the inverse Gaussian distribution, given a sample y."""
    return y.mean(), 1 / (1 / y - 1 / y.mean()).mean()


@_standardised
def fit_logistic(x: Array) -> tuple[float, float]:
    """Return the maximum-likelihood location and scale of the logistic distribution, given a sample x.

    The log-likelihood is strictly concave in location / scale and 1 / scale.
    """

    def negative(p: Array) -> tuple[float, Array]:
        z = (x - p[0]) / np.exp(p[1])
        slope = np.tanh(z / 2)
        value = p[1] + (np.abs(z) + 2 * np.log1p(np.exp(-np.abs(z)))).mean()
        return value, np.array([-slope.mean() / np.exp(p[1]), 1 - (z * slope).mean()])

    location, log_scale = _climb(negative, [[0.0, np.log(np.sqrt(3) / np.pi)]])
    return location, np.exp(log_scale)


def fit_log_logistic(y: Array) -> tuple[float, float]:
    """Return the maximum-likelihood shape and scale of the log-logistic distribution, given a sample y.

    They follow from a logistic fit to log y.
    """
    location, scale = fit_logistic(np.log(y))
    return 1 / scale, np.exp(location)


def fit_lognormal(y: Array) -> tuple[float, float]:
    """Return the maximum-likelihood mean and standard deviation of log y, for a lognormal sample y."""
    return fit_normal(np.log(y))


def fit_nakagami(y: Array) -> tuple[float, float]:
    """Return the maximum-likelihood shape and spread of the Nakagami distribution, given a sample y.

    y^2 has a gamma distribution with this shape, and its mean is the spread.
    """
    return fit_gamma(y**2)[0], (y**2).mean()


def fit_normal(x: Array) -> tuple[float, float]:
    """Return the maximum-likelihood mean and standard deviation of the normal distribution for a sample x."""
    return x.mean(), x.std()


def fit_pareto(ratio: Array) -> tuple[float]:
    """Return the maximum-likelihood estimate of the Pareto shape, given the ratios x / lower."""
    return (1 / np.log(ratio).mean(),)


def fit_rayleigh(y: Array) -> tuple[float]:
    """Return the maximum-likelihood scale of the Rayleigh distribution of a sample y, sqrt(mean(y^2)/2)."""
    return (np.sqrt((y**2).mean() / 2),)


def fit_rician(y: Array) -> tuple[float, float]:
    """Return the maximum-likelihood estimates of noncentrality c >= 0 and scale s of the Rician distribution.

    Argument y is the sample. At the maximum c^2 + 2 s^2 = mean(y^2), so the profile likelihood of
    q = c^2 / mean(y^2) is maximized.
    """
    root = np.sqrt((y**2).mean())
    unit = y / root

    def profile(q: float) -> float:
        noncentrality, variance = np.sqrt(q), (1 - q) / 2
        square = (unit - noncentrality) ** 2 / (2 * variance)
        return (np.log(special.i0e(unit * noncentrality / variance)) - square).mean() - np.log(variance)

    q = _scan(profile, TO_ONE)
    if profile(q) - profile(0.0) < 1e-14:  # the profile is flat at 0, and rounding may move its maximum
        q = 0.0
    return root * np.sqrt(q), root * np.sqrt((1 - q) / 2)


@_standardised
def fit_t(x: Array) -> tuple[float, float, float]:
    """Return the maximum-likelihood location, scale and degrees of freedom of the t distribution.

    Argument x is the sample. A gradient method searches for the maximum from three starting points: two with
    heavy tails, and one from the moments of the sample.
    """
    ties = np.unique(x, return_counts=True)[1].max()
    bounds = [(None, None), (np.log(1e-8), None), (np.log(ties / (x.size - ties)), np.log(MOST_DEGREES))]

    def negative(p: Array) -> tuple[float, Array]:
        scale, nu = np.exp(p[1:])
        z = (x - p[0]) / scale
        logs = np.log1p(z**2 / nu).mean()
        weighted = (nu + 1) / (nu + z**2) * z
        pull = (weighted * z).mean()
        constant = special.gammaln((nu + 1) / 2) - special.gammaln(nu / 2) - np.log(nu * np.pi) / 2
        rise = special.psi((nu + 1) / 2) - special.psi(nu / 2) - 1 / nu - logs + pull / nu
        gradient = -np.array([weighted.mean() / scale, pull - 1, nu * rise / 2])
        return p[1] + (nu + 1) / 2 * logs - constant, gradient

    excess = max((x**4).mean() - 3, 6 / MOST_DEGREES)
    starts = [[np.median(x), np.log(0.5), np.log(nu)] for nu in (1, 4)] + [[0, 0, np.log(4 + 6 / excess)]]
    best = _climb(negative, starts, bounds)
    if best[1] == bounds[1][0] or best[2] == bounds[2][0]:
        raise NoMaximumError(f"the likelihood is unbounded around a value that occurs {ties} times")
    if best[2] == bounds[2][1] or negative(best)[0] >= (1 + np.log(2 * np.pi)) / 2:
        raise NoMaximumError("the likelihood rises up to infinite degrees of freedom, the normal")
    return best[0], *np.exp(best[1:])


def fit_weibull(y: Array) -> tuple[float, float]:
    """Return the maximum-likelihood shape and scale of the Weibull distribution, given a sample y.

    They follow from an extreme value fit to log y.
    """
    location, scale = fit_extreme_value(np.log(y))
    return 1 / scale, np.exp(location)
