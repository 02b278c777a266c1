"""Problems of public collections, written from their published formulas.

All are events g(x) <= 0 of independent inputs, which are functions of normal scores here. Their sources:

- ``rp_N``: the TNO reliability problems (Rozsas and Slobbe 2019, https://rprepo.readthedocs.io), with the
  parameters and the probabilities of otbenchmark 0.2.1 (https://github.com/mbaudin47/otbenchmark), which also
  has the three textbook problems ``r_minus_s``, ``stressed_beam`` and ``four_branch_system`` (Waarts 2000).
- ``linear_d``, ``fujita_rackwitz_d`` and ``oscillator``: rareeventestimation 0.3 (MIT licence,
  https://github.com/AlthausKonstantin/rareeventestimation), after Engelund and Rackwitz (1993) and Bucher and
  Bourgund (1990). Its flow-rate problem needs a solver of differential equations and is left out.
- ``paraboloid`` and ``shell``: issues 2819 and 2773 of OpenTURNS (https://github.com/openturns/openturns).
- ``cut_in_and_17``: the main problem of this benchmark, with 17 inputs more of no or little influence.
- ``many_small_d``: of this benchmark too, d inputs of comparable influence and a curved boundary.

What a reference probability is, and its standard error, is said by `probability_of`.
"""

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from accelerated_evaluation.base.arrays import Array
from fewruns import ScoreProblem, SystemProblem
from problems import Problem, below_zero, problems
from reference import reference
from scipy.integrate import quad
from scipy.special import log_ndtr, ndtr
from scipy.stats import chi2, gamma, multivariate_normal, norm

GRID = 4000  # points of a normal score between -LARGEST and LARGEST, for integrals in two dimensions
LARGEST = 8.5
DRAWS, BATCH = 20_000_000, 1_000_000  # of crude Monte Carlo
COMMON = 1e-4  # probability from which on it is exact enough
EULER = 0.5772156649015329
CURVATURE = 0.2  # of `many_small`

Marginal = Callable[[Array], Array]


def normal(mean: float, deviation: float) -> Marginal:
    """Return a normal variable as a function of its normal score."""
    return lambda z: mean + deviation * z


def lognormal(mean: float, deviation: float) -> Marginal:
    """Return a log-normal variable of a given mean and standard deviation."""
    variance = math.log1p((deviation / mean) ** 2)
    return lambda z: mean * np.exp(math.sqrt(variance) * z - variance / 2)


def uniform(low: float, high: float) -> Marginal:
    """Return a uniform variable."""
    return lambda z: low + (high - low) * ndtr(z)


def gumbel(mean: float, deviation: float) -> Marginal:
    """Return a variable of Gumbel's law of maxima of a given mean and standard deviation."""
    scale = deviation * math.sqrt(6) / math.pi
    return lambda z: mean - EULER * scale - scale * np.log(-log_ndtr(z))


def of_inputs(
    name: str,
    marginals: list[Marginal],
    g: Callable[..., Array],
    published: float = math.nan,
    exact: float | None = None,
) -> Problem:
    """Return the event g(x_1, ..., x_d) <= 0."""

    def score(z: Array) -> Array:
        return g(*(marginal(scores) for marginal, scores in zip(marginals, z.T, strict=True)))

    return of_all(name, len(marginals), score, published, exact)


def of_all(
    name: str,
    dimension: int,
    g: Callable[[Array], Array],
    published: float = math.nan,
    exact: float | None = None,
) -> Problem:
    """Return the event g(z) <= 0 of all normal scores together, shape (n, d)."""
    return Problem(name, below_zero(name, dimension, g), exact=exact, published=published)


# ---- limit states


def beam_in_torsion(x1: Array, x2: Array, x3: Array, x4: Array, x5: Array) -> Array:
    """Return the margin of RP14."""
    return x1 - 32 / (math.pi * x2**3) * np.sqrt(x3**2 * x4**2 / 16 + x5**2)


def rp_38(x1: Array, x2: Array, x3: Array, x4: Array, x5: Array, x6: Array, x7: Array) -> Array:
    """Return the margin of RP38."""
    above = x4**2 - 4 * x5 * x6 * x7**2 + x4 * (x6 + 4 * x5 + 2 * x6 * x7)
    return 15.59e4 - x1 * x2**3 / (2 * x3**3) * above / (x4 * x5 * (x4 + x6 + 2 * x6 * x7))


def rp_55(x1: Array, x2: Array) -> Array:
    """Return the margin of RP55, the smallest of four branches."""
    apart, bow = x1 - x2, 0.2 + 0.6 * (x1 - x2) ** 4
    return np.minimum(bow - np.abs(apart) / math.sqrt(2), 5 / math.sqrt(2) - 2.2 - np.abs(apart))


def rp_57(x1: Array, x2: Array) -> Array:
    """Return the margin of RP57."""
    first = np.maximum(-(x1**2) + x2**3 + 3, 2 - x1 - 8 * x2)
    return np.minimum(first, (x1 + 3) ** 2 + (x2 + 3) ** 2 - 4)


def rp_60(x1: Array, x2: Array, x3: Array, x4: Array, load: Array) -> Array:
    """Return the margin of RP60."""
    shared = np.minimum.reduce([x2, x3, x4]) - load / 2
    alone = np.maximum(x4 - load, np.minimum(x2, x3) - load)
    return np.minimum(x1 - load, np.maximum(shared, alone))


def rp_91(x1: Array, x2: Array, x3: Array, x4: Array, x5: Array) -> Array:
    """Return the margin of RP91."""
    first = 0.847 + 0.96 * x2 + 0.986 * x3 - 0.216 * x4 + 0.077 * x2**2 + 0.11 * x3**2 + 7 / 378 * x4**2
    first = first - x3 * x2 - 0.106 * x2 * x4 - 0.11 * x3 * x4
    strength = 84_000 * x1
    second = strength / np.sqrt(x3**2 + x4**2 - x3 * x4 + 3 * x5**2) - 1
    return np.minimum.reduce([first, second, strength / np.abs(x4) - 1])


def rp_110(x1: Array, x2: Array) -> Array:
    """Return the margin of RP110, which jumps where x1 is 3.5 and where x2 is 2."""
    first = np.where(x1 <= 3.5, 0.85 - 0.1 * x1, 4 - x1)
    return np.minimum(first, np.where(x2 <= 2, 2.3 - x2, 0.5 - 0.1 * x2))


def oscillator(z1: Array, z2: Array, z3: Array, z4: Array, z5: Array, z6: Array) -> Array:
    """Return the margin of the displacement of a nonlinear oscillator."""
    mass, stiffness = 1 + 0.05 * z1, 1.1 + 0.1 * z2 + 0.01 * z3
    square = stiffness / mass
    omega = np.sqrt(square + 0j)
    pulse = np.abs(2 * (0.3 + 0.2 * z5) / (mass * omega**2) * np.sin(omega * (1 + 0.2 * z6) / 2))
    return 3 * (0.5 + 0.05 * z4) - pulse


def branches(a: Array, b: Array) -> Array:
    """Return the margin of a series system of four branches (Waarts 2000)."""
    bow, along, across = 0.1 * (a - b) ** 2, (a + b) / math.sqrt(2), a - b
    both = 3 + bow - np.abs(along)
    return np.minimum(both, 7 / math.sqrt(2) - np.abs(across))


def paraboloid(z: Array) -> Array:
    """Return how far the last score exceeds the sum of the squares of the others."""
    return z[:, -1] - (z[:, :-1] ** 2).sum(1)


def exponential_sum(z: Array) -> Array:
    """Return the sum of exponential variables."""
    return -np.log(ndtr(-z)).sum(1)


def diluted(z: Array, little: float) -> Array:
    """Return three normal scores of 20, to each of which five others contribute a little."""
    others = z[:, 3:18].reshape(len(z), 3, 5).sum(axis=2)
    return (z[:, :3] + little * others) / math.sqrt(1 + 5 * little**2)


def many_small(inputs: int) -> tuple[Array, Array]:
    """Return the coefficients a and c of sum a_i (z_i + c_i (z_i^2 - 1)), which has the variance 1 if c is 0.

    The largest influence is three times the smallest one, and the curvatures have both signs.
    """
    influence = np.linspace(0.5, 1.5, inputs)
    return influence / np.linalg.norm(influence), np.where(np.arange(inputs) % 2, -1, 1) * CURVATURE


def tail_of_squares(level: float, influence: Array, curvature: Array) -> float:
    """Return the probability that sum a_i (z_i + c_i (z_i^2 - 1)) exceeds a level.

    The moment generating function is known, and its transform is inverted along the vertical line through the
    level, near which the integrand does not oscillate.

    Parameters
    ----------
    level
        The level; it must be less than 1 / (2 a_i c_i) for every i.
    influence, curvature
        The coefficients a and c, shape (d,).
    """
    square = influence * curvature

    def integrand(u: float) -> float:
        s = complex(level, u)
        rest = 1 - 2 * s * square
        log_mean = (s * s * influence**2 / (2 * rest) - s * square - np.log(rest) / 2).sum()
        return float((np.exp(log_mean - s * level) / s).real) / math.pi

    return quad(integrand, 0, math.inf, epsabs=0, epsrel=1e-8)[0]


# ---- the problems


def low_dimensions() -> list[Problem]:
    """Return the problems of two to ten variables."""
    standard = [normal(0, 1)] * 2
    rp_8 = [lognormal(120, 12)] * 4 + [lognormal(50, 10), lognormal(40, 8)]
    rp_14 = [uniform(70, 80), normal(39, 0.1), gumbel(1500, 350), normal(400, 0.1), normal(250_000, 35_000)]
    rp_28 = [normal(78_064, 11_710), normal(0.0104, 0.00156)]
    rp_38_laws = [normal(mean, mean / 10) for mean in (350, 50.8, 3.81, 173, 9.38, 33.1, 0.036)]
    rp_60_laws = [lognormal(mean, mean / 10) for mean in (2200, 2100, 2300, 2000)] + [lognormal(1200, 480)]
    moments = ((0.07433, 0.005), (0.1, 0.01), (13, 60), (4751, 48), (-684, 11))
    sheets = [[1, 1 / math.sqrt(3)], [1 / math.sqrt(3), 1]]
    rp_33_exact = float(2 * ndtr(-3) - multivariate_normal.cdf([-3, -3], cov=sheets))
    rp_77 = [normal(10, 0.5), normal(0, 1), normal(4, 1)]
    rp_77_exact = quad(lambda x: norm.pdf(x, 4) * ndtr((x - 10) / math.sqrt(1.25)), -9, 5)[0]
    rp_77_exact += quad(lambda x: norm.pdf(x, 4) * ndtr(-x), 5, 15)[0]
    beam, force = lognormal(300, 30), normal(75_000, 5000)

    def margin_24(a: Array, b: Array) -> Array:
        return 2.5 - 0.2357 * (a - b) + 0.00463 * (a + b - 20) ** 4

    def margin_33(a: Array, b: Array, c: Array) -> Array:
        return np.minimum(-a - b - c + 3 * math.sqrt(3), 3 - c)

    def margin_35(a: Array, b: Array) -> Array:
        return np.minimum(2 - b + np.exp(-0.1 * a**2) + (0.2 * a) ** 4, 4.5 - a * b)

    def margin_53(a: Array, b: Array) -> Array:
        return np.sin(2.5 * a) + 2 - (a**2 + 4) * (b - 1) / 20

    return [
        of_inputs("rp_8", rp_8, lambda a, b, c, d, e, f: a + 2 * b + 2 * c + d - 5 * e - 5 * f, 7.897928e-4),
        of_inputs("rp_14", rp_14, beam_in_torsion, 7.7285e-4),
        of_inputs(
            "rp_22", standard, lambda a, b: 2.5 - (a + b) / math.sqrt(2) + 0.1 * (a - b) ** 2, 4.20730551e-3
        ),
        of_inputs("rp_24", [normal(10, 3)] * 2, margin_24, 2.86e-3),
        of_inputs(
            "rp_25", standard, lambda a, b: np.maximum(a**2 - 8 * b + 16, -16 * a + b + 32), 4.148566e-5
        ),
        of_inputs("rp_28", rp_28, lambda a, b: a * b - 146.14, 1.45e-7),
        of_inputs("rp_31", standard, lambda a, b: 2 - b + 256 * a**4, 3.226681209e-3),
        of_inputs("rp_33", [normal(0, 1)] * 3, margin_33, 2.57e-3, rp_33_exact),
        of_inputs("rp_35", standard, margin_35, 3.47894632e-3),
        of_inputs("rp_38", rp_38_laws, rp_38, 8.1e-3),
        of_inputs("rp_53", [normal(1.5, 1), normal(2.5, 1)], margin_53, 3.13e-2),
        of_inputs("rp_55", [uniform(-1, 1)] * 2, rp_55, 0.560014428),
        of_inputs("rp_57", standard, rp_57, 2.84e-2),
        of_inputs("rp_60", rp_60_laws, rp_60, 4.56e-2),
        of_inputs("rp_75", standard, lambda a, b: 3 - a * b, 9.81929872e-3),
        of_inputs("rp_77", rp_77, lambda a, b, c: np.where(c <= 5, a - b - c, c - b), 2.87e-7, rp_77_exact),
        of_inputs("rp_89", standard, lambda a, b: np.minimum(-(a**2) - b + 8, -a / 5 - b + 6), 5.43e-3),
        of_inputs("rp_91", [normal(*pair) for pair in moments], rp_91, 6.97e-4),
        of_all("rp_107", 10, lambda z: 5 * math.sqrt(10) - z.sum(1), 2.92e-7, float(ndtr(-5))),
        of_inputs("rp_110", standard, rp_110, 3.19e-5),
        of_inputs("rp_111", standard, lambda a, b: 12.5 - np.abs(a * b), 7.65e-7),
        of_inputs(
            "r_minus_s", [normal(4, 1), normal(2, 1)], lambda r, s: r - s, exact=float(ndtr(-math.sqrt(2)))
        ),
        of_inputs("stressed_beam", [beam, force], lambda r, f: r - f / (100 * math.pi), 2.919819462e-2),
        of_inputs("four_branch_system", standard, branches, 2.222795065e-3),
        of_inputs("oscillator", [normal(0, 1)] * 6, oscillator, 6.43e-6),
        *(linear(d) for d in (2, 10)),
        *(fujita_rackwitz(d) for d in (2, 10)),
        of_all("paraboloid", 5, lambda z: 3.5 - paraboloid(z), exact=needle(3.5)),
        of_all("shell", 5, shell, exact=needle(3.5) - needle(3.52)),
    ]


def linear(dimension: int) -> Problem:
    """Return the half-space at the distance 3.5 in which all inputs are alike."""
    root, exact = math.sqrt(dimension), float(ndtr(-3.5))
    return of_all(f"linear_{dimension}", dimension, lambda z: 3.5 - z.sum(1) / root, exact, exact)


def fujita_rackwitz(dimension: int) -> Problem:
    """Return a small sum of exponential variables, of probability 1e-4."""
    name, level = f"fujita_rackwitz_{dimension}", gamma.ppf(1e-4, dimension)
    return of_all(name, dimension, lambda z: exponential_sum(z) - level, 1e-4, 1e-4)


def of_many_small(inputs: int) -> Problem:
    """Return the event that a sum of many small influences exceeds 4.5."""
    influence, curvature = many_small(inputs)

    def margin(z: Array) -> Array:
        return 4.5 - (z + curvature * (z**2 - 1)) @ influence

    return of_all(f"many_small_{inputs}", inputs, margin, exact=tail_of_squares(4.5, influence, curvature))


def shell(z: Array) -> Array:
    """Return the margin of a layer about a paraboloid that is 0.02 thick."""
    return np.maximum(3.5 - paraboloid(z), paraboloid(z) - 3.52)


def needle(level: float) -> float:
    """Return the probability that a normal variable exceeds a chi-square one of 4 degrees by a level."""
    return quad(lambda x: chi2.pdf(x, 4) * norm.sf(level + x), 0, 60)[0]


def high_dimensions() -> list[Problem]:
    """Return the problems of 20 variables and more."""
    main = problems()["segment_5_15"].event
    cut_ins = {"cut_in_and_17": 0.0, "cut_in_and_17_little": 0.1}
    rp_63_exact = quad(lambda x: chi2.pdf(x, 99) * norm.sf(x / 10 - 4.5), 0, 400)[0]

    def respond(z: Array, little: float) -> tuple[Array, Array]:
        return main.evaluate(diluted(z, little))

    def half_space(z: Array) -> Array:
        return 4.5 - z.sum(1) / math.sqrt(z.shape[1])

    return [
        of_all("rp_54", 20, lambda z: exponential_sum(z) - 8.951, 9.98e-4, gamma.cdf(8.951, 20)),
        of_all("rp_63", 100, lambda z: 0.1 * (z[:, 1:] ** 2).sum(1) - z[:, 0] - 4.5, 3.79e-4, rp_63_exact),
        *(linear(d) for d in (20, 50, 100, 200)),
        *(fujita_rackwitz(d) for d in (20, 50, 100, 200)),
        *(of_all(f"half_space_{d}", d, half_space, exact=float(ndtr(-4.5))) for d in (20, 40)),
        *(of_many_small(d) for d in (20, 40)),
        *(
            Problem(
                name,
                SystemProblem(partial(respond, little=little), 20, fingerprint=name, deterministic=True),
                simpler=main,
            )
            for name, little in cut_ins.items()
        ),
    ]


def public_problems() -> dict[str, Problem]:
    """Return all problems by name."""
    return {problem.name: problem for problem in [*low_dimensions(), *high_dimensions()]}


def probability_of(problem: Problem, generator: np.random.Generator) -> tuple[float, float]:
    """Return the probability of an event and its standard error.

    It is exact where that is known. In two dimensions it is an integral over a grid, whose error is far below
    all others. Otherwise it is by crude Monte Carlo, or by importance sampling where the event is rarer.
    """
    if problem.exact is not None:
        return problem.exact, 0.0
    event = problem.simpler or problem.event
    if event.dimension == 2:
        return _over_a_grid(event), 0.0
    if not problem.published > COMMON:
        return reference(event, generator)
    events = 0
    for _ in range(DRAWS // BATCH):
        z = generator.standard_normal((BATCH, event.dimension))
        events += np.count_nonzero(event.evaluate(z)[0])
    share = events / DRAWS
    return share, math.sqrt(share * (1 - share) / DRAWS)


def _over_a_grid(event: ScoreProblem) -> float:
    """Integrate an event in two dimensions; each axis is cut into parts of equal length."""
    edges = np.linspace(-LARGEST, LARGEST, GRID + 1)
    middle, mass = (edges[1:] + edges[:-1]) / 2, np.diff(ndtr(edges))
    total = 0.0
    for x, weight in zip(middle, mass, strict=True):
        inside = event.evaluate(np.column_stack([np.full(GRID, x), middle]))[0]
        total += weight * mass[inside].sum()
    return float(total)
