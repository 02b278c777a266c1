"""Joint laws as candidates: fitted to records, and scored on held-out records near the event.

The records come in clusters, such as those of one driver. A block that is held out consists of whole
clusters, because the records of a driver resemble each other.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd
from fewruns.problems import Response
from numpy.typing import ArrayLike, NDArray
from tqdm import tqdm

from accelerated_evaluation.answer.candidates.scores import BLOCKS
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws import LAWS, Box
from accelerated_evaluation.laws.distributions import Empirical
from accelerated_evaluation.laws.draws import DrawnLaws
from accelerated_evaluation.laws.joint import JointLaw
from accelerated_evaluation.laws.lead_speeds import with_lead_speeds

NEAR = 0.1  # share of the records that are near the event: those with the smallest scores
POOL = 20_000  # number of points with which the probability of the region near the event is estimated
SMALLEST = 1e-9  # smallest probability outside of the region, so that its logarithm is finite
BASELINE = "independent"  # name of the candidate with which the table compares the others

Respond = Callable[[Array], Response]
"""Simulates the vehicle at points, shape (n, d), and returns whether the event happened, and the scores."""


@dataclass(frozen=True)
class Candidate:
    """A kind of joint law with settings, which can be fitted to records."""

    name: str
    kind: type[JointLaw]
    settings: Mapping[str, Any]

    def fit(self, records: "ClusteredRecords", generator: np.random.Generator, **known: Any) -> JointLaw:  # noqa: ANN401
        """Fit the law; ``known`` are weights of the records, or a start, as for `JointLaw.fit`."""
        return self.kind.fit(records.x, records.box, generator, **known, **self.settings)


def candidates() -> tuple[Candidate, ...]:
    """Return all candidates of all kinds of joint laws, also of those that users have added."""
    kinds = [kind for kind in LAWS.values() if issubclass(kind, JointLaw)]
    return tuple(
        Candidate(name, kind, settings) for kind in kinds for name, settings in kind.candidates.items()
    )


@dataclass(frozen=True)
class ClusteredRecords:
    """The records of a scenario, with clusters of records that may depend on each other."""

    x: Array  # the records, shape (n, d)
    cluster: NDArray[np.int_]  # number of the cluster of each record, shape (n,)
    box: Box

    @classmethod
    def of(cls, x: Array, cluster: ArrayLike, box: Box, where: str = "the records") -> "ClusteredRecords":
        """Return records x, shape (n, d), with names of clusters, shape (n,), after checks.

        Records outside the box, and fewer than two clusters, are an InputError that names ``where``.
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

    def blocks(self, blocks: int = BLOCKS) -> NDArray[np.int_]:
        """Divide the records into blocks of complete clusters, and return the number of each record's block.

        The clusters are assigned in the order of falling size, each to the block that is smallest so far, so
        that the blocks have about the same size. There are at most as many blocks as clusters.
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


def without_each_block(
    records: ClusteredRecords,
    block: NDArray[np.int_],
    candidates: Sequence[Candidate],
    laws: Sequence[JointLaw],
    generator: np.random.Generator,
) -> Iterator[tuple[int, NDArray[np.bool_], JointLaw]]:
    """Yield the index of a candidate, the flags of a block of records, and the fit without this block.

    ``block`` has the number of each record's block, shape (n,), and ``laws`` are the fits to all records.
    """
    for number in range(block.max() + 1):
        out, rest = block == number, records.only(block != number)
        for k, (candidate, law) in enumerate(zip(candidates, laws, strict=True)):
            yield k, out, candidate.fit(rest, generator, start=law)


@dataclass(frozen=True)
class JointFamily:
    """The fitted candidates, with their log scores on held-out records."""

    records: ClusteredRecords
    candidates: Sequence[Candidate]
    laws: Sequence[JointLaw]  # each candidate fitted to all records
    log_scores: Array  # held-out log density of each candidate at each record, shape (M, n)
    near_scores: Array  # the same for records near the event; elsewhere the log probability of not being near
    # Recorded lead speeds, which complete laws of range and closing speed to laws of cut-ins.
    lead_speeds: Empirical | None = None

    @classmethod
    def of(
        cls,
        records: ClusteredRecords,
        respond: Respond,
        generator: np.random.Generator,
        own: Sequence[Candidate] | None = None,
    ) -> Self:
        """Fit candidates, by default all, and score them on held-out blocks of records.

        The region near the event contains the share `NEAR` of the records, those with the smallest scores of
        the vehicle that ``respond`` simulates. A record in the region is scored by its log density. A record
        outside is scored by the log probability of the outside, so that only the region matters.
        """
        chosen = candidates() if own is None else tuple(own)
        laws = [candidate.fit(records, generator) for candidate in chosen]
        score = respond(records.x)[1]
        limit = np.quantile(score, NEAR)
        pool = np.concatenate([law.draw(POOL // len(laws), generator) for law in laws])
        reached = pool[respond(pool)[1] <= limit]
        log_pool = np.logaddexp.reduce([law.log_density(reached) for law in laws])
        log_pool += np.log(len(pool) / len(laws))
        block, near = records.blocks(), score <= limit
        log_scores, near_scores = np.empty((2, len(laws), len(records.x)))
        for k, out, held in without_each_block(records, block, chosen, laws, generator):
            log_scores[k, out] = held.log_density(records.x[out])
            inside = np.exp(held.log_density(reached) - log_pool).sum()
            outside = np.log1p(-min(inside, 1 - SMALLEST))
            near_scores[k, out] = np.where(near[out], log_scores[k, out], outside)
        return cls(records, chosen, laws, log_scores, near_scores)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the M candidates."""
        return tuple(candidate.name for candidate in self.candidates)

    @property
    def scores(self) -> Array:
        """Held-out log score of each candidate near the event, summed over each cluster, (M, clusters)."""
        return self._by_cluster(self.near_scores)

    @property
    def resampled(self) -> NDArray[np.bool_]:
        """Flags of the clusters that the bootstrap resamples: all."""
        return np.ones(self.records.clusters, bool)

    def draws(self, chosen: NDArray[np.intp], generator: np.random.Generator) -> DrawnLaws:
        """Return K random laws: the chosen candidates, each fitted to a bootstrap sample of its own.

        ``chosen`` contains the indices of the candidates, shape (K,). Clusters of records are resampled.
        """
        laws = []
        for k in tqdm(chosen, desc="draws of the law", disable=None):
            known = {"weights": self.records.resampled(generator), "start": self.laws[k]}
            laws.append(self.candidates[k].fit(self.records, generator, **known))
        drawn = DrawnLaws.of(laws, [self.names[k] for k in chosen], generator)
        return drawn if self.lead_speeds is None else with_lead_speeds(drawn, self.lead_speeds)

    def law(self, name: str) -> JointLaw:
        """Return the law of one candidate, fitted to all records."""
        return self.laws[self.names.index(name)]

    def table(self, weights: Array) -> pd.DataFrame:
        """Return one row for each candidate: its fit to all records, its scores, and its mean weight.

        ``weights`` are draws of the weights, shape (K, M). The gains are held-out log scores, of all records
        and of the region near the event, minus those of independent variables, with their standard errors.
        """
        base, clusters = self.names.index(BASELINE), self.records.clusters
        rows = []
        for k, (name, law) in enumerate(zip(self.names, self.laws, strict=True)):
            likelihood, count = float(law.log_density(self.records.x).sum()), law.n_parameters
            row = {
                "law": name,
                "parameters": count,
                "log_likelihood": likelihood,
                "aic": 2 * count - 2 * likelihood,
                "bic": count * float(np.log(len(self.records.x))) - 2 * likelihood,
            }
            for column, scores in (("gain", self.log_scores), ("gain_near", self.near_scores)):
                gains = self._by_cluster(scores[[k]] - scores[base])[0]
                row |= {column: gains.sum(), f"{column}_error": gains.std() * np.sqrt(clusters)}
            rows.append(row | {"weight": float(weights[:, k].mean())})
        return pd.DataFrame(rows)

    def _by_cluster(self, scores: Array) -> Array:
        return np.array([np.bincount(self.records.cluster, weights=row) for row in scores])
