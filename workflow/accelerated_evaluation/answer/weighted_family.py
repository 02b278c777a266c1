"""The family of laws, fitted to the records and weighted by its scores on held-out records."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from accelerated_evaluation.answer.posterior import Posterior, draw_posterior
from accelerated_evaluation.answer.scores import BLOCKS, HeldOut
from accelerated_evaluation.answer.weights import bootstrapped_weights
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.laws.smooth.family import MEMBERS, DistinctRecords, Fitter, LawFamily, Member

REGION = 0.25  # [1/s], TTC^-1 above which laws are weighted; contains the crash set and some 600 records
REGION_SHARE = 0.003  # of the records that the region holds at least, where traffic is calmer
DRAWS = 500
LINES = 2500  # of a thinned map
GUIDE = 0.95  # level of the thresholds whose laws, with the body alone, say which lines to keep


@dataclass(frozen=True)
class ScoredFamily:
    """A family fitted to records, with its scores on held-out records: what `family_file` keeps.

    No random number is needed to make it.

    Attributes
    ----------
    fitter, family
        The records, and the fit to all of them.
    log_scores
        Held-out log scores censored to TTC^-1 above that of `region`, shape (members, records).
    """

    fitter: Fitter
    family: LawFamily
    log_scores: Array

    @property
    def records(self) -> DistinctRecords:
        """The distinct cut-ins."""
        return self.fitter.records

    @property
    def members(self) -> tuple[Member, ...]:
        """The laws."""
        return self.fitter.members

    def weighted(self, generator: np.random.Generator, draws: int = DRAWS) -> "WeightedLaws":
        """Return the family with weights drawn from its scores; see `weights.bootstrapped_weights`."""
        inside = self.records.closing_speed > region(self.records) * self.records.range_
        weights = bootstrapped_weights(self.log_scores, inside, draws, generator)
        return WeightedLaws(self.fitter, self.family, self.log_scores, weights)


@dataclass(frozen=True)
class WeightedLaws(ScoredFamily):
    """A scored family with its weights.

    Attributes
    ----------
    weights
        Draws of the weights, shape (draws, members).
    """

    weights: Array

    @property
    def heaviest(self) -> Member:
        """The law of the largest mean weight."""
        return self.members[int(np.argmax(self.weights.mean(axis=0)))]

    def mean(self, values: Mapping[Member, Array | float]) -> Array | float:
        """Return the mean of a quantity over the laws, with their mean weights."""
        weights = self.weights.mean(axis=0)
        return sum(weight * values[member] for weight, member in zip(weights, self.members, strict=True))

    def weights_at(self, level: float) -> Array:
        """Return the weights restricted to the laws with one threshold, with rows that sum to 1.

        They are equal if all these laws have weight zero.
        """
        chosen = np.array([member.level == level for member in self.members])
        weights = np.where(chosen, self.weights, 0.0)
        weights[~weights.any(axis=1)] = chosen
        return weights / weights.sum(axis=1, keepdims=True)

    def thinned(self, lines: CrashLines, generator: np.random.Generator, size: int = LINES) -> CrashLines:
        """Thin the lines of an event to those that are probable under some of the laws."""
        guides = [member for member in self.members if member.level in (None, GUIDE)]
        masses = [lines.masses(self.family.ranges, self.family.law(member)) for member in guides]
        shares = [mass / mass.sum() for mass in masses if mass.any()]
        if not shares:  # the event never happens, or so rarely that its probability is 0 to rounding
            return lines
        return lines.thinned(np.mean(shares, axis=0), size, generator)

    def draw(
        self,
        lines: Mapping[str, CrashLines],
        generator: np.random.Generator,
        weights: Array | None = None,
        risks: Mapping[str, Array] = MappingProxyType({}),
    ) -> dict[str, Posterior]:
        """Draw probabilities of events from the posterior, optionally with other ``weights`` and with risks.

        `posterior.draw_posterior` describes the risks.
        """
        chosen = self.weights if weights is None else weights
        return draw_posterior(lines, self.family, self.members, chosen, generator, risks)


def region(records: DistinctRecords) -> float:
    """Return the TTC^-1 [1/s] above which laws are weighted.

    It is `REGION`, or less if there are few records above `REGION`.
    """
    return min(REGION, float(np.quantile(records.closing_speed / records.range_, 1 - REGION_SHARE)))


def score_family(
    records: DistinctRecords,
    members: tuple[Member, ...] = MEMBERS,
    blocks: int = BLOCKS,
    start: LawFamily | None = None,
) -> ScoredFamily:
    """Fit the family to all records, and score it on each block of records by a fit to the other blocks.

    Parameters
    ----------
    records
        Distinct cut-ins in the order of the record.
    members
        The laws; those above thresholds that hardly any event exceeds are left out.
    blocks
        Number of contiguous blocks that are held out in turn.
    start
        An earlier fit to similar records, whose smoothing parameters are kept.
    """
    fitter = Fitter(records, members)
    family, boundary = fitter.fit(start), region(records) * records.range_
    fitted = tuple(member for member in members if member.level is None or member in family.tails)
    if fitted != members:
        fitter = Fitter(records, fitted)
    held_out = HeldOut.of_family(fitter, family, blocks)
    return ScoredFamily(fitter, family, held_out.scores({"region": boundary})["region"])
