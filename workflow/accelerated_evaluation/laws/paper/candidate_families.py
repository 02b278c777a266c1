"""The 18 candidate families of distributions: support, estimator and density of each.

The support is fixed, not estimated. With y = x - lower, shape k and scale s, the densities (unless stated
otherwise) are

=========================  ==========================================================================
beta                       y^(a-1) (1-y)^(b-1) / B(a, b) on (0, 1), a first_shape, b second_shape
Birnbaum-Saunders          (sqrt(y/s) - sqrt(s/y)) / k is standard normal
exponential                rate exp(-rate y)
extreme value              exp(z - exp z) / s, z = (x - location) / s, the limit law of minima
gamma                      y^(k-1) exp(-y/s) / (Gamma(k) s^k)
generalized extreme value  cdf exp(-(1 + shape z)^(-1/shape)), z = (x - location) / s
generalized Pareto         (1 + shape y/s)^(-1/shape - 1) / s
inverse Gaussian           sqrt(k / (2 pi y^3)) exp(-k (y - mean)^2 / (2 mean^2 y))
log-logistic               cdf 1 / (1 + (y/s)^-k)
logistic                   cdf 1 / (1 + exp(-(x - location) / s))
lognormal                  log y is normal with log_mean and log_standard_deviation
Nakagami                   y^2 is gamma with shape k and mean `spread`
normal                     mean, standard_deviation
Pareto                     k lower^k / x^(k+1)
Rayleigh                   y exp(-y^2 / (2 s^2)) / s^2
Rician                     y exp(-(y^2 + c^2) / (2 s^2)) I0(y c / s^2) / s^2, c noncentrality >= 0
t location-scale           (x - location) / s is Student t with degrees_of_freedom
Weibull                    cdf 1 - exp(-(y/s)^k)
=========================  ==========================================================================
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats
from scipy.stats.distributions import rv_frozen

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.paper import candidate_estimators as mle
from accelerated_evaluation.laws.paper.candidate_estimators import Estimator, NoMaximumError

DIVERGES = "small shapes have an infinite density and an unbounded likelihood"
VANISHES = "the density is zero for all parameters"


@dataclass(frozen=True)
class CandidateFamily:
    """A candidate family of distributions."""

    name: str
    parameters: tuple[str, ...]  # names of the free parameters
    # (x, lower) -> sample for `estimate`, such as x - lower; NoMaximumError if a value is outside.
    coordinate: Callable[[Array, float], Array]
    estimate: Estimator  # Maximum-likelihood estimates in the order of `parameters`
    freeze: Callable[..., rv_frozen]  # (lower, *estimates) -> distribution of x

    def fit(self, x: Array, lower: float) -> dict[str, float]:
        """Return the estimates by name. NoMaximumError is raised if the likelihood has no finite maximum."""
        sample = self.coordinate(x, lower)
        if len(self.parameters) > 1 and np.ptp(sample) == 0:
            raise NoMaximumError("all values are equal: the likelihood is unbounded as the scale shrinks")
        with np.errstate(all="ignore"):
            estimates = dict(zip(self.parameters, map(float, self.estimate(sample)), strict=True))
        if not all(map(np.isfinite, estimates.values())):
            raise NoMaximumError(f"the estimates are not finite: {estimates}")
        return estimates


def _refuse(rows: NDArray[np.bool_], where: str) -> None:
    """Raise NoMaximumError if any of the rows is selected."""
    if rows.any():
        raise NoMaximumError(f"{np.count_nonzero(rows)} of {rows.size} values lie {where}")


def _line(x: Array, lower: float) -> Array:
    """Return x, for a family on the whole line."""
    return x


def _half_line(x: Array, lower: float, edge: str | None = None) -> Array:
    """Return x - lower, for a family on a half-line.

    If `edge` is given, values equal to ``lower`` raise NoMaximumError with this reason.
    """
    y = x - lower
    _refuse(y < 0, f"below {lower:.6g}, where the support starts")
    if edge is not None:
        _refuse(y == 0, f"on the edge {lower:.6g} of the support, where {edge}")
    return y


def _unit_interval(x: Array, lower: float) -> Array:
    """Return x - lower, for a family on (0, 1)."""
    y = _half_line(x, lower, DIVERGES)
    _refuse(y >= 1, f"at or above {lower + 1:.6g}, where the support ends")
    return y


def _multiple_of_lower(x: Array, lower: float) -> Array:
    """Return x / lower."""
    if lower <= 0:
        raise NoMaximumError(f"its scale is the lower bound {lower:.6g}, which must be positive")
    _half_line(x, lower)
    return x / lower


class _Rice(type(stats.rice)):
    """SciPy's Rice distribution, with a log density that does not underflow far in the tail."""

    def _logpdf(self, x: Array, b: Array) -> Array:
        return np.log(x) - (x - b) ** 2 / 2 + np.log(special.i0e(x * b))


_rice = _Rice(a=0.0, name="rice")
_vanishing = partial(_half_line, edge=VANISHES)
_diverging = partial(_half_line, edge=DIVERGES)

FAMILIES = (
    CandidateFamily(
        "beta",
        ("first_shape", "second_shape"),
        _unit_interval,
        mle.fit_beta,
        lambda lower, a, b: stats.beta(a, b, lower),
    ),
    CandidateFamily(
        "Birnbaum-Saunders",
        ("shape", "scale"),
        _vanishing,
        mle.fit_birnbaum_saunders,
        lambda lower, k, s: stats.fatiguelife(k, lower, s),
    ),
    CandidateFamily(
        "exponential",
        ("rate",),
        _half_line,
        mle.fit_exponential,
        lambda lower, rate: stats.expon(lower, 1 / rate),
    ),
    CandidateFamily(
        "extreme value",
        ("location", "scale"),
        _line,
        mle.fit_extreme_value,
        lambda _, m, s: stats.gumbel_l(m, s),
    ),
    CandidateFamily(
        "gamma", ("shape", "scale"), _diverging, mle.fit_gamma, lambda lower, k, s: stats.gamma(k, lower, s)
    ),
    CandidateFamily(
        "generalized extreme value",
        ("location", "scale", "shape"),
        _line,
        mle.fit_generalized_extreme_value,
        lambda _, m, s, k: stats.genextreme(-k, m, s),
    ),
    CandidateFamily(
        "generalized Pareto",
        ("shape", "scale"),
        _half_line,
        mle.fit_generalized_pareto,
        lambda lower, k, s: stats.genpareto(k, lower, s),
    ),
    CandidateFamily(
        "inverse Gaussian",
        ("mean", "shape"),
        _vanishing,
        mle.fit_inverse_gaussian,
        lambda lower, m, k: stats.invgauss(m / k, lower, k),
    ),
    CandidateFamily(
        "logistic",
        ("location", "scale"),
        _line,
        mle.fit_logistic,
        lambda _, m, s: stats.logistic(m, s),
    ),
    CandidateFamily(
        "log-logistic",
        ("shape", "scale"),
        _diverging,
        mle.fit_log_logistic,
        lambda lower, k, s: stats.fisk(k, lower, s),
    ),
    CandidateFamily(
        "lognormal",
        ("log_mean", "log_standard_deviation"),
        _vanishing,
        mle.fit_lognormal,
        lambda lower, m, s: stats.lognorm(s, lower, np.exp(m)),
    ),
    CandidateFamily(
        "Nakagami",
        ("shape", "spread"),
        _diverging,
        mle.fit_nakagami,
        lambda lower, k, spread: stats.nakagami(k, lower, np.sqrt(spread)),
    ),
    CandidateFamily(
        "normal", ("mean", "standard_deviation"), _line, mle.fit_normal, lambda _, m, s: stats.norm(m, s)
    ),
    CandidateFamily(
        "Pareto", ("shape",), _multiple_of_lower, mle.fit_pareto, lambda lower, k: stats.pareto(k, 0, lower)
    ),
    CandidateFamily(
        "Rayleigh", ("scale",), _vanishing, mle.fit_rayleigh, lambda lower, s: stats.rayleigh(lower, s)
    ),
    CandidateFamily(
        "Rician",
        ("noncentrality", "scale"),
        _vanishing,
        mle.fit_rician,
        lambda lower, c, s: _rice(c / s, lower, s),
    ),
    CandidateFamily(
        "t location-scale",
        ("location", "scale", "degrees_of_freedom"),
        _line,
        mle.fit_t,
        lambda _, m, s, nu: stats.t(nu, m, s),
    ),
    CandidateFamily(
        "Weibull",
        ("shape", "scale"),
        _diverging,
        mle.fit_weibull,
        lambda lower, k, s: stats.weibull_min(k, lower, s),
    ),
)
