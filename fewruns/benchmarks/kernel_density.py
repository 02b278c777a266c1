"""Kernel-density adaptive importance sampling (KDE-AIS) of Renganathan and Booth (arXiv 2603.20959).

A Gaussian process of all runs so far gives the probability p of the event at every point of a population.
The next ten runs are drawn from the kernel density of the population, weighted by p^0.9, with a share of
the law of the input that falls with the root of the number of runs. All runs serve both the process and
the estimate, by multiple importance sampling with the mixture of all laws that were drawn from. Batch,
exponent and share are those of the authors' public experiments, which were read to learn what the method
is; this code is our own.

Two things differ. Their population and first runs come from the law of the input, which never comes near
an event of probability 1e-6; here they come from the shells of AK-MCS, and the weights correct for it. And
they spend a fixed number of runs; here the runs end at the target of the benchmark, or after 400.
"""

import math
from dataclasses import dataclass

import numpy as np
from accelerated_evaluation.base.arrays import Array
from kriging import FIRST, Kriging, Population, shells
from methods import Counter, Estimate, Target, adapter
from peers import with_interval
from problems import Problem
from scipy.special import ndtr
from scipy.stats import chi2, gaussian_kde

START, BATCH = 24, 10  # first runs, two of each shell; runs of a batch
POWER = 0.9  # of the predicted probability in the weights
DEFENCE = 0.3  # share of the input's own law, over the root of the number of runs
POPULATION = 1_000  # points of each shell
NEGLIGIBLE = 1e-4  # points of less weight, relative to the largest, get no kernel
EVENTS = 10  # before which no standard error is believed
SIMULATIONS = 400  # runs after which it ends in any case


@dataclass
class Proposal:
    """Kernels on weighted points, with a share of the law of the input."""

    kernels: gaussian_kde
    defence: float

    def draw(self, generator: np.random.Generator, size: int) -> Array:
        """Draw points, shape (size, d)."""
        z = self.kernels.resample(size, seed=generator).T
        own = generator.random(size) < self.defence
        z[own] = generator.standard_normal((own.sum(), z.shape[1]))
        return z

    def ratio(self, z: Array) -> Array:
        """Return its density over that of the input, shape (n,)."""
        log_normal = -np.square(z).sum(axis=1) / 2 - z.shape[1] / 2 * math.log(2 * math.pi)
        return (1 - self.defence) * np.exp(self.kernels.logpdf(z.T) - log_normal) + self.defence


def proposal(kriging: Kriging, population: Population) -> Proposal:
    """Return what is drawn from after the runs so far."""
    mean, deviation = kriging.predict(population.z)
    weight = population.weight * ndtr(-mean / deviation) ** POWER
    kept = weight > NEGLIGIBLE * weight.max()
    kernels = gaussian_kde(population.z[kept].T, "silverman", weight[kept])
    return Proposal(kernels, DEFENCE / math.sqrt(len(kriging.y)))


def shells_ratio(z: Array) -> Array:
    """Return the density of the first runs over that of the input: every shell alike, nothing beyond."""
    number = np.floor(-chi2.logsf(np.square(z).sum(axis=1), z.shape[1]) / math.log(10))
    return np.where(number < FIRST, 10.0**number / (0.9 * FIRST), 0.0)


@adapter
def kde_ais(problem: Problem, counter: Counter, generator: np.random.Generator, target: Target) -> Estimate:
    """Batches from the kernel density of predicted events, until the standard error meets the target."""
    dimension, level = problem.event.dimension, counter.level(problem, graded=True)
    population = shells(generator, FIRST, POPULATION, dimension)
    first = shells(generator, FIRST, START // FIRST, dimension).z
    kriging = Kriging(level, first, level(first))
    drawn = START * shells_ratio(first)  # runs times their mixed density over that of the input
    proposals = []
    while True:
        proposals.append(proposal(kriging, population))
        z = proposals[-1].draw(generator, BATCH)
        drawn += BATCH * proposals[-1].ratio(kriging.z)
        before = START * shells_ratio(z) + sum(BATCH * each.ratio(z) for each in proposals)
        drawn = np.append(drawn, before)
        kriging.add(z)
        n, happened = len(kriging.y), kriging.y <= 0
        terms = np.where(happened, n / drawn, 0.0)
        probability, error = terms.mean(), terms.std(ddof=1) / math.sqrt(n)
        if n >= SIMULATIONS or (happened.sum() >= EVENTS and error <= target.cov * probability):
            *interval, enough = with_interval(probability, error, target)
            return *interval, enough
