"""Distributions against 50-digit arithmetic, scipy, their own definitions, and variants that must fail."""

import math
from dataclasses import dataclass

import mpmath
import numpy as np
import pytest
from accelerated_evaluation.laws.distributions import (
    BoundedExponential,
    BoundedNormal,
    Distribution,
    Empirical,
    Mixture,
    Pareto,
    PiecewiseMixture,
    Tiltable,
    match_mean,
)
from scipy import stats

EPS = np.finfo(float).eps
INF = math.inf
LOWEST = 1e-300

LEAVES = {
    **{
        f"exponential {rate:g} on [{low:g}, {high:.3g})": BoundedExponential(rate, low, high)
        for low, high in [(0.0, 0.166), (1.0, 1 + 1e-9), (-2.0, 1.0)]
        for rate in [0.0, 1e-13, -3.0, 400.0, -400.0, 1e8, -1e8]
    },
    **{f"exponential {rate:g} from 0.2": BoundedExponential(rate, 0.2) for rate in [1e-6, 21.0, 1e6]},
    **{
        f"normal {sd:g} at {location:g} on [{low:g}, {high:.3g})": BoundedNormal(sd, low, high, location)
        for low, high in [(0.0, 0.166), (0.1, 0.1 + 1e-9), (0.2, INF), (-0.1, 0.5)]
        for sd, location in [
            (0.0885, 0.0),
            (10.0, 0.0),
            (0.0885, 2.5),
            (0.0885, -2.5),
            (0.04, -1e3),
            (0.04, 1e3),
        ]
        if not (high == INF and location > 100)
    },
    "whole normal": BoundedNormal(2.0, -INF, INF, 0.3),
    "lower half of a normal": BoundedNormal(2.0, -INF, 0.0, 7.0),
}
BODY = Mixture((0.2, 0.8), (BoundedNormal(0.037, 0.0, 0.166), BoundedNormal(0.0885, 0.0, 0.166)))
PIECEWISE = PiecewiseMixture((0.95, 0.05), (BODY, BoundedExponential(21.0, 0.166)))
MIXTURES = {
    "body": BODY,
    "piecewise": PIECEWISE,
    "accelerated": PIECEWISE.accelerated((60.0, 19.5), (0.01, 0.99)),
    "three pieces": PiecewiseMixture(
        (0.7, 0.2, 0.1),
        (
            BoundedExponential(116.0, 1 / 75, 0.03),
            BoundedExponential(-65.0, 0.03, 0.05),
            BoundedExponential(42.0, 0.05),
        ),
    ),
    "unbounded normals": Mixture((0.3, 0.7), (BoundedNormal(1.0), BoundedNormal(10.0))),
}
TILTABLE = LEAVES | MIXTURES
ALL = TILTABLE | {"Pareto": Pareto(1.73, 1 / 75), "steep Pareto": Pareto(1e6, 2.0)}
each = pytest.mark.parametrize("law", ALL.values(), ids=ALL.keys())
each_tiltable = pytest.mark.parametrize("law", TILTABLE.values(), ids=TILTABLE.keys())


@dataclass(frozen=True)
class Exact:
    """Density proportional to exp(slope u - curvature u^2 / 2), u = x - origin, in 50 digits."""

    slope: mpmath.mpf
    curvature: mpmath.mpf
    origin: mpmath.mpf
    lower: mpmath.mpf
    upper: mpmath.mpf

    @classmethod
    def of(cls, law):
        lower, upper = mpmath.mpf(law.lower), mpmath.mpf(law.upper)
        if isinstance(law, BoundedExponential):
            return cls(-mpmath.mpf(law.rate), mpmath.mpf(0), lower, lower, upper)
        precision = 1 / mpmath.mpf(law.sd) ** 2
        location = mpmath.mpf(law.location)
        origin = lower if mpmath.isfinite(lower) else location
        return cls((location - origin) * precision, precision, origin, lower, upper)

    def mass(self, low, high, theta=0):
        """Integral of exp(theta u) times the density that is not normalized."""
        slope, (a, b) = self.slope + theta, (low - self.origin, high - self.origin)
        if self.curvature:
            scale = mpmath.sqrt(2 * self.curvature)
            a, b = ((self.curvature * u - slope) / scale for u in (a, b))
            sides = (mpmath.erfc(a), mpmath.erfc(b)) if a > 0 else (mpmath.erfc(-b), mpmath.erfc(-a))
            return mpmath.exp((slope / scale) ** 2) * mpmath.sqrt(mpmath.pi) / scale * (sides[0] - sides[1])
        if slope == 0:
            return b - a
        return ((mpmath.exp(slope * b) if mpmath.isfinite(b) else 0) - mpmath.exp(slope * a)) / slope

    def share(self, low, high):
        low, high = (min(max(mpmath.mpf(x), self.lower), self.upper) for x in (low, high))
        return self.mass(low, high) / self.mass(self.lower, self.upper) if low < high else mpmath.mpf(0)

    def density(self, x):
        u = mpmath.mpf(x) - self.origin
        inside = self.lower <= x < self.upper
        return (
            inside * mpmath.exp(u * (self.slope - self.curvature * u / 2)) / self.mass(self.lower, self.upper)
        )

    def moment(self, theta):
        """E exp(theta X)."""
        ratio = self.mass(self.lower, self.upper, theta) / self.mass(self.lower, self.upper)
        return mpmath.exp(theta * self.origin) * ratio


@pytest.fixture(autouse=True)
def digits():
    with mpmath.workdps(50):
        yield


def leaves(law, weight=1):
    """Yield the components of a law, mixtures of mixtures resolved, with their weights."""
    for share, part in zip(getattr(law, "weights", (1.0,)), getattr(law, "components", (law,)), strict=True):
        if part is law:
            yield weight, law
        else:
            yield from leaves(part, weight * mpmath.mpf(share))


def share(law, low, high):
    """P(low <= X < high)."""
    if isinstance(law, Pareto):
        return (mpmath.mpf(max(low, law.lower)) / law.lower) ** -mpmath.mpf(law.shape) - (
            0 if high == INF else (mpmath.mpf(max(high, law.lower)) / law.lower) ** -mpmath.mpf(law.shape)
        )
    return mpmath.fsum(weight * Exact.of(part).share(low, high) for weight, part in leaves(law))


def density(law, x):
    if isinstance(law, Pareto):
        return law.shape / mpmath.mpf(law.lower) * (mpmath.mpf(x) / law.lower) ** (-mpmath.mpf(law.shape) - 1)
    return mpmath.fsum(weight * Exact.of(part).density(x) for weight, part in leaves(law))


def cumulant(law, theta):
    return mpmath.log(mpmath.fsum(weight * Exact.of(part).moment(theta) for weight, part in leaves(law)))


def points(law):
    """Points of the support: both tails, the middle, and evenly where the support is bounded."""
    tails = np.array([LOWEST, 1e-100, 1e-20, 1e-8, 0.01, 0.3, 0.5])
    x = np.concatenate([law.ppf(tails), law.isf(tails)])
    if math.isfinite(law.lower) and math.isfinite(law.upper):
        x = np.concatenate(
            [x, law.lower + (law.upper - law.lower) * np.array([1e-12, 1e-3, 0.1, 0.5, 0.9, 0.999])]
        )
    return np.unique(x[(x >= law.lower) & (x < law.upper)])


def tolerance(logarithm):
    """Rounding of a logarithm, and so the relative rounding of what it is the logarithm of."""
    return 16 * EPS * (1 + abs(logarithm))


def worst_error(function, exact, x, *, logarithmic):
    """Largest error over the points in units of what rounding explains, values below 1e-300 left out."""
    worst = 0.0
    for point, value in zip(x.tolist(), np.asarray(function(x)).tolist(), strict=True):
        truth = exact(point)
        if truth == 0 or (not logarithmic and truth < LOWEST):
            continue
        logarithm = mpmath.log(truth)
        error = abs(value - logarithm) if logarithmic else abs(value / truth - 1)
        worst = max(worst, float(error / tolerance(logarithm)) if math.isfinite(value) else INF)
    return worst


def rounding(law, x):
    """What rounding does to a quantile: bounds, location and sd of a normal enter by sums and differences."""
    places = [x]
    for _, part in leaves(law):
        places += [part.lower, part.upper, 4 * getattr(part, "location", 0), 4 * getattr(part, "sd", 0)]
    return 16 * EPS * max(abs(place) for place in places if math.isfinite(place))


@each
def test_functions_agree_with_50_digits(law):
    x = points(law)
    assert isinstance(law, Distribution)
    assert worst_error(law.logpdf, lambda x: density(law, x), x, logarithmic=True) < 1
    assert worst_error(law.logsf, lambda x: share(law, x, INF), x, logarithmic=True) < 1
    assert worst_error(law.sf, lambda x: share(law, x, INF), x, logarithmic=False) < 1
    assert worst_error(law.cdf, lambda x: share(law, law.lower, x), x, logarithmic=False) < 1


@each
@pytest.mark.parametrize("q", [LOWEST, 1e-20, 1e-9, 0.02, 0.5, 0.95, 1 - 1e-9])
def test_quantiles_agree_with_50_digits(law, q):
    for x, exact in (
        (law.ppf(q), lambda x: share(law, law.lower, x)),
        (law.isf(q), lambda x: share(law, x, INF)),
    ):
        slack = rounding(law, float(x))
        low, high = exact(float(x) - slack), exact(float(x) + slack)
        relative = tolerance(math.log(q)) * q
        assert min(low, high) - relative - EPS * (q > 0.1) <= q <= max(low, high) + relative + EPS * (q > 0.1)


@each
def test_the_ends(law):
    for quantile, end in (
        (law.ppf(0), law.lower),
        (law.isf(1), law.lower),
        (law.ppf(1), law.upper),
        (law.isf(0), law.upper),
    ):
        assert quantile == pytest.approx(end, rel=0, abs=rounding(law, law.lower))
    assert law.cdf(law.lower) == law.sf(law.upper) == 0
    assert law.logsf(law.lower) == pytest.approx(0, abs=4 * EPS)
    assert law.cdf(law.upper) == pytest.approx(1, abs=4 * EPS)
    outside = np.array([-INF, np.nextafter(law.lower, -INF), law.upper, INF])
    assert np.all(law.logpdf(outside[outside != law.lower]) == -INF)
    assert np.all(law.logsf([-1e300, 1e300]) == [law.logsf(-1e300), law.logsf(1e300)])


def test_no_rounding_of_the_weights_cuts_off_an_end():
    for share in np.linspace(0.01, 0.99, 99):
        law = PiecewiseMixture(
            (share, 1 - share), (BoundedExponential(1.0, 0.0, 1.0), BoundedExponential(1.0, 1.0))
        )
        assert law.ppf(1) == law.isf(0) == INF
        assert law.ppf(0) == law.isf(1) == 0


@pytest.mark.parametrize("rate", [-400.0, -3.0, 0.0, 1e-13, 3.0, 400.0])
def test_exponential_returns_to_the_lowest_points(rate):
    law = BoundedExponential(rate, 0.0, 0.166)
    x = np.array([1e-270, 1e-200, 1e-30, 1e-10, 1e-3])
    np.testing.assert_allclose(law.ppf(law.cdf(x)), x, rtol=tolerance(math.log(LOWEST)), atol=0)


@pytest.mark.parametrize(
    "law",
    [
        BoundedExponential(21.0, 0.166),
        BoundedNormal(1.0),
        BoundedNormal(0.09, 0.2, INF, -2.5),
        PIECEWISE,
        Pareto(1.7, 0.01),
    ],
)
def test_the_farthest_tail_returns(law):
    q = np.array([LOWEST, 1e-200, 1e-100, 1e-10])
    np.testing.assert_allclose(law.sf(law.isf(q)), q, rtol=2 * tolerance(math.log(LOWEST)), atol=0)


def test_wrong_variants_of_the_tail_fail():
    law = BoundedNormal(0.0885, 0.0, 0.166, -2.5)
    whole, x = stats.norm(law.location, law.sd), points(law)

    @np.errstate(divide="ignore", invalid="ignore")
    def difference(x):
        return np.log((whole.cdf(law.upper) - whole.cdf(x)) / (whole.cdf(law.upper) - whole.cdf(law.lower)))

    assert worst_error(difference, lambda x: share(law, x, INF), x, logarithmic=True) > 1
    assert PIECEWISE.sf(PIECEWISE.isf(1e-20)) == pytest.approx(1e-20, rel=1e-12, abs=0)
    assert PIECEWISE.sf(PIECEWISE.ppf(1 - 1e-20)) != pytest.approx(1e-20, rel=1e-12, abs=0)


def spread(law):
    """Length over which a law varies: its width, or the mean excess or sd of an unbounded component."""
    return max(
        min(
            part.upper - part.lower,
            1 / part.rate if isinstance(part, BoundedExponential) and part.rate > 0 else INF,
        )
        if math.isfinite(part.upper - part.lower) or isinstance(part, BoundedExponential)
        else part.sd
        for _, part in leaves(law)
    )


def thetas(law):
    """Tilts from tiny to huge on the scale of a law, within its limit."""
    scale = 1 / spread(law)
    return [
        theta
        for factor in (-1e7, -300.0, -1.0, 1e-9, 0.9, 300.0, 1e7)
        if (theta := factor * scale) < law.theta_limit
    ]


@each_tiltable
def test_tilting_multiplies_the_density(law):
    assert isinstance(law, Tiltable)
    x = points(law)
    for theta in thetas(law):
        kappa, before, after = law.cumulant(theta), law.logpdf(x), law.tilt(theta).logpdf(x)
        largest = abs(kappa) + abs(theta) * max(np.abs(x).max(), rounding(law, 0.0) / (16 * EPS))
        assert abs(kappa - cumulant(law, theta)) < tolerance(largest)
        seen = (before > -INF) & (after > -650)  # where no emptied component is left
        error = after[seen] - before[seen] - (theta * x[seen] - kappa)
        assert np.all(np.abs(error) < tolerance(largest + np.abs(before[seen]) + np.abs(after[seen])))


@each_tiltable
def test_means_are_derivatives_of_the_exact_cumulant(law):
    step = mpmath.mpf(10) ** -20 / spread(law)
    for theta in (0.0, *thetas(law)[1:-1:3]):
        exact = float(mpmath.diff(lambda theta: cumulant(law, theta), theta, h=step))
        assert law.tilt(theta).mean() == pytest.approx(exact, rel=0, abs=rounding(law, exact))


@each_tiltable
def test_matching_a_mean_inverts_tilting(law):
    for theta in thetas(law)[1:-1] if math.isfinite(law.lower) else ():
        mean = law.tilt(theta).mean()
        if law.lower < mean < law.upper:
            found = law.tilt(match_mean(law, mean)).mean()
            assert found == pytest.approx(mean, rel=0, abs=rounding(law, mean) + 1e-13 * spread(law))


def test_matching_a_mean_agrees_with_the_closed_forms():
    unbounded, bounded = BoundedExponential(21.0, 0.166), BoundedExponential(106.0, 1 / 75, 0.037)
    for mean in (0.167, 0.2, 1.16, 1e3):
        assert match_mean(unbounded, mean) == pytest.approx(21 - 1 / (mean - 0.166), rel=1e-9)
    for mean in (0.0134, 0.02, 0.0369):
        fitted = BoundedExponential.from_mean(mean, 1 / 75, 0.037)
        assert match_mean(bounded, mean) == pytest.approx(106 - fitted.rate, rel=1e-9)


@pytest.mark.parametrize(
    "share", [1e-12, 0.0008569168177301864, 0.015368195603819145, 0.3, 0.5, 0.98, 1 - 1e-6]
)
@pytest.mark.parametrize(("lower", "upper"), [(0.0, 1.0), (1.0, 3.0), (0.2, INF)])
def test_exponential_from_its_mean(lower, upper, share):
    mean = lower + share * (min(upper, 10.0) - lower)
    law = BoundedExponential.from_mean(mean, lower, upper)
    assert law.mean() == pytest.approx(mean, rel=4 * EPS, abs=0)


def test_second_moment_against_quadrature():
    for law in (
        BoundedNormal(0.09, 0.0, 0.166),
        BoundedNormal(0.3, 0.5),
        BoundedNormal(1e3, 1.0, 2.0),
        BoundedNormal(0.04, 0, 1),
    ):
        exact = mpmath.quad(
            lambda x, law=law: x**2 * density(law, x), [law.lower, min(law.upper, 3) / 2, min(law.upper, 6)]
        )
        assert law.second_moment() == pytest.approx(float(exact), rel=1e-13)


def test_piecewise_mixture_is_that_of_appendix_a():
    law = MIXTURES["three pieces"]
    assert law.knots == (0.03, 0.05)
    assert law.n_parameters == 5
    assert law.cdf([*law.knots]) == pytest.approx([0.7, 0.9], rel=1e-15)
    assert law.piece_index([0.02, 0.03, 0.04, 0.05, 1.0]).tolist() == [0, 1, 1, 2, 2]
    q = np.array([0.1, 0.6, 0.75, 0.85, 0.95])
    inner = [q[:2] / 0.7, (q[2:4] - 0.7) / 0.2, (q[4:] - 0.9) / 0.1]
    x = np.concatenate([piece.ppf(part) for piece, part in zip(law.components, inner, strict=True)])
    np.testing.assert_allclose(law.ppf(q), x, rtol=1e-13)
    np.testing.assert_allclose(law.isf(1 - q), x, rtol=1e-13)


def test_accelerated_tilts_and_reweighs_each_piece():
    law = PIECEWISE.accelerated((60.0, 19.5), (0.01, 0.99))
    x = np.array([0.01, 0.1, 0.2, 1.5])
    for piece, theta, weight, base in zip(
        PIECEWISE.components, (60.0, 19.5), (0.01, 0.99), law.components, strict=True
    ):
        inside = (x >= piece.lower) & (x < piece.upper)
        expected = math.log(weight) + theta * x[inside] - piece.cumulant(theta) + piece.logpdf(x[inside])
        np.testing.assert_allclose(law.logpdf(x[inside]), expected, rtol=1e-13)
        assert base == piece.tilt(theta)


@pytest.mark.parametrize(
    "name",
    ["exponential -3 on [-2, 1)", "whole normal", "normal 0.0885 at -2.5 on [0, 0.166)", *MIXTURES, "Pareto"],
)
def test_draws_have_the_distribution(name):
    law, size = ALL[name], 20_000
    x = law.rvs(np.random.default_rng(7), size)
    assert x.shape == (size,)
    assert law.lower <= x.min() <= x.max() <= law.upper
    assert stats.kstest(x, law.cdf).pvalue > 1e-3
    assert stats.kstest(x, lambda x: law.cdf(x + 0.1 * x.std())).pvalue < 1e-3
    if name != "Pareto":  # its variance is infinite
        assert x.mean() == pytest.approx(law.mean(), abs=4 * x.std() / math.sqrt(size))


def test_empirical_distribution():
    law = Empirical([3.0, 1.0, 2.0, 2.0])
    q = np.array([0.0, 0.2, 0.25, 0.5, 0.75, 0.8, 1.0])
    np.testing.assert_array_equal(law.cdf([0, 1, 2, 3]), [0, 0.25, 0.75, 1])
    np.testing.assert_array_equal(law.sf([0, 1, 2, 3]), [1, 0.75, 0.25, 0])
    np.testing.assert_array_equal(law.ppf(q), [1, 1, 1, 2, 2, 3, 3])
    np.testing.assert_array_equal(law.isf(q), [3, 3, 2, 2, 1, 1, 1])
    assert (law.lower, law.upper, law.mean()) == (1, 3, 2)
    draws = law.rvs(np.random.default_rng(1), 4000)
    counts = [np.count_nonzero(draws == value) for value in (1, 2, 3)]
    assert stats.chisquare(counts, [1000, 2000, 1000]).pvalue > 1e-3


EXPONENTIAL = BoundedExponential(1.0, 0.0, 1.0)


@pytest.mark.parametrize(
    "make",
    [
        lambda: BoundedExponential(1.0, 1.0, 1.0),
        lambda: BoundedExponential(1.0, -INF, 1.0),
        lambda: BoundedExponential(math.nan, 0.0, 1.0),
        lambda: BoundedExponential(0.0),
        lambda: BoundedExponential(1.0, math.nan),
        lambda: BoundedExponential(1.0).tilt(1.0),
        lambda: BoundedExponential.from_mean(1.0, 0.0, 1.0),
        lambda: BoundedExponential.from_mean(math.nan),
        lambda: BoundedNormal(0.0),
        lambda: BoundedNormal(INF),
        lambda: BoundedNormal(1.0, 2.0, 1.0),
        lambda: BoundedNormal(1.0, 0.0, 1.0, math.nan),
        lambda: Pareto(0.0, 1.0),
        lambda: Pareto(1.0, INF),
        lambda: Empirical([]),
        lambda: Mixture((), ()),
        lambda: Mixture((0.5, 0.5), (EXPONENTIAL,)),
        lambda: Mixture((0.5, 0.4), (EXPONENTIAL, EXPONENTIAL)),
        lambda: Mixture((0.0, 1.0), (EXPONENTIAL, EXPONENTIAL)),
        lambda: Mixture((math.nan, 1.0), (EXPONENTIAL, EXPONENTIAL)),
        lambda: PiecewiseMixture((0.5, 0.5), (EXPONENTIAL, BoundedExponential(1.0, 1.5))),
        lambda: match_mean(EXPONENTIAL, 1.0),
        lambda: match_mean(EXPONENTIAL, math.nan),
        lambda: match_mean(BoundedNormal(1.0, -INF), 0.5),
    ],
)
def test_what_is_no_distribution_is_refused(make):
    with pytest.raises(ValueError, match=r"must|weights|needs"):
        make()
