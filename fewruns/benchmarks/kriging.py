"""Active learning with kriging: AK-MCS and AK-IS, on the Gaussian process of scikit-learn.

Both fit a Gaussian process to a score that is at most 0 in the event, and run next the point of a
population whose sign is the least certain: the one of smallest U = |mean| / standard deviation. They stop
when U is at least 2 everywhere. The estimate is the share of the population that the process predicts to
be in the event. The interval is the one that the authors report: it knows the error of the population, and
takes every prediction for the truth.

- AK-MCS: Echard, Gayton and Lemaire, Structural Safety 33 (2011) 145-154.
- AK-IS: Echard, Gayton, Lemaire and Relun, Reliability Engineering and System Safety 111 (2013) 232-240.

Where a simulation in steps of time makes the score jump, U comes to 2 everywhere only after very many
runs: so learning ends after 200. For the same reason the process has a Matern kernel, in place of the
authors' Gaussian one, and leaves a little of the score to noise.
"""

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import reduce

import numpy as np
from accelerated_evaluation.base.arrays import Array
from methods import Counter, Estimate, Target, adapter
from peers import design_point, threshold_event, with_interval
from problems import Problem
from scipy.stats import chi2
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern

SURE = 2.0  # the authors' U from which a sign counts as known
FORGET = 4.0  # points of a larger U are checked again only when the lengths are fitted again, to save time
FIRST = 12  # runs before the first fit, as in the authors' examples, and shells at most: to 1e-12
POPULATION, IMPORTANCE = 1_000, 4_000  # points whose signs are learnt: of each shell of AK-MCS; of AK-IS
FINAL = 20_000  # points that the last fit predicts for the estimate: of each shell of AK-MCS; of AK-IS
BEYOND = 0.01  # share of the probability that may be beyond the last shell
SIMULATIONS = 200  # runs after which learning is given up, and the estimate of that moment taken
NUGGET = (
    1e-4  # variance of the score that is left to noise, of its own: a score that jumps cannot be interpolated
)
BATCH = 20_000  # points predicted at once


@dataclass
class Kriging:
    """A Gaussian process fitted to a score; its lengths are fitted again when there are a fifth more runs."""

    score: Callable[[Array], Array]
    z: Array
    y: Array
    fitted: int = 0  # runs of the last fit of the lengths
    ran: list[int] = field(
        default_factory=list
    )  # points of the population that were run: their signs are known

    def __post_init__(self) -> None:
        start = ConstantKernel(1.0, (1e-2, 1e3)) * Matern(np.full(self.z.shape[1], 2.0), (0.1, 50.0), nu=2.5)
        self.model = GaussianProcessRegressor(start, alpha=NUGGET, normalize_y=True)
        self.refit()

    def add(self, z: Array) -> bool:
        """Run more points, shape (n, d), and return whether the lengths were fitted again."""
        self.z, self.y = np.vstack([self.z, z]), np.append(self.y, self.score(z))
        return self.refit()

    def refit(self) -> bool:
        """Fit to all runs, and the lengths too where there are a fifth more."""
        lengths = len(self.y) >= 1.2 * self.fitted
        self.model.optimizer = "fmin_l_bfgs_b" if lengths else None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # a length at its bound: an idle variable
            self.model.fit(self.z, self.y)
        self.model.kernel = self.model.kernel_
        self.fitted = len(self.y) if lengths else self.fitted
        return lengths

    def mean(self, z: Array) -> Array:
        """Return the mean of the score at points of shape (n, d)."""
        return np.concatenate([self.model.predict(part) for part in np.array_split(z, len(z) // BATCH + 1)])

    def predict(self, z: Array) -> tuple[Array, Array]:
        """Return the mean and the standard deviation of the score at points of shape (n, d)."""
        parts = np.array_split(z, len(z) // BATCH + 1)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # a variance below 0, which becomes 0, at a run
            each = [self.model.predict(part, return_std=True) for part in parts]
        means, deviations = zip(*each, strict=True)
        return np.concatenate(means), np.maximum(np.concatenate(deviations), 1e-12)


@dataclass
class Population:
    """Points of normal scores in strata; the mean of the weights in a stratum is its probability."""

    z: Array
    weight: Array
    stratum: Array

    def estimate(self, happened: Array) -> tuple[float, float]:
        """Return the probability of an event of these points, and its standard error within the strata."""
        size = np.bincount(self.stratum)
        mean = np.bincount(self.stratum, self.weight * happened) / size
        square = np.bincount(self.stratum, self.weight**2 * happened) / size
        return float(mean.sum()), math.sqrt(np.maximum(square - mean**2, 0.0) @ (1 / size))

    def joined(self, other: "Population") -> "Population":
        """Return both, as different strata."""
        stratum = np.concatenate([self.stratum, other.stratum + self.stratum.max() + 1])
        return Population(np.vstack([self.z, other.z]), np.concatenate([self.weight, other.weight]), stratum)


def shell(generator: np.random.Generator, number: int, size: int, dimension: int) -> Population:
    """Draw normal scores whose distance from 0 has a tail probability from 10^-number to a tenth of that."""
    tail = 10.0**-number * generator.uniform(0.1, 1.0, size)
    z = generator.standard_normal((size, dimension))
    z *= (np.sqrt(chi2.isf(tail, dimension)) / np.linalg.norm(z, axis=1))[:, None]
    return Population(z, np.full(size, 0.9 * 10.0**-number), np.zeros(size, int))


def shells(generator: np.random.Generator, count: int, size: int, dimension: int) -> Population:
    """Draw as many points in each of the first shells: a population of every rarity."""
    drawn = [shell(generator, number, size, dimension) for number in range(count)]
    return reduce(Population.joined, drawn)


def search(kriging: Kriging, z: Array) -> None:
    """Run the least certain points until one is in the event: signs learnt without an event mean nothing."""
    while kriging.y.min() > 0 and len(kriging.y) < SIMULATIONS:
        mean, deviation = kriging.predict(z)
        kriging.add(z[[(abs(mean) / deviation).argmin()]])


def learn(kriging: Kriging, z: Array) -> tuple[Array, bool]:
    """Run the least certain points until all signs are known; return the means, and whether they are."""
    means, looked = np.empty(len(z)), np.arange(len(z))
    while True:
        means[looked], deviation = kriging.predict(z[looked])
        u = np.where(np.isin(looked, kriging.ran), math.inf, abs(means[looked]) / deviation)
        if u.min() >= SURE and len(looked) == len(z):
            return means, True
        if len(kriging.y) >= SIMULATIONS:
            return means, False
        new = u.min() >= SURE
        if not new:
            kriging.ran.append(looked[u.argmin()])
            new = kriging.add(z[kriging.ran[-1:]])
        looked = np.arange(len(z)) if new else looked[u < FORGET]


@adapter
def ak_mcs(problem: Problem, counter: Counter, generator: np.random.Generator, target: Target) -> Estimate:
    """Kriging on a Monte Carlo population that grows until what lies beyond cannot matter.

    The coefficient of variation of 0.05 that the authors ask of their population takes 4e8 points for a
    probability of 1e-6, too many to be predicted after every run. This population reaches as far with fewer
    points, in shells of the distance from 0: 1,000 stand for the nearest nine tenths of all, as many for nine
    tenths of the rest, and so on. It grows by a shell where theirs would grow tenfold. The first runs are one
    in each of twelve shells, and more until the event is met: twelve runs near 0 tell nothing of an event so
    far away, and learning would end there.
    """
    dimension, score = problem.event.dimension, counter.level(problem, graded=True)
    first = shells(generator, FIRST, 1, dimension).z
    kriging = Kriging(score, first, score(first))
    population = shells(generator, FIRST, POPULATION, dimension)
    search(kriging, population.z)
    for count in range(1, FIRST + 1):
        inner = Population(*(each[: count * POPULATION] for each in vars(population).values()))
        means, sure = learn(kriging, inner.z)
        if 10.0**-count <= BEYOND * inner.estimate(means <= 0)[0]:
            break
    final = shells(generator, count, FINAL, dimension)
    *interval, enough = with_interval(*final.estimate(kriging.mean(final.z) <= 0), target)
    return *interval, sure and enough


@adapter
def ak_is(problem: Problem, counter: Counter, generator: np.random.Generator, target: Target) -> Estimate:
    """Kriging on a normal population about the design point of FORM, whose runs are the first of the fit."""
    dimension, level, seen = problem.event.dimension, counter.level(problem, smooth=True), []

    def remembered(z: Array) -> Array:
        seen.append(z)
        return level(z)

    found = design_point(threshold_event(remembered, dimension, generator))
    centre, first = np.array(found.getStandardSpaceDesignPoint()), np.concatenate(seen)
    # The same runs with their other score: they are not counted again.
    known = Counter(math.inf).level(problem, graded=True)(first)
    kriging = Kriging(counter.level(problem, graded=True), first, known)
    z = centre + generator.standard_normal((FINAL, dimension))
    _, sure = learn(kriging, z[:IMPORTANCE])
    weight = np.exp(centre @ centre / 2 - z @ centre)
    population = Population(z, weight, np.zeros(FINAL, int))
    *interval, enough = with_interval(*population.estimate(kriging.mean(z) <= 0), target)
    return *interval, sure and enough
