"""Draws of a law: K laws that represent the posterior of the law of the records.

An estimate simulates a vehicle once, under a law that covers all draws, and reweights the outcomes for each
draw. A single law is the case K = 1.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, ClassVar, Protocol, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import logsumexp, ndtr, ndtri

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.files import value_digest
from accelerated_evaluation.laws import LAWS
from accelerated_evaluation.laws.joint.truncated_normals import TruncatedNormalMixture
from accelerated_evaluation.laws.protocol import Box, Law

COMPONENTS = 8  # number of components of the mixture that approximates the mean of the draws
POINTS = 8_000  # number of points to which this mixture is fitted


class EventLines(Protocol):
    """Lines of a crash map, with the intervals of one variable in which an event happens."""

    def of_draw(self, k: int) -> Self:
        """Return the lines with the weights of draw k, if the vehicle has any."""

    def masses_by_density(self, law: Law) -> Array:
        """Return the probability of each interval under a law, shape (intervals,)."""


class Draws(ABC):
    """K draws of the law of records, and a proposal under which a vehicle is simulated for all of them.

    Attributes
    ----------
    proposal
        The law under which encounters are drawn.
    names
        Name of the candidate from which each draw was made, of length K.
    laws
        The law of each draw, of length K; of smooth laws, that of the closing speed.

    See Also
    --------
    accelerated_evaluation.answer.LawStudy.draws : draws from the posterior of the laws of records.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> law = ae.choose_draws("independent_variables", ae.read_records("left_turn")).law
    >>> isinstance(ae.as_draws(law), ae.Draws)
    True
    """

    has_draws: ClassVar[bool] = True
    proposal: Law
    names: tuple[str, ...]
    laws: Sequence[Any]

    @property
    def law(self) -> Law:
        """The law that a law file contains: the proposal with the draws."""
        return self

    @property
    def size(self) -> int:
        """Number K of draws."""
        return len(self.names)

    @property
    def member(self) -> NDArray[np.intp]:
        """Number of the candidate of each draw, shape (K,), in alphabetical order of their names."""
        return np.unique(self.names, return_inverse=True)[1]

    @abstractmethod
    def log_densities(self, x: Array) -> Array:
        """Return the log density of each draw at points x, shape (n, d), as an array of shape (K, n)."""

    def log_ratios(self, x: Array) -> Array:
        """Return log f_k / f for each draw f_k and the proposal f at points x, shape (n, d), as (K, n)."""
        return self.log_densities(x) - self.proposal.log_density(x)

    def log_ratios_to_mean(self, x: Array) -> Array:
        """Return log f_k / f_mean for each draw f_k and the mean of all at points x, (n, d), as (K, n)."""
        densities = self.log_densities(x)
        return densities - (logsumexp(densities, axis=0) - math.log(self.size))

    @abstractmethod
    def draw_from_mean(self, n: int, generator: np.random.Generator) -> Array:
        """Draw n points or a few more from the mean of the draws."""

    def masses(self, lines: EventLines) -> Array:
        """Return the probability of each interval of a crash map under each draw, shape (K, intervals)."""
        return np.array([lines.of_draw(k).masses_by_density(law) for k, law in enumerate(self.laws)])

    @property
    def typical(self) -> Any:  # noqa: ANN401
        """The smooth law of a draw of the candidate that has most draws; None if no draw is smooth."""
        return None

    def fixed(self) -> Mapping[str, "Draws"]:
        """Return the draws with a part of their parameters at posterior means, by the name of the part.

        They show how much the part contributes to the uncertainty; there are none by default.
        """
        return {}

    def with_cap_of(self, law: Law) -> "Draws":
        """Return the draws with the cap on the closing speed of another law; most draws have no cap."""
        return self

    @abstractmethod
    def subset(self, chosen: NDArray[np.intp]) -> Self:
        """Return the draws with the given indices, shape (k,), under a proposal that covers these."""

    def thinned(self, size: int) -> Self:
        """Return at most ``size`` of the draws, at equal distances in their order."""
        return self.subset(np.unique(np.linspace(0, self.size - 1, min(size, self.size)).round().astype(int)))


@LAWS.add("draws")
@dataclass(frozen=True, eq=False)
class DrawnLaws(Draws, Law):
    """Draws of laws of any kind; the proposal is a mixture of truncated normals that approximates their mean.

    As a law it is the proposal.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> turns, kind = ae.read_records("left_turn"), ae.LAWS["independent_variables"]
    >>> generator = ae.child_generator(1)
    >>> laws = [kind.fit(turns.x[part::8], turns.data.box, generator) for part in (0, 1)]
    >>> ae.DrawnLaws.of(laws, ("one part", "another part"), generator).size
    2
    """

    laws: Sequence[Law]
    names: tuple[str, ...]
    proposal: Law
    description: str = "draws of laws"

    @classmethod
    def of(cls, laws: Sequence[Law], names: Sequence[str], generator: np.random.Generator) -> Self:
        """Fit the proposal to points of all laws; all must have the same finite box."""
        x = _from_each(laws, POINTS, generator)
        proposal = TruncatedNormalMixture.fit(x, laws[0].box, generator, components=COMPONENTS)
        return cls(laws, tuple(names), proposal)

    @property
    def box(self) -> Box:
        """The variables and their limits."""
        return self.proposal.box

    @property
    def digest(self) -> str:
        """The digest of the draws and of their proposal, which has the lead speeds of all."""
        return value_digest([super().digest, self.proposal.digest])

    def from_normal_scores(self, z: Array) -> Array:
        """Map normal scores to points of the proposal, both of shape (n, d)."""
        return self.proposal.from_normal_scores(z)

    def log_density(self, x: Array) -> Array:
        """Return the log density of the proposal at points x, shape (n, d)."""
        return self.proposal.log_density(x)

    def log_densities(self, x: Array) -> Array:
        """Return the log density of each draw at points x, shape (n, d), as an array of shape (K, n)."""
        return np.array([law.log_density(x) for law in self.laws])

    def draw_from_mean(self, n: int, generator: np.random.Generator) -> Array:
        """Draw the same number of points from each draw, n or a few more together."""
        return _from_each(self.laws, n, generator)

    def subset(self, chosen: NDArray[np.intp]) -> Self:
        """Return the draws with the given indices, shape (k,), under the same proposal."""
        laws, names = ([part[k] for k in chosen] for part in (self.laws, self.names))
        return replace(self, laws=laws, names=tuple(names))

    def content(self) -> dict[str, Any]:
        """Return the content of the law file: the proposal and all draws."""
        draws = [{"name": name} | _content(law) for name, law in zip(self.names, self.laws, strict=True)]
        return {"proposal": _content(self.proposal), "draws": draws}

    @classmethod
    def from_content(cls, content: Mapping[str, Any], box: Box, records: pd.DataFrame | None) -> Self:
        """Build the draws from the content of their file, their limits, and the records."""
        laws = [_law(part, records) for part in content["draws"]]
        names = tuple(str(part["name"]) for part in content["draws"])
        return cls(laws, names, _law(content["proposal"], records), content["description"])


@LAWS.add("mixed_draws")
@dataclass(frozen=True, eq=False)
class MixedDraws(Draws, Law):
    """Draws that come in parts, each with a proposal of its own; the proposal is the mixture of these.

    The first normal score chooses the part: the parts occupy adjacent intervals of it.
    """

    needs_records: ClassVar[bool] = True
    parts: Sequence[Draws]
    description: str = "draws of laws of several kinds"

    @property
    def proposal(self) -> Self:
        """The mixture itself."""
        return self

    @property
    def box(self) -> Box:
        """The smallest box that contains those of the parts."""
        boxes = [part.proposal.box for part in self.parts]
        lower = np.min([box.lower for box in boxes], axis=0)
        return Box(boxes[0].names, tuple(lower), tuple(np.max([box.upper for box in boxes], axis=0)))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the candidates of the draws, in the order of the parts."""
        return tuple(name for part in self.parts for name in part.names)

    @property
    def laws(self) -> Sequence[Any]:
        """The law of each draw, in the order of the parts."""
        return [law for part in self.parts for law in part.laws]

    @property
    def typical(self) -> Any:  # noqa: ANN401
        """That of the first part that has one."""
        return next((law for part in self.parts if (law := part.typical) is not None), None)

    @property
    def digest(self) -> str:
        """The digest of all parts."""
        return value_digest([part.digest for part in self.parts])

    @property
    def _shares(self) -> Array:
        sizes = np.array([part.size for part in self.parts], dtype=float)
        return sizes / sizes.sum()

    def from_normal_scores(self, z: Array) -> Array:
        """Map normal scores to points of the mixture, both of shape (n, d)."""
        u, x, share = ndtr(z[:, 0]), np.empty(z.shape), self._shares
        before = np.cumsum(share) - share
        chosen = np.searchsorted(before, u, side="right") - 1
        for k, part in enumerate(self.parts):
            own = z[chosen == k].copy()
            own[:, 0] = ndtri((u[chosen == k] - before[k]) / share[k])
            x[chosen == k] = part.proposal.from_normal_scores(own)
        return x

    def log_density(self, x: Array) -> Array:
        """Return the log density of the mixture at points x, shape (n, d)."""
        parts = [part.proposal.log_density(x) for part in self.parts]
        return logsumexp(np.log(self._shares)[:, None] + parts, axis=0)

    def log_densities(self, x: Array) -> Array:
        """Return the log density of each draw at points x, shape (n, d), as an array of shape (K, n)."""
        return np.vstack([part.log_densities(x) for part in self.parts])

    def masses(self, lines: EventLines) -> Array:
        """Return the probability of each interval of a crash map under each draw, shape (K, intervals)."""
        return np.vstack([part.masses(lines) for part in self.parts])

    def draw_from_mean(self, n: int, generator: np.random.Generator) -> Array:
        """Draw from the mean of each part in proportion to its size, n points or a few more together."""
        return np.concatenate(
            [part.draw_from_mean(-(-n * part.size // self.size), generator) for part in self.parts]
        )

    def fixed(self) -> Mapping[str, Draws]:
        """Return the draws with a part of their parameters at posterior means, by the name of the part."""
        pairs = [(part.fixed(), part) for part in self.parts]
        names = dict.fromkeys(name for own, _ in pairs for name in own)
        return {name: replace(self, parts=[own.get(name, part) for own, part in pairs]) for name in names}

    def subset(self, chosen: NDArray[np.intp]) -> Self:
        """Return the draws with the given indices, shape (k,), in the order of the parts."""
        ends = np.cumsum([0, *(part.size for part in self.parts)])
        own = [chosen[(chosen >= low) & (chosen < high)] - low for low, high in pairwise(ends)]
        return replace(self, parts=[p.subset(k) for p, k in zip(self.parts, own, strict=True) if k.size])

    def content(self) -> dict[str, Any]:
        """Return the content of the law file: that of all parts."""
        return {"parts": [_content(part) for part in self.parts]}

    @classmethod
    def from_content(cls, content: Mapping[str, Any], box: Box, records: pd.DataFrame | None) -> Self:
        """Build the draws from the content of their file, their limits, and the records."""
        return cls([_law(part, records) for part in content["parts"]], content["description"])


@dataclass(frozen=True)
class OneLaw(Draws):
    """A single law as K = 1 draws.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> turns = ae.read_records("left_turn")
    >>> law = ae.LAWS["independent_variables"].fit(turns.x, turns.data.box, ae.child_generator(1))
    >>> ae.OneLaw(law).size
    1
    """

    proposal: Law

    @property
    def law(self) -> Law:
        """The law itself."""
        return self.proposal

    @property
    def names(self) -> tuple[str]:
        """The description of the law."""
        return (self.proposal.description,)

    @property
    def laws(self) -> Sequence[Law]:
        """The law itself."""
        return (self.proposal,)

    def log_densities(self, x: Array) -> Array:
        """Return the log density of the law at points x, shape (n, d), as an array of shape (1, n)."""
        return self.proposal.log_density(x)[None]

    def log_ratios(self, x: Array) -> Array:
        """Return zeros, shape (1, n), because the law is its own proposal."""
        return np.zeros((1, len(x)))

    def draw_from_mean(self, n: int, generator: np.random.Generator) -> Array:
        """Draw n points from the law."""
        return self.proposal.draw(n, generator)

    def subset(self, chosen: NDArray[np.intp]) -> Self:
        """Return the law itself."""
        return self


def as_draws(law: Law) -> Draws:
    """Return a law with draws as it is, and any other law as K = 1 draws.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> turns = ae.read_records("left_turn")
    >>> law = ae.LAWS["independent_variables"].fit(turns.x, turns.data.box, ae.child_generator(1))
    >>> ae.as_draws(law).size
    1
    """
    return law if law.has_draws else OneLaw(law)


def _from_each(laws: Sequence[Law], n: int, generator: np.random.Generator) -> Array:
    """Draw the same number of points from each law, n or a few more together."""
    share = -(-n // len(laws))
    return np.concatenate([law.draw(share, generator) for law in laws])


def _content(law: Law) -> dict[str, Any]:
    header = {"kind": law.kind, "description": law.description, "variables": law.box.content()}
    return header | law.content()


def _law(content: Mapping[str, Any], records: pd.DataFrame | None) -> Law:
    box = Box.from_content(content["variables"])
    return LAWS[content["kind"]].from_content(content, box, records)
