"""The laws that the records support: candidates, their weights, and draws from the posterior."""

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from pathlib import Path
from typing import Any, Self

import numpy as np
import pandas as pd
from fewruns.problems import Response

from accelerated_evaluation.answer.candidates.cut_in_family import added_candidates, added_family
from accelerated_evaluation.answer.candidates.family_file import fit_or_read
from accelerated_evaluation.answer.candidates.fitted_records import FittedRecords
from accelerated_evaluation.answer.candidates.joint_family import ClusteredRecords, JointFamily, Respond
from accelerated_evaluation.answer.candidates.law_weights import bootstrapped_weights
from accelerated_evaluation.answer.candidates.smooth_family import SmoothFamily
from accelerated_evaluation.base.arguments import Argument, a_number, one_of
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.randomness import A_GENERATOR, A_SEED, child_generator
from accelerated_evaluation.laws import Law
from accelerated_evaluation.laws.draws import Draws
from accelerated_evaluation.laws.limited import Limit, limited
from accelerated_evaluation.scenarios.protocol import Scenario


def _streams(value: Any) -> Callable[[str], np.random.Generator]:  # noqa: ANN401
    if callable(value) and not isinstance(value, type):
        return value
    return partial(child_generator, A_SEED.take(value), "laws")


STREAMS = Argument(
    "a seed, or a function that returns a generator for the name of a step",
    _streams,
)


Family = SmoothFamily | JointFamily  # fitted candidates with their scores


@dataclass(frozen=True, repr=False)
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
    added
        Fitted candidates that users have added for cut-ins, which follow the others; None if there are none.
    limits
        Limits of the encounters that can happen, under which laws are drawn.

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
    added: Family | None = None
    limits: Sequence[Limit] = ()

    @classmethod
    @checked(
        records=one_of(FittedRecords, words="records", change="Read them with read_records."),
        size=a_number(1, 10**5, whole=True),
        streams=STREAMS,
    )
    def of(
        cls,
        records: FittedRecords,
        size: int,
        streams: Callable[[str], np.random.Generator],
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
        data, others = records.data, None
        if isinstance(data, ClusteredRecords):
            joint = JointFamily.of(data, _responder(records.scenario), streams("fit"))
            return cls.of_family(joint, size, streams("weigh"))
        if candidates := added_candidates():
            lead_speeds = records.table["lead_speed"]
            others = added_family(data, lead_speeds, candidates, closing_speed_max, streams("fit"))
        family = _smooth_family(records, store, closing_speed_max)
        return cls.of_family(family, size, streams("weigh"), others)

    @classmethod
    def of_smooth(
        cls, records: FittedRecords, size: int, streams: Callable[[str], np.random.Generator], store: Path
    ) -> Self:
        """Return the study of the smooth laws of cut-ins alone; the arguments are those of `of`."""
        return cls.of_family(_smooth_family(records, store), size, streams("weigh"))

    @classmethod
    def of_family(
        cls, family: Family, size: int, generator: np.random.Generator, added: Family | None = None
    ) -> Self:
        """Draw the weights of the candidates of a family, and of those that were added, ``size`` times."""
        scores = family.scores if added is None else np.vstack([family.scores, added.scores])
        weights = bootstrapped_weights(scores, family.resampled, size, generator)
        return cls(family, weights, added)

    def with_family(self, family: Family, generator: np.random.Generator) -> Self:
        """Return the study with another family of laws instead, and with new draws of its weights."""
        return replace(self.of_family(family, len(self.weights), generator), limits=self.limits)

    def __repr__(self) -> str:
        """Return the candidates and their mean weights."""
        return self.table().to_string(index=False)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the M candidates."""
        return (*self.family.names, *(() if self.added is None else self.added.names))

    @property
    def smooth(self) -> SmoothFamily:
        """The smooth laws among the candidates for cut-ins; a study of other records has none."""
        if not isinstance(self.family, SmoothFamily):
            raise AttributeError("the records of this study have no smooth laws")
        return self.family

    @property
    def without_added(self) -> Self:
        """The study without the laws that users have added; the other weights are relative to each other."""
        if self.added is None:
            return self
        own = self.only(self.family.names)
        return replace(own, weights=own.weights[:, : len(self.family.names)], added=None)

    @property
    def mean_weights(self) -> Array:
        """Mean weight of each candidate, shape (M,)."""
        return self.weights.mean(axis=0)

    @property
    def heaviest(self) -> str:
        """Name of the law with the largest weight, averaged over the draws of the weights."""
        return self.names[int(self.mean_weights.argmax())]

    def law(self) -> Law:
        """Return the law with the largest weight, for cut-ins without the laws that users have added."""
        return self.family.law(self.without_added.heaviest)

    @checked(generator=A_GENERATOR)
    def draws(self, generator: np.random.Generator) -> Draws:
        """Draw K laws from the posterior: a candidate by its weight in each draw, and then its parameters.

        The uniform numbers that choose the candidates are stratified, one in each of K equal intervals, so
        that the share of each candidate is close to its weight.
        """
        size, ends = len(self.weights), np.cumsum(self.weights, axis=1)
        u = (generator.permutation(size) + generator.random(size)) / size
        chosen = np.minimum((u[:, None] > ends).sum(axis=1), len(self.names) - 1)
        first = len(self.family.names)
        own, others = chosen[chosen < first], chosen[chosen >= first] - first
        pairs = (self.family, own), (self.added, others)
        parts = [family.draws(k, generator) for family, k in pairs if family is not None and k.size]
        return limited(reduce(operator.add, parts), self.limits, generator)

    @checked()
    def only(self, names: Sequence[str]) -> Self:
        """Return the study in which only the named candidates have weight, relative to each other.

        In a draw in which all their weights are 0, they have equal weights.
        """
        self._require(names, "LawStudy.only, argument names")
        kept = np.isin(self.names, names)
        weights = np.where(kept, self.weights, 0.0)
        weights[~weights.any(axis=1)] = kept
        return replace(self, weights=weights / weights.sum(axis=1, keepdims=True))

    @checked()
    def mean(self, values: Mapping[str, Array | float]) -> Array | float:
        """Return the mean of a quantity over the candidates, given by name, with their mean weights."""
        if missing := [name for name in self.names if name not in values]:
            raise InputError(
                "LawStudy.mean, argument values",
                seen=f"no value of {', '.join(missing)}",
                expected=f"a value of each candidate: {', '.join(self.names)}",
                change="Add the values.",
            )
        return sum(weight * values[name] for weight, name in zip(self.mean_weights, self.names, strict=True))

    def _require(self, names: Sequence[str], where: str) -> None:
        """Raise InputError, which names the argument ``where``, unless all names are those of candidates."""
        wrong = [name for name in names if name not in self.names]
        if wrong or not names:
            raise InputError(
                where,
                seen=", ".join(map(repr, wrong)) or "no name",
                expected=f"names of candidates: {', '.join(self.names)}",
                change="Correct the names.",
            )

    def table(self) -> pd.DataFrame:
        """Return the candidates with their mean weights, one row each: ``law`` and ``weight``."""
        return pd.DataFrame({"law": self.names, "weight": self.mean_weights})


def _smooth_family(
    records: FittedRecords, store: Path | None, closing_speed_max: float = math.inf
) -> SmoothFamily:
    """Return the smooth laws of cut-ins, fitted or read from the file ``store``."""
    data = records.distinct
    family = SmoothFamily.of(data) if store is None else fit_or_read(store, data)
    return replace(family, encounters=records.table, closing_speed_max=closing_speed_max)


def _responder(scenario: Scenario) -> Respond:
    """Return a function that simulates the known vehicle at points: flags and scores of the main event."""
    event, vehicle = scenario.events[0], scenario.known_vehicle()

    def respond(x: Array) -> Response:
        outcomes = vehicle.simulate(*x.T)
        return event.happens(outcomes), event.score(outcomes)

    return respond
