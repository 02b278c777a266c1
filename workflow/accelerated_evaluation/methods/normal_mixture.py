"""Importance sampling from a mixture of normal distributions in the space of normal scores.

The method works for every problem with normal scores, whatever its dimension and its law. It learns in a few
stages. Each stage simulates points that are drawn from the current mixture. It then fits a new mixture to
the points of all stages at which the event happened, weighted by their likelihood ratios; this is a step of
the Cross-Entropy method. As long as fewer than ELITE events have happened, the points that came nearest to
the event are added. The mixture always contains the standard normal distribution with the share DEFENSIVE, so
that no likelihood ratio exceeds 1 / DEFENSIVE. The estimate uses only new simulations from the last mixture.
"""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from fewruns.problems import ScoreProblem
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2
from scipy.special import logsumexp

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.methods import METHODS, Estimate, Method, Stopping
from accelerated_evaluation.methods.intervals import Sums, gamma_interval, sequential_estimate

DEFENSIVE = 0.25  # share of the standard normal distribution in the mixture
STAGES, STAGE_SIZE = 4, 500  # number of stages of learning, and of simulations in each
ELITE = 50  # smallest number of points to which a mixture is fitted
COMPONENTS = 6  # largest number of components in addition to the standard normal one
LEAST_VARIANCE = 0.05  # added to the variance of each component in every direction
WIDE = 1.5  # standard deviation of the draws of the first stage


@dataclass(frozen=True)
class NormalMixture:
    """A mixture of normal distributions; the first component is standard normal with share DEFENSIVE."""

    shares: Array  # (K,)
    means: Array  # (K, d)
    factors: Array  # lower Cholesky factors of the covariance matrices, (K, d, d)

    def sample(self, n: int, generator: np.random.Generator) -> Array:
        """Draw n points of d normal scores, shape (n, d)."""
        which = generator.choice(len(self.shares), size=n, p=self.shares)
        steps = generator.standard_normal((n, self.means.shape[1]))
        return self.means[which] + np.einsum("nij,nj->ni", self.factors[which], steps)

    def log_ratio(self, z: Array) -> Array:
        """Return log f / f* at points z, shape (n, d), where f is standard normal and f* is this mixture.

        The result has shape (n,).
        """
        logs = []
        for share, mean, factor in zip(self.shares, self.means, self.factors, strict=True):
            standardised = np.linalg.solve(factor, (z - mean).T)
            logs.append(
                np.log(share) - np.log(np.diag(factor)).sum() - 0.5 * np.square(standardised).sum(axis=0)
            )
        return -0.5 * np.square(z).sum(axis=1) - logsumexp(logs, axis=0)

    @classmethod
    def fitted(cls, z: Array, weights: Array, generator: np.random.Generator) -> "NormalMixture":
        """Return a mixture of a standard normal component and one for each cluster of points.

        The points are clustered by k-means from random starts.
        """
        dimension = z.shape[1]
        count = max(1, min(COMPONENTS, len(z) // (4 * dimension)))
        _, label = kmeans2(z, count, minit="++", rng=generator)
        shares, means, factors = [DEFENSIVE], [np.zeros(dimension)], [np.eye(dimension)]
        for own in (label == k for k in np.unique(label)):
            share = weights[own].sum() / weights.sum()
            mean = np.average(z[own], axis=0, weights=weights[own])
            spread = np.einsum("n,ni,nj->ij", weights[own], z[own] - mean, z[own] - mean) / weights[own].sum()
            shares.append((1 - DEFENSIVE) * share)
            means.append(mean)
            factors.append(np.linalg.cholesky(spread + LEAST_VARIANCE * np.eye(dimension)))
        return cls(np.array(shares) / sum(shares), np.array(means), np.array(factors))


@METHODS.add("normal_mixture")
class NormalMixtureSampling(Method):
    """Importance sampling from a mixture of normal distributions, fitted by the Cross-Entropy method."""

    style: ClassVar[dict[str, Any]] = {"color": "#b15928", "linestyle": (0, (1, 1)), "marker": "X"}

    def estimate(self, problem: ScoreProblem, stopping: Stopping, generator: np.random.Generator) -> Estimate:
        """Fit a mixture, and return the probability of the event estimated from new simulations.

        The interval is the gamma interval of Fay and Feuer (1997). The diagnostics are
        ``effective_sample_size``, (sum w)^2 / sum w^2 over the weights w of the events,
        and ``largest_weight_share``, the largest weight divided by the sum of all weights.
        """
        mixture, learning = self._learnt(problem, generator)

        def draw(size: int) -> Sums:
            z = mixture.sample(size, generator)
            happened, _ = problem.evaluate(z)
            return Sums.of(np.where(happened, np.exp(mixture.log_ratio(z)), 0.0))

        left = max(stopping.maximum_simulations - learning, 1)
        sums, converged = sequential_estimate(draw, replace(stopping, maximum_simulations=left))
        # The bound 1 / DEFENSIVE far exceeds the usual weights, so it is used only if there is no event.
        low, high = gamma_interval(sums, stopping.alpha, None if sums.events else 1 / DEFENSIVE)
        diagnostics = {
            "effective_sample_size": sums.total**2 / sums.squares if sums.events else 0.0,
            "largest_weight_share": sums.largest / sums.total if sums.events else np.nan,
        }
        counts = learning, sums.simulations, sums.events
        return Estimate(sums.probability, low, high, stopping.alpha, *counts, converged, diagnostics)

    def _learnt(self, problem: ScoreProblem, generator: np.random.Generator) -> tuple[NormalMixture, int]:
        """Return the mixture of the last stage, and the number of simulations of all stages."""
        dimension = problem.dimension
        wide = np.array([np.eye(dimension), WIDE * np.eye(dimension)])
        mixture = NormalMixture(np.array([DEFENSIVE, 1 - DEFENSIVE]), np.zeros((2, dimension)), wide)
        points, ratios, reached, scores = [], [], [], []
        for _ in range(STAGES):
            z = mixture.sample(STAGE_SIZE, generator)
            happened, score = problem.evaluate(z)
            points.append(z)
            ratios.append(mixture.log_ratio(z))
            reached.append(happened)
            scores.append(np.zeros(len(z)) if score is None else score)
            z, happened = np.concatenate(points), np.concatenate(reached)
            chosen = _nearest(happened, np.concatenate(scores), graded=score is not None)
            if np.count_nonzero(chosen) > dimension + 1:
                mixture = NormalMixture.fitted(z[chosen], np.exp(np.concatenate(ratios)[chosen]), generator)
        return mixture, STAGES * STAGE_SIZE


def _nearest(happened: NDArray[np.bool_], score: Array, *, graded: bool) -> NDArray[np.bool_]:
    """Return which points to fit: the events, or the ELITE points nearest to the event if there are fewer.

    Without scores (``graded`` is False), only the events are returned. The result has shape (n,).
    """
    if np.count_nonzero(happened) >= ELITE or not graded:
        return happened
    order = np.argsort(np.where(happened, -np.inf, score), kind="stable")
    chosen = np.zeros(len(score), bool)
    chosen[order[:ELITE]] = True
    return chosen
