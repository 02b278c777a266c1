"""The two-stage Gaussian process of Booth and Renganathan (arXiv 2410.04496), for a fixed budget of runs.

Stage 1 locates the boundary of the event. Its runs are triangulation candidates (centres of the simplices
of the runs so far, and points beyond their hull) on the Pareto front of classification entropy and
standard deviation, as in the earlier work of Booth, Renganathan and Gramacy (arXiv 2308.04420). Stage 2
spends the rest on the points of a Monte Carlo population of the highest entropy. The estimate is the share
of the population that the process predicts to be in the event. Importance sampling is what the authors
advise against at such budgets. They give no interval; the one here knows the error of the population
alone.

Of the three versions of the paper the summaries could be read, not the whole text. So the rule that ends
stage 1 is ours: the estimate has changed by less than a tenth over ten runs, or half of the budget is
spent. The population is another difference: in shells, as for AK-MCS, with entropy times the weight of a
point, because a point of theirs stands for as much as any other.
"""

import numpy as np
from accelerated_evaluation.base.arrays import Array
from kriging import FINAL, FIRST, Kriging, shells
from methods import Counter, Estimate, Target, adapter
from peers import with_interval
from problems import Problem
from scipy.spatial import ConvexHull, Delaunay
from scipy.special import entr, ndtr
from scipy.stats import qmc

SIMULATIONS = 200  # the budget
START = 10  # first runs for each variable, a Latin hypercube in the box
BOX = 6.0  # normal scores within which stage 1 looks
POPULATION = 500  # points of each shell
LOOK, CHANGE = 10, 0.1  # stage 1 ends when the estimate has changed by less over so many runs


def entropy(mean: Array, deviation: Array) -> Array:
    """Return the entropy of being in the event, from the prediction of the score."""
    p = ndtr(-mean / deviation)
    return entr(p) + entr(1 - p)


def triangulated(z: Array) -> Array:
    """Return the centres of the simplices, and points half the way from the facets of the hull to the box."""
    inner = z[Delaunay(z).simplices].mean(axis=1)
    hull = ConvexHull(z)
    facets, outward = z[hull.simplices].mean(axis=1), hull.equations[:, :-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        room = ((BOX * np.sign(outward) - facets) / outward).min(axis=1, initial=np.inf, where=outward != 0)
    return np.vstack([inner, facets + room[:, None] / 2 * outward])


def on_pareto_front(first: Array, second: Array) -> Array:
    """Return the places of the candidates that no other one surpasses in both criteria."""
    order = np.lexsort((-second, -first))
    best = np.maximum.accumulate(second[order])
    return order[np.concatenate([[True], second[order][1:] > best[:-1]])]


@adapter
def two_stage(problem: Problem, counter: Counter, generator: np.random.Generator, target: Target) -> Estimate:
    """Locate the boundary, then run the least certain points of a population, 200 runs in all."""
    dimension, level = problem.event.dimension, counter.level(problem, graded=True)
    cube = qmc.LatinHypercube(dimension, rng=generator).random(START * dimension)
    first = BOX * (2 * cube - 1)
    kriging = Kriging(level, first, level(first))
    population, estimates = shells(generator, FIRST, POPULATION, dimension), []
    while len(kriging.y) < SIMULATIONS // 2:
        estimates.append(population.estimate(kriging.mean(population.z) <= 0)[0])
        recent = estimates[-LOOK - 1 :]
        if len(recent) > LOOK and max(recent) - min(recent) < CHANGE * recent[-1]:
            break
        candidates = triangulated(kriging.z)
        mean, deviation = kriging.predict(candidates)
        front = on_pareto_front(entropy(mean, deviation), deviation)
        kriging.add(candidates[[generator.choice(front)]])
    while len(kriging.y) < SIMULATIONS:
        doubt = population.weight * entropy(*kriging.predict(population.z))
        doubt[kriging.ran] = 0.0
        kriging.ran.append(int(doubt.argmax()))
        kriging.add(population.z[kriging.ran[-1:]])
    mean, deviation = kriging.predict(population.z)
    # The probability that is predicted on the wrong side.
    missing, _ = population.estimate(ndtr(-abs(mean) / deviation))
    final = shells(generator, FIRST, FINAL, dimension)
    probability, error = final.estimate(kriging.mean(final.z) <= 0)
    *interval, enough = with_interval(probability, error, target)
    return *interval, enough and missing <= target.cov * probability
