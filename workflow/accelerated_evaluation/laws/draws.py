"""Draws of a law: K laws that represent the posterior of the law of the records.

An estimate simulates a vehicle once, under a law that covers all draws, and reweights the outcomes for each
draw. A single law is the case K = 1.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import logsumexp

from accelerated_evaluation.base.arguments import a_number
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import value_digest
from accelerated_evaluation.base.randomness import A_GENERATOR, DRAWING
from accelerated_evaluation.laws import LAWS, nested_content, nested_law
from accelerated_evaluation.laws.joint.truncated_normals import TruncatedNormalMixture
from accelerated_evaluation.laws.mixed import MixedLaws
from accelerated_evaluation.laws.protocol import Box, Law, log_slice_of
from accelerated_evaluation.laws.smooth.support import Support

COMPONENTS = 8  # number of components of the mixture that approximates the mean of the draws
POINTS = 8_000  # number of points to which this mixture is fitted


class EventLines(Protocol):
    """Lines of a crash map, with the intervals of one variable in which an event happens."""

    def below(self, largest: Callable[[int, Array], Array]) -> Self:
        """Return the lines with intervals that end at the largest values of the variable at the latest."""


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

    if TYPE_CHECKING:  # a field or a property of each class of draws

        @property
        def proposal(self) -> Law:
            """The law under which encounters are drawn."""

        @property
        def names(self) -> tuple[str, ...]:
            """Name of the candidate from which each draw was made, of length K."""

        @property
        def laws(self) -> Sequence[Any]:
            """The law of each draw, of length K; of smooth laws, that of the closing speed."""

    @property
    @abstractmethod
    def law(self) -> Law:
        """The law that a law file contains: the proposal with the draws."""

    @property
    def size(self) -> int:
        """Number K of draws."""
        return len(self.names)

    @property
    def member(self) -> NDArray[np.intp]:
        """Number of the candidate of each draw, shape (K,), in alphabetical order of their names."""
        return np.unique(self.names, return_inverse=True)[1]

    def __repr__(self) -> str:
        """Return the number of draws and the names of their candidates."""
        return f"{self.size:,} draw{'s' * (self.size > 1)} of {', '.join(sorted(set(self.names)))}"

    @abstractmethod
    def log_densities(self, x: Array) -> Array:
        """Return the log density of each draw at points x, shape (n, d), as an array of shape (K, n)."""

    def log_slices(self, k: int, x: Array, low: Array, high: Array) -> Array:
        """Return the log of the integral of the density of each draw over variable k, shape (K, n).

        The arguments are those of `SlicedLaw.log_slice`. The density of other laws is integrated numerically.
        """
        return np.array([log_slice_of(law, k, x, low, high) for law in self.laws])

    @property
    def sliced(self) -> Sequence[Any]:
        """The laws that must be a `SlicedLaw` for `log_slices` and for slices of the proposal."""
        return (*self.laws, self.proposal)

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

    @property
    def unlimited(self) -> "Draws":
        """The draws without limits of the encounters that can happen; most draws have none."""
        return self

    def holds(self, x: Array) -> NDArray[np.bool_]:
        """Return whether each of n encounters, shape (n, d), can happen, shape (n,)."""
        return np.ones(len(x), dtype=bool)

    def within(self, lines: EventLines) -> EventLines:
        """Return the lines of a crash map without the encounters that cannot happen."""
        return lines

    @property
    def support(self) -> Support:
        """The limits of the places of a crash map, of which smooth laws need more than the largest range."""
        return Support(range_max=self.proposal.box.upper[1])

    @property
    def typical(self) -> Any:  # noqa: ANN401
        """The smooth law of a draw of the candidate that has most draws; None if no draw is smooth."""
        return None

    def fixed(self) -> Mapping[str, "Draws"]:
        """Return the draws with a part of their parameters at posterior means, by the name of the part.

        They show how much the part contributes to the uncertainty; there are none by default.
        """
        return {}

    @abstractmethod
    def with_cap_at(self, closing_speed_max: float) -> Self:
        """Return the draws with another cap on the closing speed [m/s], if they can have one."""

    @checked()
    def __add__(self, other: "Draws | Law") -> "DrawnLaws":
        """Return these draws followed by others, or by a law, under the mixture of both proposals.

        The proposals are weighted by the numbers of draws. InputError is raised if the other draws have other
        variables.
        """
        added = as_draws(other)
        if added.proposal.box.names != self.proposal.box.names:
            raise InputError(
                "the sum of two sets of draws",
                seen=" and ".join(", ".join(each.proposal.box.names) for each in (self, added)),
                expected="laws of the same variables",
                change="Add draws for records of one scenario.",
            )
        return DrawnLaws([self, added], description="draws of laws of several kinds")

    def content_as_part(self) -> dict[str, Any]:
        """Return the content of the draws as a part of others."""
        return nested_content(self.law)

    @abstractmethod
    def subset(self, chosen: NDArray[np.intp]) -> "Draws":
        """Return the draws with the given indices, shape (k,), under a proposal that covers these.

        They are in the order of the indices, which may be repeated.
        """

    @checked(size=a_number(1, whole=True))
    def thinned(self, size: int) -> "Draws":
        """Return at most ``size`` of the draws, at equal distances in their order."""
        return self.subset(np.unique(np.linspace(0, self.size - 1, min(size, self.size)).round().astype(int)))


@checked()
@dataclass(frozen=True, repr=False)
class OneLaw(Draws):
    """A single law as K = 1 draws.

    Parameters
    ----------
    proposal
        The law.
    name
        Name of the candidate that was fitted; by default the description of the law.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> law = ae.choose_draws("independent_variables", ae.read_records("left_turn")).law
    >>> ae.OneLaw(law).size
    1
    """

    proposal: Law
    name: str = ""

    @property
    def law(self) -> Law:
        """The law itself."""
        return self.proposal

    @property
    def names(self) -> tuple[str, ...]:
        """The name of the candidate, or the description of the law."""
        return (self.name or self.proposal.description,)

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

    @checked(**DRAWING)
    def draw_from_mean(self, n: int, generator: np.random.Generator) -> Array:
        """Draw n points from the law."""
        return self.proposal.draw(n, generator)

    def with_cap_at(self, closing_speed_max: float) -> Self:
        """Return the law with another cap on the closing speed [m/s], if it can have one."""
        return replace(self, proposal=self.proposal.with_cap_at(closing_speed_max))

    def subset(self, chosen: NDArray[np.intp]) -> Draws:
        """Return the law itself, or repeated if there are several indices."""
        return self if chosen.size == 1 else DrawnLaws([self] * chosen.size, self.proposal)

    def content_as_part(self) -> dict[str, Any]:
        """Return the content of the law with its name."""
        return {"name": self.name} | nested_content(self.proposal)


@LAWS.add("draws")
@checked()
@dataclass(frozen=True, eq=False, repr=False)
class DrawnLaws(Draws, Law):
    """Draws that follow each other: laws of any kind, or sets of draws, under one proposal.

    As a law it is the proposal.

    Parameters
    ----------
    parts
        The draws, one after the other.
    own
        The proposal; by default the mixture of the proposals of the parts, by their numbers of draws.
    description
        What the draws are, in one line.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> turns, kind = ae.read_records("left_turn"), ae.LAWS["independent_variables"]
    >>> generator = ae.child_generator(1)
    >>> laws = [kind.fit(turns.x[part::8], turns.data.box, generator) for part in (0, 1)]
    >>> two = ae.DrawnLaws.of(laws, ("one part", "another part"), generator)
    >>> (two + ae.OneLaw(laws[0])).size
    3
    """

    parts: Sequence[Draws]
    own: Law | None = None
    description: str = "draws of laws"

    @classmethod
    @checked(generator=A_GENERATOR)
    def of(cls, laws: Sequence[Law], names: Sequence[str], generator: np.random.Generator) -> Self:
        """Fit a mixture of truncated normals to points of all laws, as their proposal.

        All laws must have the same finite box.
        """
        draws = cls([OneLaw(law, name) for law, name in zip(laws, names, strict=True)])
        x = draws.draw_from_mean(POINTS, generator)
        proposal = TruncatedNormalMixture.fit(x, laws[0].box, generator, components=COMPONENTS)
        return replace(draws, own=proposal)

    @property
    def law(self) -> Law:
        """The draws themselves, with their proposal."""
        return self

    @cached_property
    def proposal(self) -> Law:
        """The law under which encounters are drawn."""
        if self.own is not None:
            return self.own
        sizes = np.array([part.size for part in self.parts], dtype=float)
        return MixedLaws([part.proposal for part in self.parts], sizes / sizes.sum(), self.description)

    @property
    def box(self) -> Box:
        """The variables and their limits."""
        return self.proposal.box

    @property
    def uses_records(self) -> bool:
        """Whether the proposal needs the records."""
        return self.proposal.uses_records

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the candidates of the draws, in the order of the parts."""
        return tuple(name for part in self.parts for name in part.names)

    @cached_property
    def laws(self) -> Sequence[Any]:
        """The law of each draw, in the order of the parts."""
        return [law for part in self.parts for law in part.laws]

    @property
    def support(self) -> Support:
        """That of the first part, as smooth laws come first."""
        return self.parts[0].support

    @property
    def typical(self) -> Any:  # noqa: ANN401
        """That of the first part that has one."""
        return next((law for part in self.parts if (law := part.typical) is not None), None)

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
        return np.concatenate([part.log_densities(x) for part in self.parts])

    def log_slices(self, k: int, x: Array, low: Array, high: Array) -> Array:
        """Return the log of the integral of the density of each draw over variable k, shape (K, n)."""
        return np.concatenate([part.log_slices(k, x, low, high) for part in self.parts])

    @property
    def sliced(self) -> Sequence[Any]:
        """Those of the parts, and the proposal if it is not the mixture of theirs."""
        own = [] if self.own is None else [self.own]
        return [law for part in self.parts for law in part.sliced] + own

    @checked(**DRAWING)
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

    def with_cap_at(self, closing_speed_max: float) -> Self:
        """Return the draws and their proposal with another cap on the closing speed [m/s]."""
        own = None if self.own is None else self.own.with_cap_at(closing_speed_max)
        return replace(self, parts=[part.with_cap_at(closing_speed_max) for part in self.parts], own=own)

    def mapped(self, change: Callable[[Law], Law]) -> Self:
        """Return single laws, and their own proposal, each replaced by a function of it."""
        parts = [OneLaw(change(law), name) for law, name in zip(self.laws, self.names, strict=True)]
        return replace(self, parts=parts, own=None if self.own is None else change(self.own))

    def subset(self, chosen: NDArray[np.intp]) -> Self:
        """Return the draws with the given indices, shape (k,), in their order; an index may be repeated."""
        part = np.searchsorted(self._first, chosen, side="right") - 1
        runs = np.split(np.arange(chosen.size), np.flatnonzero(np.diff(part)) + 1)  # of the same part
        own = [(part[run[0]], chosen[run]) for run in runs]
        return replace(self, parts=[self.parts[k].subset(few - self._first[k]) for k, few in own])

    @cached_property
    def _first(self) -> NDArray[np.intp]:
        """Index of the first draw of each part."""
        return np.cumsum([0, *(part.size for part in self.parts[:-1])])

    def content(self) -> dict[str, Any]:
        """Return the content of the law file: the proposal, unless it is the mixture, and all parts."""
        own = {} if self.own is None else {"proposal": nested_content(self.own)}
        return own | {"draws": [part.content_as_part() for part in self.parts]}

    @classmethod
    def from_content(cls, content: Mapping[str, Any], box: Box, records: pd.DataFrame | None) -> Self:
        """Build the draws from the content of their file, their limits, and the records."""
        laws = [(nested_law(part, records), part.get("name")) for part in content["draws"]]
        parts = [as_draws(law) if name is None else OneLaw(law, name) for law, name in laws]
        own = nested_law(content["proposal"], records) if "proposal" in content else None
        return cls(parts, own, content["description"])


@checked()
def as_draws(law: Law | Draws) -> Draws:
    """Return a law with draws as it is, and any other law as K = 1 draws.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> law = ae.choose_draws("independent_variables", ae.read_records("left_turn")).law
    >>> ae.as_draws(law).size
    1
    """
    return law if isinstance(law, Draws) else OneLaw(law)
