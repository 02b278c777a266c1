"""Posterior of the probability of an event in a scenario with joint laws.

For a draw of the law, a candidate is chosen by a draw of the weights, and is refitted to the records with
weights from the Bayesian bootstrap over clusters. The vehicle is not simulated again for every draw: the runs
are made under one law, and are reweighted for every draw.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from fewruns.constants import ENOUGH_DRAWS
from fewruns.estimates import Stopping
from fewruns.predecessor import Predecessor
from fewruns.problems import Response
from fewruns.running import run_batches
from fewruns.sampler import Sampler
from fewruns.several_laws import SMALLEST, SeveralLaws
from numpy.typing import NDArray
from tqdm import tqdm

from accelerated_evaluation.answer.averaged import SHARE, answer_row, unseen_lapses
from accelerated_evaluation.answer.joint.scores import Respond, ScoredLaws
from accelerated_evaluation.answer.posterior import budget
from accelerated_evaluation.answer.reweighting import SampledPosterior
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws.joint import JointLaw
from accelerated_evaluation.laws.joint.truncated_normals import TruncatedNormalMixture
from accelerated_evaluation.methods.surrogate import rules_of_joint_laws
from accelerated_evaluation.scenarios.protocol import FILLED

DRAWS = 100  # number of draws of the law
SIMULATIONS = 200_000  # number of simulations of crude Monte Carlo
ENOUGH_EVENTS = 100  # simulations are repeated with other encounters until there are so many events,
ROUNDS = 25  # or so many repetitions
FEW = 400  # largest number of simulations of the surrogate-guided sampler
UNLIMITED = Stopping(maximum_simulations=sys.maxsize)  # repeats and draws of the law count here as well
MEAN_COMPONENTS = 8  # number of components of the mixture that approximates the mean of the draws
MEAN_POINTS = 8_000  # number of points to which this mixture is fitted


@dataclass(frozen=True)
class DrawnLaws:
    """Draws of the law from its posterior.

    Attributes
    ----------
    laws
        The draws of the law.
    member
        Index of the candidate of each draw, shape (draws,).
    names
        Names of the candidates.
    """

    laws: Sequence[JointLaw]
    member: NDArray[np.int_]
    names: Sequence[str]

    @classmethod
    def of(cls, scored: ScoredLaws, generator: np.random.Generator, draws: int = DRAWS) -> "DrawnLaws":
        """Draw laws from their posterior: candidates by their weights, and parameters by the bootstrap.

        Parameters
        ----------
        scored
            The candidates, with their fits to all records and their scores.
        generator
            Source of all randomness.
        draws
            Number of draws.
        """
        weights = scored.weights(draws, generator)
        uniform = generator.random((draws, 1))
        member = np.minimum((uniform > np.cumsum(weights, axis=1)).sum(axis=1), weights.shape[1] - 1)
        laws = []
        for k in tqdm(member, desc="draws of the law", disable=None):
            known = {"weights": scored.records.resampled(generator), "start": scored.laws[k]}
            laws.append(scored.candidates[k].fit(scored.records, generator, **known))
        return cls(laws, member, [candidate.name for candidate in scored.candidates])

    def log_densities(self, x: Array) -> Array:
        """Return the log density of each draw of the law at n points x, as an array of shape (draws, n).

        Parameters
        ----------
        x
            The points, shape (n, d).
        """
        return np.array([law.log_density(x) for law in self.laws])

    def log_ratios(self, x: Array) -> Array:
        """Return log(density of each draw / density of their mean) at n points x, shape (draws, n)."""
        logs = self.log_densities(x)
        return logs - np.logaddexp.reduce(logs) + np.log(len(logs))

    def sample(self, n: int, generator: np.random.Generator) -> Array:
        """Draw points from the mean of the draws, the same number from each draw.

        The number of points is n, rounded up to a multiple of the number of draws. The result has the shape
        (points, d).

        Parameters
        ----------
        n
            Number of points.
        generator
            Source of all randomness.
        """
        share = -(-n // len(self.laws))
        return np.concatenate([law.sample(share, generator) for law in self.laws])


def simulated_posterior(
    drawn: DrawnLaws,
    respond: Respond,
    generator: np.random.Generator,
    simulations: int = SIMULATIONS,
) -> SampledPosterior:
    """Estimate the probability of the event under each draw of the law, from many simulations.

    The vehicle has to be fast. Encounters are drawn from the mean of the draws and simulated. The events are
    reweighted by the density of each draw divided by the density of the mean. For a rare event, there are up
    to `ROUNDS` rounds of simulations, until there are `ENOUGH_EVENTS` events.

    Parameters
    ----------
    drawn
        Draws of the law.
    respond
        Function that simulates the vehicle at points, shape (n, d), and returns whether the event happened,
        shape (n,), and the scores of the outcomes, shape (n,).
    generator
        Source of all randomness.
    simulations
        Number of simulations of a round.

    Returns
    -------
    SampledPosterior
        Estimated probability under each draw of the law, with its relative standard error.

    Raises
    ------
    InputError
        If the event did not happen in any simulation.
    """
    events, size = simulated_events(drawn, respond, generator, simulations)
    return posterior_of_events(drawn, events, size)


def simulated_events(
    drawn: DrawnLaws, respond: Respond, generator: np.random.Generator, simulations: int = SIMULATIONS
) -> tuple[Array, int]:
    """Return the events among encounters drawn from the mean of the draws, (m, d), and how many were drawn.

    Arguments and errors are those of `simulated_posterior`.
    """
    rounds, size = [], 0
    while len(rounds) < ROUNDS and sum(map(len, rounds)) < ENOUGH_EVENTS:
        x = drawn.sample(simulations, generator)
        rounds.append(x[respond(x)[0]])
        size += len(x)
    events = np.concatenate(rounds)
    if not len(events):
        raise InputError(
            f"the laws {', '.join(sorted({drawn.names[k] for k in drawn.member}))}",
            seen=f"no event in {size:,} encounters drawn from them, so that its probability is 0 or below "
            f"{3 / size:.1g} (95 % confidence)",
            expected="laws with probability where the event happens",
            change="Check the limits of the variables and the event. If the event is really so rare, use "
            "the surrogate-guided method.",
        )
    return events, size


def posterior_of_events(drawn: DrawnLaws, events: Array, size: int) -> SampledPosterior:
    """Return the probability of the event under each draw, from the results of `simulated_events`."""
    ratios = np.exp(drawn.log_ratios(events))
    estimates = ratios.sum(axis=1) / size
    variances = np.maximum((ratios**2).sum(axis=1) / size - estimates**2, 0) / size
    known = np.maximum(estimates, SMALLEST * estimates.mean())
    return SampledPosterior(known, np.minimum(np.sqrt(variances) / known, 1), drawn.member, size)


def mean_law(drawn: DrawnLaws, generator: np.random.Generator) -> TruncatedNormalMixture:
    """Approximate the mean of the draws by a mixture of truncated normal distributions.

    The mixture maps normal scores (coordinates in which it is standard normal) to encounters quickly. The
    approximation does not bias the answer, because runs under the mixture are reweighted by exact ratios of
    densities.

    Parameters
    ----------
    drawn
        Draws of the law.
    generator
        Source of all randomness.

    Returns
    -------
    TruncatedNormalMixture
        The mixture, from which the sampler can draw its runs.
    """
    x = drawn.sample(MEAN_POINTS, generator)
    return TruncatedNormalMixture.fit(x, drawn.laws[0].box, generator, components=MEAN_COMPONENTS)


@dataclass(frozen=True)
class SampledLaw:
    """The encounters of a law as a problem of normal scores, for the sampler."""

    law: TruncatedNormalMixture
    respond: Respond
    respond_again: Respond  # simulates the vehicle again, even if outcomes are stored

    def evaluate(self, z: Array) -> Response:
        """Simulate the encounters with normal scores z, shape (n, d)."""
        return self.respond(self.law.from_normal_scores(z))

    def repeat(self, z: Array) -> Response:
        """Simulate the encounters again."""
        return self.respond_again(self.law.from_normal_scores(z))


def surrogate_posterior(
    drawn: DrawnLaws,
    respond: Respond,
    generator: np.random.Generator,
    simulations: int = FEW,
    share: float = SHARE,
    filled: float = FILLED,
    deterministic: bool | None = True,
    repeat: Respond | None = None,
    known: Callable[[Callable[[Array], Array]], Predecessor | None] = lambda _: None,
) -> tuple[SampledPosterior | None, Sampler, bool]:
    """Estimate the probability of the event under each draw of the law, from few simulations.

    The surrogate-guided sampler chooses the runs. They end when the sampling increases the width of the 80 %
    interval of the answer by at most a given share and the certificate is met (a bound on the probability of
    the parts of the event that no run has observed), or at the limit of simulations. They also end if the
    vehicle may lapse (rarely behave differently than in most runs of the same encounter) and more runs would
    not improve the result.

    Parameters
    ----------
    drawn
        Draws of the law.
    respond
        Function that simulates the vehicle at points, shape (n, d), and returns whether the event happened,
        shape (n,), and the scores of the outcomes, shape (n,).
    generator
        Source of all randomness.
    simulations
        Largest number of simulations, without those that check whether the vehicle is deterministic.
    share
        Allowed relative increase of the width of the 80 % interval by the sampling.
    filled
        Smallest share of the encounters in a part of the event in which the event happens. It is small if
        rounding errors decide in a part of the encounters.
    deterministic
        Whether an encounter always has the same outcome; None if this is unknown, so that some runs are
        repeated.
    repeat
        Function that simulates the vehicle again, even if outcomes are stored; by default ``respond``.
    known
        Function that returns known runs for the sampler, or None, given the map from normal scores to points.

    Returns
    -------
    posterior : SampledPosterior or None
        The probability under each draw, with the bound on unobserved lapses; None if there is no estimate.
    sampler : Sampler
        The sampler, with its runs and its estimate under the law that was sampled.
    converged : bool
        Whether the estimate is precise enough, the certificate is met and the vehicle does not lapse.
        Otherwise the runs may have missed a part of the event; the diagnostic ``unseen_mode`` of the
        sampler's estimate bounds its probability.
    """
    law = mean_law(drawn, generator)
    sampler = Sampler(
        law.dimension,
        generator,
        fingerprint="mean of the draws of the law",
        predecessor=known(law.from_normal_scores),
        deterministic=deterministic,
        enough_draws=ENOUGH_DRAWS,
        **rules_of_joint_laws(filled),
    )
    laws = SeveralLaws(lambda x: drawn.log_densities(x) - law.log_density(x), law.from_normal_scores)
    problem, posterior = SampledLaw(law, respond, repeat or respond), None

    def is_enough() -> bool:
        return posterior is not None and posterior.share_of_sampling <= share

    for _ in run_batches(sampler, problem, UNLIMITED, is_enough):
        found = laws.estimate(sampler)
        posterior = None if found is None else SampledPosterior.of(found, drawn.member)
        if len(sampler.progress.z) + sampler.batch_size > simulations:
            break
    if posterior is not None:
        posterior = replace(posterior, unseen_lapses=unseen_lapses(sampler, posterior))
    return posterior, sampler, is_enough() and sampler.is_settled()


def answer_tables(posterior: SampledPosterior, drawn: DrawnLaws) -> dict[str, pd.DataFrame]:
    """Return the probability of the event with its uncertainty as three tables.

    Parameters
    ----------
    posterior
        Estimated probability under each draw of the law.
    drawn
        The draws of the law.

    Returns
    -------
    dict
        ``answer``, one row with the ``event`` and the mean ``probability``, the ``median``, and the ends
        ``low50`` to ``high95`` of the 50, 80 and 95 % credible intervals; ``budget``, the variance of the log
        probability by source (data, choice of law, sampling); and ``draws``, one row for each draw of the
        law: its number ``draw``, ``law``, ``probability`` of the event and relative ``error``.
    """
    draws = {
        "draw": np.arange(len(drawn.laws)) + 1,
        "law": np.array(drawn.names)[drawn.member],
        "probability": posterior.probabilities,
        "error": posterior.errors,
    }
    return {
        "answer": pd.DataFrame([{"event": "crash"} | answer_row(posterior, posterior.unseen_lapses)]),
        "budget": budget(posterior.alone, posterior.deviation),
        "draws": pd.DataFrame(draws),
    }
