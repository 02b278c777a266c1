"""The laws that the records support: candidates, their weights, and draws from the posterior."""

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np
import pandas as pd
from fewruns.problems import Response
from numpy.typing import NDArray

from accelerated_evaluation.answer.fitted_records import FittedRecords
from accelerated_evaluation.answer.joint_family import (
    Candidate,
    ClusteredRecords,
    JointFamily,
    Respond,
    candidates,
)
from accelerated_evaluation.answer.scores import BLOCKS, bootstrapped_weights, contiguous_blocks
from accelerated_evaluation.answer.smooth_family import SmoothFamily, fit_or_read, region
from accelerated_evaluation.base.arguments import A_GENERATOR, Argument, a_number, checked, one_of
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws import Law, joint
from accelerated_evaluation.laws.distributions import Empirical
from accelerated_evaluation.laws.draws import DrawnLaws, Draws, MixedDraws
from accelerated_evaluation.laws.joint import JointLaw
from accelerated_evaluation.laws.lead_speeds import WithLeadSpeeds
from accelerated_evaluation.laws.protocol import Box
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.loading import load_vehicle
from accelerated_evaluation.vehicles.protocol import Vehicle


def _streams(value: Any) -> Callable[[str], np.random.Generator]:  # noqa: ANN401
    return value if callable(value) else partial(child_generator, operator.index(value), "laws")


STREAMS = Argument("a seed, or a function that returns a generator for the name of a step", _streams)


class Family(Protocol):
    """Candidate laws that are fitted to the same records, with scores on held-out records."""

    names: tuple[str, ...]  # of the M candidates
    scores: Array  # log score of each candidate on each unit (a record, or a cluster of records), (M, units)
    resampled: NDArray[np.bool_]  # the units that the Bayesian bootstrap resamples, shape (units,)

    @property
    def built_in(self) -> "Family":
        """The candidates that come with the library, without those that users have added."""

    def law(self, name: str) -> Law:
        """Return the law of one built-in candidate, fitted to all records."""

    def draws(self, chosen: NDArray[np.intp], generator: np.random.Generator) -> Draws:
        """Draw the chosen candidates, shape (K,), each with parameters from their posterior."""


@dataclass(frozen=True)
class LawStudy:
    """The candidate laws of the records of a scenario, with draws of their weights.

    The weight of a candidate is the softmax of its log score on held-out records. Its uncertainty is that of
    the records: the Bayesian bootstrap (Rubin 1981) resamples the scores, so that every draw has weights of
    its own. This is pseudo-Bayesian model averaging with the bootstrap of Yao and others (2018).

    Parameters
    ----------
    family
        The fitted candidates with their scores.
    weights
        K draws of the weights of the M candidates, shape (K, M), with rows that sum to 1.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> turns = ae.read_records("left_turn")
    >>> some = ae.FittedRecords.of(turns.scenario, turns.table[::16])  # fewer records, as fits take time
    >>> study = ae.LawStudy.of(some, 5, 1)
    >>> study.draws(2).size
    5
    """

    family: Family
    weights: Array

    @classmethod
    @checked(
        records=one_of(FittedRecords, words="records", change="Read them with read_records."),
        size=a_number(1, whole=True),
        streams=STREAMS,
    )
    def of(
        cls,
        records: FittedRecords,
        size: int,
        streams: Callable[[str], np.random.Generator] | int,
        store: Path | None = None,
        closing_speed_max: float = math.inf,
    ) -> Self:
        """Fit and score the candidate laws of records, and draw their weights ``size`` times.

        Parameters
        ----------
        records
            Records of any scenario. Smooth laws with dependence are the candidates for cut-ins, and joint
            laws for other records. Joint laws that users have added are candidates for cut-ins, too.
        size
            Number K of draws.
        streams
            Seed of the study, or a function that returns a random generator for the name of a step.
        store
            File with the fit of smooth laws, which is read if it belongs to the records, and otherwise
            written.
        closing_speed_max
            Cap on the closing speed of laws of cut-ins [m/s].
        """
        if records.support is None:
            vehicle = load_vehicle(records.scenario.default_vehicle, records.scenario)
            family = JointFamily.of(records.data, _responder(records.scenario, vehicle), streams("fit"))
            return cls.of_family(family, size, streams("weigh"))
        family = SmoothFamily.of(records.data) if store is None else fit_or_read(store, records.data)
        family = replace(family, encounters=records.table, closing_speed_max=closing_speed_max)
        if added := added_candidates():
            others = AddedLaws.of(records.data, added, closing_speed_max, streams("fit"))
            family = Together(family, others)
        return cls.of_family(family, size, streams("weigh"))

    @classmethod
    def of_family(cls, family: Family, size: int, generator: np.random.Generator) -> Self:
        """Draw the weights of the candidates of a family ``size`` times."""
        return cls(family, bootstrapped_weights(family.scores, family.resampled, size, generator))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the M candidates."""
        return self.family.names

    @property
    def smooth(self) -> SmoothFamily:
        """The smooth laws among the candidates; a study of other records than cut-ins has none."""
        return self.family.built_in

    @property
    def mean_weights(self) -> Array:
        """Mean weight of each candidate, shape (M,)."""
        return self.weights.mean(axis=0)

    @property
    def heaviest(self) -> str:
        """Name of the law with the largest weight, averaged over the draws of the weights."""
        return self.names[int(self.mean_weights.argmax())]

    def smooth_only(self) -> Self:
        """Return the study of cut-ins without the laws that users have added."""
        names = self.smooth.names
        return replace(self, family=self.smooth, weights=self.only(names).weights[:, : len(names)])

    def law(self) -> Law:
        """Return the law with the largest weight, for cut-ins without the laws that users have added."""
        study = self.smooth_only()
        return study.family.law(study.heaviest)

    @checked(generator=A_GENERATOR)
    def draws(self, generator: np.random.Generator | int) -> Draws:
        """Draw K laws from the posterior: a candidate by its weight in each draw, and then its parameters.

        The uniform numbers that choose the candidates are stratified, one in each of K equal intervals, so
        that the share of each candidate is close to its weight.
        """
        size, ends = len(self.weights), np.cumsum(self.weights, axis=1)
        u = (generator.permutation(size) + generator.random(size)) / size
        chosen = np.minimum((u[:, None] > ends).sum(axis=1), len(self.names) - 1)
        return self.family.draws(chosen, generator)

    def only(self, names: Sequence[str]) -> Self:
        """Return the study in which only the named candidates have weight, relative to each other.

        In a draw in which all their weights are 0, they have equal weights.
        """
        kept = np.isin(self.names, names)
        weights = np.where(kept, self.weights, 0.0)
        weights[~weights.any(axis=1)] = kept
        return replace(self, weights=weights / weights.sum(axis=1, keepdims=True))

    def mean(self, values: Mapping[str, Array | float]) -> Array | float:
        """Return the mean of a quantity over the candidates, given by name, with their mean weights."""
        return sum(weight * values[name] for weight, name in zip(self.mean_weights, self.names, strict=True))

    def table(self) -> pd.DataFrame:
        """Return the candidates with their mean weights, one row each: ``law`` and ``weight``."""
        return pd.DataFrame({"law": self.names, "weight": self.mean_weights})


def _responder(scenario: Scenario, vehicle: Vehicle) -> Respond:
    """Return a function that simulates a vehicle at points; it gives flags and scores of the main event."""
    event = scenario.events[0]

    def respond(x: Array) -> Response:
        outcomes = vehicle.simulate(*scenario.to_inputs(x).T)
        return event.happens(outcomes), event.score(outcomes)

    return respond


NODES, NODE_WEIGHTS = np.polynomial.legendre.leggauss(32)
AT_ONCE = 100_000  # number of records at once, which limits the memory to about 200 MB


def added_candidates() -> tuple[Candidate, ...]:
    """Return the candidates of joint laws that do not come with the library."""
    return tuple(each for each in candidates() if not each.kind.__module__.startswith(joint.__name__))


@dataclass(frozen=True)
class AddedLaws:
    """Joint laws of range and closing speed that are fitted to cut-ins, with scores on held-out records."""

    records: DistinctRecords
    candidates: Sequence[Candidate]
    laws: Sequence[JointLaw]  # each candidate fitted to all records
    scores: Array  # held-out log score of each candidate on each record, shape (M, n)

    @classmethod
    def of(
        cls,
        records: DistinctRecords,
        candidates: Sequence[Candidate],
        closing_speed_max: float,
        generator: np.random.Generator,
        blocks: int = BLOCKS,
    ) -> Self:
        """Fit candidates to ranges and to closing speeds up to a limit [m/s], and score them on blocks."""
        x = np.column_stack([records.range_, np.minimum(records.closing_speed, closing_speed_max)])
        box = Box(("range", "closing_speed"), (0.0, 0.0), (records.support.range_max, closing_speed_max))
        whole, block = _clustered(x, box), contiguous_blocks(len(x), blocks)
        laws = [candidate.fit(whole, generator) for candidate in candidates]
        boundary, scores = region(records) * records.range_, np.empty((len(candidates), len(x)))
        for number in range(blocks):
            out = block == number
            rest = _clustered(x[~out], box)
            for k, (candidate, law) in enumerate(zip(candidates, laws, strict=True)):
                held = candidate.fit(rest, generator, start=law)
                scores[k, out] = conditional_scores(held, x[out], boundary[out])
        return cls(records, candidates, laws, scores)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the M candidates."""
        return tuple(candidate.name for candidate in self.candidates)

    def draws(self, chosen: NDArray[np.intp], generator: np.random.Generator) -> DrawnLaws:
        """Fit the chosen candidates, shape (K,), each to another bootstrap sample of the records."""
        x = np.column_stack([self.records.range_, self.records.closing_speed])
        records = _clustered(np.minimum(x, self.laws[0].box.upper), self.laws[0].box)
        lead_speeds, laws = Empirical(self.records.lead_speed), []
        for k in chosen:
            weights = generator.standard_exponential(len(x))
            own = self.candidates[k].fit(records, generator, weights=weights, start=self.laws[k])
            laws.append(WithLeadSpeeds(own, lead_speeds))
        names = tuple(self.names[k] for k in chosen)
        drawn = DrawnLaws.of([law.law for law in laws], names, generator)
        return DrawnLaws(laws, names, WithLeadSpeeds(drawn.proposal, lead_speeds))


def _clustered(x: Array, box: Box) -> ClusteredRecords:
    """Return records of cut-ins, shape (n, 2), as independent records."""
    return ClusteredRecords(x, np.arange(len(x)), box)


def conditional_scores(law: JointLaw, x: Array, boundary: Array) -> Array:
    """Return the censored log scores of closing speeds given the range under a joint law, shape (n,).

    A cut-in x, a row of range [m] and closing speed [m/s], is scored by its conditional log density if its
    closing speed exceeds the boundary [m/s], and by the log probability of not exceeding it otherwise.
    """
    parts = np.array_split(np.arange(len(x)), -(-len(x) // AT_ONCE))
    return np.concatenate([_conditional_scores(law, x[part], boundary[part]) for part in parts])


def _conditional_scores(law: JointLaw, x: Array, boundary: Array) -> Array:
    top = law.box.upper[1]
    limit = np.minimum(boundary, top)
    below = _integral(law, x[:, 0], np.zeros(len(x)), limit)
    above = _integral(law, x[:, 0], limit, np.full(len(x), top))
    with np.errstate(divide="ignore", invalid="ignore"):
        density = law.log_density(x) - np.log(below + above)
        return np.where(x[:, 1] > boundary, density, np.log(below) - np.log(below + above))


def _integral(law: JointLaw, range_: Array, low: Array, high: Array) -> Array:
    """Return the integral of a density over the closing speed from low to high [m/s], all of shape (n,)."""
    speeds = (low + high)[:, None] / 2 + (high - low)[:, None] / 2 * NODES
    points = np.column_stack([np.repeat(range_, NODES.size), speeds.ravel()])
    return (high - low) / 2 * (np.exp(law.log_density(points)).reshape(speeds.shape) @ NODE_WEIGHTS)


@dataclass(frozen=True)
class Together:
    """The smooth laws and added laws as one family of candidates."""

    smooth: SmoothFamily
    added: AddedLaws

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all candidates, the smooth laws first."""
        return (*self.smooth.names, *self.added.names)

    @property
    def built_in(self) -> SmoothFamily:
        """The smooth laws."""
        return self.smooth

    def law(self, name: str) -> Law:
        """Return a smooth law, fitted to all records."""
        return self.smooth.law(name)

    @property
    def scores(self) -> Array:
        """Held-out log score of each candidate on each record, shape (M, n)."""
        return np.vstack([self.smooth.scores, self.added.scores])

    @property
    def resampled(self) -> NDArray[np.bool_]:
        """Flags of the records that the bootstrap resamples."""
        return self.smooth.resampled

    def draws(self, chosen: NDArray[np.intp], generator: np.random.Generator) -> Draws:
        """Draw the chosen candidates, shape (K,), each with parameters from their posterior."""
        first, parts = len(self.smooth.names), []
        if (own := chosen[chosen < first]).size:
            parts.append(self.smooth.draws(own, generator))
        if (others := chosen[chosen >= first] - first).size:
            parts.append(self.added.draws(others, generator))
        return parts[0] if len(parts) == 1 else MixedDraws(parts)
