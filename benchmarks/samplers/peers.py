"""Public tools: OpenTURNS (NAIS, subset and directional sampling, FORM), rareeventestimation (EnKF).

OpenTURNS 1.27 has no line sampling (Koutsourelakis, Pradlwarter and Schuëller 2004). It is written here,
along the direction that FORM of OpenTURNS finds.

Settings are those with which each tool did best in trials on the main problem. NAIS and subset sampling get
the score of the event, the smallest time to collision; FORM, Cross-Entropy and EnKF did better with the
smooth one. Intervals are normal, from the standard error that the tool reports.
"""

import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import openturns as ot
from accelerated_evaluation.base.arrays import Array
from fewruns.arrays import Function, Generator
from methods import Counter, Estimate, Target, adapter, normal_95
from problems import Problem
from scipy.optimize import brentq
from scipy.special import ndtr

# FORM: it starts from this normal score of the last variable, TTC^-1, and 0 of the others; a minimum of the
# distance this near to the limit state is taken, because a simulation in steps of time makes the score jump.
START, NEAR = 3.0, 0.05
# Line sampling: fewest lines, steps in which a root is bracketed, and distance up to which it is searched.
FEWEST_LINES, WIDTH, FARTHEST = 10, 0.5, 10.0


def rare_event(
    problem: Problem, counter: Counter, generator: Generator, *, smooth: bool
) -> ot.ThresholdEvent:
    """Return the event "level <= 0" of a problem for OpenTURNS."""
    return threshold_event(counter.level(problem, smooth=smooth), problem.event.dimension, generator)


def threshold_event(level: Function, dimension: int, generator: Generator) -> ot.ThresholdEvent:
    """Return the event "level <= 0" for OpenTURNS, and seed its generator."""
    ot.RandomGenerator.SetSeed(int(generator.integers(2**31)))
    function = ot.PythonFunction(dimension, 1, func_sample=lambda z: level(np.asarray(z))[:, None])
    normal = ot.RandomVector(ot.Normal(dimension))
    return ot.ThresholdEvent(ot.CompositeRandomVector(function, normal), ot.LessOrEqual(), 0.0)


def finished(algorithm: ot.EventSimulation, target: Target) -> Estimate:
    """Run an algorithm and read its result."""
    algorithm.run()
    result = algorithm.getResult()
    return with_interval(result.getProbabilityEstimate(), result.getStandardDeviation(), target)


def with_interval(probability: float, error: float, target: Target) -> Estimate:
    """Return an estimate with the normal interval of its standard error."""
    reach = target.reach * error
    low, high = probability - reach, probability + reach
    return probability, low, high, *normal_95(probability, low, high), error <= target.cov * probability


def in_levels(algorithm: ot.EventSimulation, size: int, target: Target) -> Estimate:
    """Run an algorithm that draws ``size`` points a level."""
    algorithm.setMaximumOuterSampling(1)
    algorithm.setBlockSize(size)
    return finished(algorithm, target)


@adapter
def nais(problem: Problem, counter: Counter, generator: Generator, target: Target) -> Estimate:
    """Non-parametric adaptive importance sampling: 300 points a level, the lowest tenth kept."""
    event = rare_event(problem, counter, generator, smooth=False)
    return in_levels(ot.NAIS(event, 0.1), 300, target)


@adapter
def nais_25(problem: Problem, counter: Counter, generator: Generator, target: Target) -> Estimate:
    """Non-parametric adaptive importance sampling: 200 points a level, the lowest quarter kept."""
    event = rare_event(problem, counter, generator, smooth=False)
    return in_levels(ot.NAIS(event, 0.25), 200, target)


@adapter
def cross_entropy(problem: Problem, counter: Counter, generator: Generator, target: Target) -> Estimate:
    """Cross-Entropy of one Gaussian in normal scores: 2,000 points a level."""
    event = rare_event(problem, counter, generator, smooth=True)
    return in_levels(ot.StandardSpaceCrossEntropyImportanceSampling(event, 0.1), 2000, target)


@adapter
def subset(problem: Problem, counter: Counter, generator: Generator, target: Target) -> Estimate:
    """Subset sampling: 10,000 points a level, the lowest tenth kept."""
    event = rare_event(problem, counter, generator, smooth=False)
    algorithm = ot.SubsetSampling(event)
    algorithm.setMaximumOuterSampling(10)
    algorithm.setBlockSize(1000)
    return finished(algorithm, target)


def design_point(event: ot.ThresholdEvent) -> ot.FORMResult:
    """Search the point of the event that is nearest to the origin."""
    dimension = event.getAntecedent().getDimension()
    solver = ot.Cobyla(ot.OptimizationProblem(), 0.5)
    solver.setStartingPoint([0.0] * (dimension - 1) + [START])
    solver.setMaximumConstraintError(NEAR)
    solver.setMaximumCallsNumber(1000)
    search = ot.FORM(solver, event)
    search.run()
    return search.getResult()


@adapter
def form(problem: Problem, counter: Counter, generator: Generator, target: Target) -> Estimate:
    """First-order reliability method, then importance sampling around its design point until the target."""
    event = rare_event(problem, counter, generator, smooth=True)
    algorithm = ot.PostAnalyticalImportanceSampling(design_point(event))
    algorithm.setMaximumCoefficientOfVariation(target.cov)
    algorithm.setBlockSize(100)
    algorithm.setMaximumOuterSampling((target.maximum_simulations - counter.calls) // 100)
    return finished(algorithm, target)


@adapter
def directional(problem: Problem, counter: Counter, generator: Generator, target: Target) -> Estimate:
    """Directional sampling: roots along random directions, a direction at a time, until the target."""
    event = rare_event(problem, counter, generator, smooth=True)
    algorithm = ot.DirectionalSampling(event, ot.RiskyAndFast(), ot.RandomDirection())
    algorithm.setMaximumCoefficientOfVariation(target.cov)
    algorithm.setBlockSize(1)
    algorithm.setMaximumOuterSampling(target.maximum_simulations)
    return finished(algorithm, target)


@adapter
def line(problem: Problem, counter: Counter, generator: Generator, target: Target) -> Estimate:
    """Line sampling: roots along lines parallel to the direction of the design point, until the target."""
    level, dimension = counter.level(problem, smooth=True), problem.event.dimension
    event = threshold_event(level, dimension, generator)
    point = np.array(design_point(event).getStandardSpaceDesignPoint())
    nearest = np.linalg.norm(point)
    along = point / nearest
    found: list[float] = []
    while len(found) < FEWEST_LINES or np.std(found, ddof=1) > target.cov * np.mean(found) * math.sqrt(
        len(found)
    ):
        across = generator.standard_normal(dimension)
        across -= (across @ along) * along

        def at(distance: float, across: Array = across) -> float:
            return float(level((across + distance * along)[None])[0])

        found.append(beyond_root(at, nearest))
    return with_interval(np.mean(found), np.std(found, ddof=1) / math.sqrt(len(found)), target)


def beyond_root(level: Callable[[float], float], near: float) -> float:
    """Return the normal probability beyond the root of a level along a line; it is searched from ``near``."""
    low, high = near, near + WIDTH
    while level(low) <= 0:
        if low <= -FARTHEST:
            return 1.0  # the whole line is in the event
        low, high = low - WIDTH, low
    while level(high) > 0:
        if high >= FARTHEST:
            return 0.0  # the line never meets the event
        low, high = high, high + WIDTH
    return float(ndtr(-brentq(level, low, high, xtol=NEAR)))


@adapter
def enkf(problem: Problem, counter: Counter, generator: Generator, target: Target) -> Estimate:
    """Ensemble Kalman filter of 300 particles, then importance sampling from one Gaussian fitted to them."""
    from rareeventestimation.enkf.EnKF_rare_events import EnKF_rare_events  # takes ten seconds

    level, size, dimension = counter.level(problem, smooth=True), 300, problem.event.dimension

    def above(z: Array) -> Array:
        return np.maximum(level(np.atleast_2d(z)), 0.0)

    np.random.seed(int(generator.integers(2**31)))  # noqa: NPY002, the tool draws from the global state
    settings = {"niter_enkf": 100, "ensemble_size": size, "parameter_dim": dimension, "tar_cov": 1.5}
    settings |= {"space_dim": 0, "local_covariances": False, "k_init": 1, "mixture_model": "GM"}
    filtering = EnKF_rare_events(above, np.zeros((1, 1)), g_original=lambda z: level(z[None])[0], **settings)
    filtering.perform_iteration()
    weights = filtering.calculate_failure_probability_GM()[0]
    return with_interval(weights.mean(), weights.std(ddof=1) / math.sqrt(size), target)


def learnt(
    problem: Problem, counter: Counter, generator: Generator, target: Target, **settings: Any
) -> Estimate:
    """Active learning by pystra with some settings; it needs Python 3.12, so it is imported here."""
    import pystra

    level, model = counter.level(problem), pystra.StochasticModel()
    names = [f"z{k}" for k in range(problem.event.dimension)]
    for name in names:
        model.add_variable(pystra.Normal(name, 0.0, 1.0))
    limit = pystra.LimitState(lambda **z: level(np.column_stack([np.atleast_1d(z[name]) for name in names])))
    warnings.simplefilter("ignore")  # that it has not converged is in the result
    found = pystra.ActiveLearning(model, limit, rng=generator, **settings).run()
    error = found.estimate.sampling_cov * found.estimate.failure_probability
    *numbers, _ = with_interval(found.estimate.failure_probability, error, target)
    return *numbers, found.converged


@adapter
def pystra_subset(problem: Problem, counter: Counter, generator: Generator, target: Target) -> Estimate:
    """Active learning where subset sampling of the surrogate needs it; defaults, for rare events."""
    from pystra.active_learning import SubsetSimulationEstimator

    return learnt(problem, counter, generator, target, estimator=SubsetSimulationEstimator())


@adapter
def ak_mcs(problem: Problem, counter: Counter, generator: Generator, target: Target) -> Estimate:
    """AK-MCS (Echard and others 2011): a population of 300,000, and ten times as many for the estimate."""
    return learnt(problem, counter, generator, target, n_candidates=300_000, n_estimation=3_000_000)
