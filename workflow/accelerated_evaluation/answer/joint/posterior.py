"""Posterior of the probability of an event under joint laws: draws of the law, simulated once.

A draw of the law is a candidate, chosen by a draw of the weights, and refitted to the records with weights by
the Bayesian bootstrap over clusters. All draws share the same runs: these are made under one law and
reweighted for every draw.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from tqdm import tqdm

from accelerated_evaluation.answer.averaged import SHARE
from accelerated_evaluation.answer.joint.scores import Respond, ScoredLaws
from accelerated_evaluation.answer.posterior import budget
from accelerated_evaluation.answer.reweighting import SMALLEST, Reweighting, SampledPosterior
from accelerated_evaluation.answer.summary import summarise
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws.joint import JointLaw
from accelerated_evaluation.laws.joint.truncated_normals import TruncatedNormalMixture
from accelerated_evaluation.methods.surrogate import FREQUENT_EVENTS
from accelerated_evaluation.methods.surrogate.sampler import Sampler

DRAWS = 100
SIMULATIONS = 200_000  # of crude Monte Carlo
FEW = 150  # simulations with a surrogate
MEAN_COMPONENTS = 8  # of the mixture that stands for the mean of the draws when runs are few
MEAN_POINTS = 8_000  # to which this mixture is fitted


@dataclass(frozen=True)
class DrawnLaws:
    """Draws of the law from its posterior.

    Attributes
    ----------
    laws
        The draws.
    member
        Number of the candidate of each, shape (draws,).
    names
        Names of the candidates.
    """

    laws: Sequence[JointLaw]
    member: NDArray[np.int_]
    names: Sequence[str]

    @classmethod
    def of(cls, scored: ScoredLaws, generator: np.random.Generator, draws: int = DRAWS) -> "DrawnLaws":
        """Draw laws, with their weights and parameters."""
        weights = scored.weights(draws, generator)
        uniform = generator.random((draws, 1))
        member = np.minimum((uniform > np.cumsum(weights, axis=1)).sum(axis=1), weights.shape[1] - 1)
        laws = []
        for k in tqdm(member, desc="draws of the law", disable=None):
            known = {"weights": scored.records.resampled(generator), "start": scored.laws[k]}
            laws.append(scored.candidates[k].fit(scored.records, generator, **known))
        return cls(laws, member, [candidate.name for candidate in scored.candidates])

    def log_densities(self, x: Array) -> Array:
        """Return the log density of each draw at points, shape (draws, n)."""
        return np.array([law.log_density(x) for law in self.laws])

    def sample(self, n: int, generator: np.random.Generator) -> Array:
        """Draw about n points from the mean of the draws, equally many from each."""
        share = -(-n // len(self.laws))
        return np.concatenate([law.sample(share, generator) for law in self.laws])


def simulated_posterior(
    drawn: DrawnLaws,
    respond: Respond,
    generator: np.random.Generator,
    simulations: int = SIMULATIONS,
) -> SampledPosterior:
    """Return the probability of the event under each draw, by crude Monte Carlo under their mean.

    Parameters
    ----------
    drawn
        Draws of the law.
    respond
        Runs the vehicle.
    generator
        Source of all randomness.
    simulations
        Number of runs.

    Raises
    ------
    InputError
        If no draw of the laws reaches the event.
    """
    x = drawn.sample(simulations, generator)
    events = x[respond(x)[0]]
    if not len(events):
        raise InputError(
            f"the laws {', '.join(sorted({drawn.names[k] for k in drawn.member}))}",
            seen=f"no event in {len(x):,} encounters drawn from them, so that its probability is 0 or below "
            f"{3 / len(x):.1g} (95 % confidence)",
            expected="laws with probability where the event happens",
            change="Check the limits of the variables and the event. If the event is that rare, use "
            "the method with a surrogate.",
        )
    logs = drawn.log_densities(events)
    ratios = np.exp(logs - np.logaddexp.reduce(logs) + np.log(len(logs)))
    estimates = ratios.sum(axis=1) / len(x)
    variances = np.maximum((ratios**2).sum(axis=1) / len(x) - estimates**2, 0) / len(x)
    known = np.maximum(estimates, SMALLEST * estimates.mean())
    return SampledPosterior(known, np.minimum(np.sqrt(variances) / known, 1), drawn.member, len(x))


def mean_law(drawn: DrawnLaws, generator: np.random.Generator) -> TruncatedNormalMixture:
    """Return a mixture that is close to the mean of the draws, and that maps normal scores quickly.

    Runs under it are reweighted by the exact ratio of densities, so that it need not be the mean itself.
    """
    x = drawn.sample(MEAN_POINTS, generator)
    return TruncatedNormalMixture.fit(x, drawn.laws[0].box, generator, components=MEAN_COMPONENTS)


def surrogate_posterior(
    drawn: DrawnLaws,
    respond: Respond,
    generator: np.random.Generator,
    simulations: int = FEW,
    share: float = SHARE,
) -> tuple[SampledPosterior | None, Sampler, bool]:
    """Return the probability of the event under each draw, by few runs of the surrogate-guided sampler.

    The runs end when more of them would make the 80 % interval of the answer narrower by less than a share of
    its width, or at the limit of simulations.

    Parameters
    ----------
    drawn
        Draws of the law.
    respond
        Runs a vehicle that repeats itself.
    generator
        Source of all randomness.
    simulations
        Largest number of runs.
    share
        Share of the width of the 80 % interval that the sampling may add.

    Returns
    -------
    posterior : SampledPosterior or None
        None if no batch of runs gives an estimate.
    sampler : Sampler
        The sampler, with its runs and its estimate under the law that was sampled.
    converged : bool
        Whether the runs ended before the limit. Otherwise a part of the event may be missing: the sampler is
        made for rare events, and what it has excluded is in the diagnostic ``unseen_mode`` of its estimate.
    """
    law = mean_law(drawn, generator)
    sampler = Sampler(
        law.dimension,
        generator,
        fingerprint="mean of the draws of the law",
        deterministic=True,
        **FREQUENT_EVENTS,
    )
    reweighting = Reweighting(
        lambda x: drawn.log_densities(x) - law.log_density(x), law.from_normal_scores, drawn.member
    )
    posterior = None
    while sampler.simulations + sampler.batch_size <= simulations:
        is_enough = posterior is not None and posterior.share_of_sampling <= share
        if is_enough and sampler.is_settled():
            return posterior, sampler, True
        z = sampler.ask(certify=is_enough)
        sampler.tell(*respond(law.from_normal_scores(z)))
        if sampler.progress.happened.any():
            posterior = reweighting.estimate(sampler.progress)
    return posterior, sampler, False


def answer_tables(posterior: SampledPosterior, drawn: DrawnLaws) -> dict[str, pd.DataFrame]:
    """Return the tables ``answer`` (see `summarise`), ``budget`` and ``draws`` of a posterior."""
    draws = {
        "draw": np.arange(len(drawn.laws)) + 1,
        "law": np.array(drawn.names)[drawn.member],
        "probability": posterior.probabilities,
        "error": posterior.errors,
    }
    whole = summarise(posterior.whole) | {"probability": float(posterior.probabilities.mean())}
    return {
        "answer": pd.DataFrame([{"event": "crash"} | whole]),
        "budget": budget(posterior.alone, posterior.deviation),
        "draws": pd.DataFrame(draws),
    }
