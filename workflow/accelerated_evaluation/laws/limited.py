"""Draws of a law given a condition on the encounter, such as a limit to the speed of the vehicle itself.

Encounters that do not meet the condition do not happen. Each draw is divided by its own probability of the
condition, so the result is the probability of an event in an encounter that does happen.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array, numbers_in
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.randomness import DRAWING
from accelerated_evaluation.laws import LAWS, nested_content, nested_law
from accelerated_evaluation.laws.draws import DrawnLaws, Draws, EventLines, as_draws
from accelerated_evaluation.laws.protocol import Box

POINTS = 4_000  # number of encounters from which the probability of the condition is estimated
LEAST = 0.01  # smallest mean probability of the condition; with a smaller one, most draws are in vain


@dataclass(frozen=True)
class Where:
    """A condition that is a function of encounters; its draws have no intervals and no law file."""

    holds: Callable[[Array], NDArray[np.bool_]]


@dataclass(frozen=True)
class Limit:
    """The condition that the sum of some variables of an encounter is at most a number."""

    names: tuple[str, ...]  # of the variables in the sum
    columns: tuple[int, ...]  # their indices among the variables
    maximum: float  # in the unit of the variables

    @classmethod
    def of(cls, variables: Sequence[str], names: Sequence[str], maximum: float) -> Self:
        """Return the limit of the sum of some of the variables of an encounter, which are given in order."""
        return cls(tuple(names), tuple(map(variables.index, names)), float(maximum))

    def holds(self, x: Array) -> NDArray[np.bool_]:
        """Return whether each of n encounters, shape (n, d), is within the limit, shape (n,)."""
        return x[:, self.columns].sum(axis=1) <= self.maximum

    def largest(self, k: int, x: Array) -> Array:
        """Return the largest value of variable k, (n,), that the other variables of x, (n, d), allow."""
        left = self.maximum - x[:, [column for column in self.columns if column != k]].sum(axis=1)
        return left if k in self.columns else np.where(left >= 0, np.inf, -np.inf)

    @property
    def in_words(self) -> str:
        """The limit as text."""
        return f"{' + '.join(self.names)} at most {self.maximum:g}"


def limits_in_words(draws: Draws) -> list[str]:
    """Return the limits of draws, with the probability of the encounters beyond them, as texts."""
    if not isinstance(draws, LimitedDraws):
        return []
    beyond = 1 - draws.shares.mean()
    return [
        *limits_in_words(draws.whole),
        f"the answer is for encounters with {draws.condition.in_words}; the others, a share of {beyond:.2g} "
        "under the law, do not happen",
    ]


def limited(draws: Draws, limits: Sequence[Limit], generator: np.random.Generator) -> Draws:
    """Return draws of a law given all of the limits; without limits, the draws themselves."""
    for limit in limits:
        draws = LimitedDraws.given(draws, limit, generator)
    return draws


@LAWS.add("limited")
@dataclass(frozen=True, eq=False, repr=False)
class LimitedDraws(DrawnLaws):
    """K draws of a law given a condition.

    Vehicles are simulated under the proposal of the whole law, of which encounters that do not meet the
    condition have no weight.
    """

    condition: Where | Limit = field(kw_only=True)
    shares: Array = field(kw_only=True)  # probability of the condition under each draw, shape (K,)

    @classmethod
    def given(cls, whole: Draws, condition: Where | Limit, generator: np.random.Generator) -> Self:
        """Estimate the probability of the condition under each draw, from points of their mean.

        The relative standard error of a share s is at most about sqrt((1 - s) / (s POINTS)). InputError is
        raised if hardly any point meets the condition.
        """
        x = whole.draw_from_mean(POINTS, generator)
        ratios, holds = np.exp(whole.log_ratios_to_mean(x)), condition.holds(x)
        if not holds.mean() >= LEAST:
            raise InputError(
                "the limits of the encounters",
                seen=f"a share of {holds.mean():.2g} of the encounters of the law within them",
                expected=f"a share of at least {LEAST:g}",
                change="Widen the limits, or use records of encounters within them.",
            )
        return cls.of_shares(whole, condition, ratios @ holds / ratios.sum(axis=1))

    @classmethod
    def of_shares(cls, whole: Draws, condition: Where | Limit, shares: Array) -> Self:
        """Return draws whose probabilities of the condition are known, shape (K,)."""
        return cls([whole], whole.proposal, whole.law.description, condition=condition, shares=shares)

    @property
    def whole(self) -> Draws:
        """The draws without this condition."""
        return self.parts[0]

    @property
    def unlimited(self) -> Draws:
        """The draws without any condition."""
        return self.whole.unlimited

    def holds(self, x: Array) -> NDArray[np.bool_]:
        """Return whether each of n encounters, shape (n, d), can happen, shape (n,)."""
        return self.condition.holds(x) & self.whole.holds(x)

    def within(self, lines: EventLines) -> EventLines:
        """Return the lines of a crash map with intervals that end at the limit at the latest."""
        return self.whole.within(lines).below(self.condition.largest)

    def log_slices(self, k: int, x: Array, low: Array, high: Array) -> Array:
        """Return the log probability density of each draw over intervals of variable k, shape (K, n)."""
        end = self.condition.largest(k, x)
        logs, inside = np.full((self.size, len(x)), -np.inf), low < end
        ends = low[inside], np.minimum(high, end)[inside]
        logs[:, inside] = self.whole.log_slices(k, x[inside], *ends) - np.log(self.shares)[:, None]
        return logs

    def log_densities(self, x: Array) -> Array:
        """Return the log density of each draw at points x, shape (n, d), as an array of shape (K, n)."""
        densities = self.whole.log_densities(x) - np.log(self.shares)[:, None]
        return np.where(self.condition.holds(x), densities, -np.inf)

    def log_ratios_to_mean(self, x: Array) -> Array:
        """Return the log of the density of each draw divided by that of `draw_from_mean`, (K, n)."""
        scale = np.log(self.shares / self.shares.mean())[:, None]
        return np.where(self.condition.holds(x), self.whole.log_ratios_to_mean(x) - scale, -np.inf)

    @checked(**DRAWING)
    def draw_from_mean(self, n: int, generator: np.random.Generator) -> Array:
        """Draw n points from the mean of the whole draws, given the condition."""
        kept = np.empty((0, self.box.dimension))
        while len(kept) < n:
            x = self.whole.draw_from_mean(n, generator)
            kept = np.concatenate([kept, x[self.condition.holds(x)]])
        return generator.permutation(kept)[:n]  # the points of each draw come together

    def subset(self, chosen: NDArray[np.intp]) -> Self:
        """Return the draws with the given indices, shape (k,)."""
        return self.of_shares(self.whole.subset(chosen), self.condition, self.shares[chosen])

    def content(self) -> dict[str, Any]:
        """Return the content of the law file: the law without the limit, the limit, and its probabilities."""
        limit = {"names": list(self.condition.names), "maximum": self.condition.maximum}
        shares = list(map(float, self.shares))
        return {"whole": nested_content(self.whole.law), "limit": limit, "shares": shares}

    @classmethod
    def from_content(cls, content: Mapping[str, Any], box: Box, records: pd.DataFrame | None) -> Self:
        """Build the draws from the content of their file, their limits, and the records."""
        limit = Limit.of(box.names, content["limit"]["names"], content["limit"]["maximum"])
        whole = as_draws(nested_law(content["whole"], records))
        return cls.of_shares(whole, limit, numbers_in(content["shares"]))
