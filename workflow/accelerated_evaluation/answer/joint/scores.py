"""Joint laws fitted to the records of a scenario, with scores on held-out records near the event.

The records come in clusters, such as those of one driver. A block that is held out consists of whole
clusters, because the records of a driver resemble each other.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from fewruns.problems import Response
from numpy.typing import ArrayLike, NDArray

from accelerated_evaluation.answer.scores import BLOCKS
from accelerated_evaluation.answer.weights import bootstrapped_weights
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws.joint import JOINT_LAWS, Box, JointLaw

NEAR = 0.1  # share of the records that are near the event: those with the smallest scores
POOL = 20_000  # number of points with which the probability of the region near the event is estimated
SMALLEST = 1e-9  # smallest probability outside of the region, so that its logarithm is finite

Respond = Callable[[Array], Response]
"""Simulates the vehicle at points, shape (n, d), and returns whether the event happened, and the scores."""


@dataclass(frozen=True)
class Candidate:
    """A kind of joint law with its settings.

    Attributes
    ----------
    name
        Name in tables.
    kind
        Name in the registry `JOINT_LAWS`.
    settings
        Settings of the fit.
    """

    name: str
    kind: str
    settings: Mapping[str, Any]

    def fit(
        self,
        records: "ClusteredRecords",
        generator: np.random.Generator,
        **known: Any,  # noqa: ANN401
    ) -> JointLaw:
        """Fit the law to records.

        Parameters
        ----------
        records
            The records.
        generator
            Source of all randomness.
        known
            Optionally ``weights`` of the records, shape (n,), and a law ``start`` from which the fit begins.
        """
        return JOINT_LAWS[self.kind].fit(records.x, records.box, generator, **known, **self.settings)


CANDIDATES = (
    *(
        Candidate(f"truncated normals, K = {k}", "truncated_normals", {"components": k})
        for k in (2, 3, 4, 6, 8)
    ),
    Candidate("Gaussian copula", "gaussian_copula", {}),
    Candidate("kernel", "kernel", {}),
    Candidate("independent", "independent_variables", {}),
)


@dataclass(frozen=True)
class ClusteredRecords:
    """The records of a scenario, with clusters of records that may depend on each other.

    Attributes
    ----------
    x
        The records, shape (n, d).
    cluster
        Index of the cluster of each record, shape (n,).
    box
        The variables and their limits.
    """

    x: Array
    cluster: NDArray[np.int_]
    box: Box

    @classmethod
    def of(cls, x: Array, cluster: ArrayLike, box: Box, where: str = "the records") -> "ClusteredRecords":
        """Return checked records whose clusters are numbered.

        Parameters
        ----------
        x
            The records, shape (n, d).
        cluster
            Name of the cluster of each record, shape (n,).
        box
            The variables and their limits.
        where
            Name of the records in error messages.

        Raises
        ------
        InputError
            If a record is outside of the box, or if there are fewer than two clusters.
        """
        box.require(x, where)
        names, number = np.unique(np.asarray(cluster), return_inverse=True)
        if len(names) < 2:
            raise InputError(
                f"{where}, the clusters",
                seen=f"{len(names)} cluster of {len(x)} records",
                expected="at least 2 clusters, such as drivers or devices",
                change="Name the column that says which records depend on each other.",
            )
        return cls(x, number, box)

    @property
    def clusters(self) -> int:
        """Number of clusters."""
        return int(self.cluster.max()) + 1

    @property
    def effective_clusters(self) -> float:
        """Effective number of clusters (Kish 1965): squared sum of their sizes over the sum of squares."""
        sizes = np.bincount(self.cluster)
        return float(sizes.sum() ** 2 / (sizes**2).sum())

    def blocks(self, blocks: int = BLOCKS) -> NDArray[np.int_]:
        """Divide the records into blocks of about the same size, and return the block of each record.

        Every block consists of complete clusters. The clusters are assigned in the order of falling size,
        each to the block that is smallest so far.

        Parameters
        ----------
        blocks
            Number of blocks, or the number of clusters if that is smaller.

        Returns
        -------
        numpy.ndarray
            Index of the block of each record, shape (n,).
        """
        sizes = np.bincount(self.cluster)
        totals, block = np.zeros(min(blocks, self.clusters)), np.empty(self.clusters, dtype=int)
        for cluster in np.argsort(-sizes, kind="stable"):
            block[cluster] = totals.argmin()
            totals[block[cluster]] += sizes[cluster]
        return block[self.cluster]

    def only(self, kept: NDArray[np.bool_]) -> "ClusteredRecords":
        """Return the records that are selected by a mask, shape (n,)."""
        return ClusteredRecords(self.x[kept], self.cluster[kept], self.box)

    def resampled(self, generator: np.random.Generator) -> Array:
        """Draw weights of the records by the Bayesian bootstrap over clusters (Rubin 1981), shape (n,).

        All records of a cluster have the same weight.
        """
        return generator.standard_exponential(self.clusters)[self.cluster]


@dataclass(frozen=True)
class ScoredLaws:
    """Joint laws fitted to all records, with their scores on held-out records.

    Attributes
    ----------
    records
        The records.
    candidates
        The kinds of laws.
    laws
        Fit of each candidate to all records.
    log_scores
        Held-out log density of each record, shape (laws, records).
    near_scores
        Held-out log scores that are censored to the region near the event, shape (laws, records).
    near
        Whether each record is in this region, shape (records,).
    """

    records: ClusteredRecords
    candidates: Sequence[Candidate]
    laws: Sequence[JointLaw]
    log_scores: Array
    near_scores: Array
    near: NDArray[np.bool_]

    def weights(self, draws: int, generator: np.random.Generator) -> Array:
        """Draw weights of the laws by their scores near the event, shape (draws, laws).

        In each draw the clusters get random weights (Bayesian bootstrap). The weight of a law is proportional
        to the exponential of its weighted sum of held-out scores.

        Parameters
        ----------
        draws
            Number of draws.
        generator
            Source of all randomness.
        """
        scores = self.by_cluster(self.near_scores)
        return bootstrapped_weights(scores, np.ones(scores.shape[1], bool), draws, generator)

    def by_cluster(self, scores: Array) -> Array:
        """Return the sums of scores, shape (laws, records), over each cluster, shape (laws, clusters)."""
        return np.array([np.bincount(self.records.cluster, weights=row) for row in scores])

    def table(self, weights: Array) -> pd.DataFrame:
        """Tabulate the laws with their likelihoods, held-out scores and weights.

        Parameters
        ----------
        weights
            Draws of the weights, shape (draws, laws).

        Returns
        -------
        pandas.DataFrame
            Columns ``law``, ``parameters``, ``log_likelihood``, ``aic``, ``bic``; ``gain`` and ``gain_near``,
            the total held-out log scores minus those of the last law [nats], with the standard errors
            ``gain_error`` and ``gain_near_error``, which are computed from the clusters; and the mean
            ``weight``.
        """
        rows = []
        gains = [self.by_cluster(part - part[-1]) for part in (self.log_scores, self.near_scores)]
        for k, (candidate, law) in enumerate(zip(self.candidates, self.laws, strict=True)):
            likelihood, count = float(law.log_density(self.records.x).sum()), law.n_parameters
            rows.append(
                {
                    "law": candidate.name,
                    "parameters": count,
                    "log_likelihood": likelihood,
                    "aic": 2 * count - 2 * likelihood,
                    "bic": count * float(np.log(len(self.records.x))) - 2 * likelihood,
                    "gain": gains[0][k].sum(),
                    "gain_error": gains[0][k].std() * np.sqrt(self.records.clusters),
                    "gain_near": gains[1][k].sum(),
                    "gain_near_error": gains[1][k].std() * np.sqrt(self.records.clusters),
                    "weight": float(weights[:, k].mean()),
                }
            )
        return pd.DataFrame(rows)


def score_laws(
    records: ClusteredRecords,
    respond: Respond,
    generator: np.random.Generator,
    candidates: Sequence[Candidate] = CANDIDATES,
) -> ScoredLaws:
    """Fit joint laws to all records, and score them by cross-validation over blocks of clusters.

    The region near the event contains the share `NEAR` of the records, those with the smallest scores. Its
    probability under each law is estimated from one pool of simulated points. The pool is drawn from the mean
    of the laws, and reweighted for each law.

    Parameters
    ----------
    records
        The records.
    respond
        Function that simulates the vehicle at points, shape (n, d), and returns whether the event happened,
        shape (n,), and the scores of the outcomes, shape (n,).
    generator
        Source of all randomness.
    candidates
        The kinds of laws. The last one is the reference of the gains in `ScoredLaws.table`.

    Returns
    -------
    ScoredLaws
        The fits, with their held-out log scores over all records and near the event.
    """
    laws = [candidate.fit(records, generator) for candidate in candidates]
    own = respond(records.x)[1]
    limit = np.quantile(own, NEAR)
    pool = np.concatenate([law.sample(POOL // len(laws), generator) for law in laws])
    reached = pool[respond(pool)[1] <= limit]
    log_pool = np.logaddexp.reduce([law.log_density(reached) for law in laws]) + np.log(len(pool) / len(laws))
    block, near = records.blocks(), own <= limit
    log_scores, near_scores = np.empty((2, len(laws), len(records.x)))
    for number in range(block.max() + 1):
        out, rest = block == number, records.only(block != number)
        for k, (candidate, law) in enumerate(zip(candidates, laws, strict=True)):
            held = candidate.fit(rest, generator, start=law)
            log_scores[k, out] = held.log_density(records.x[out])
            inside = np.exp(held.log_density(reached) - log_pool).sum()
            outside = np.log1p(-min(inside, 1 - SMALLEST))
            near_scores[k, out] = np.where(near[out], log_scores[k, out], outside)
    return ScoredLaws(records, candidates, laws, log_scores, near_scores, near)
