"""Laws of cut-ins that add recorded lead speeds to a law of range and closing speed."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np
import pandas as pd
from fewruns.problems import normal_score_quantile

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.files import value_digest
from accelerated_evaluation.laws import LAWS, nested_content, nested_law
from accelerated_evaluation.laws.distributions import Empirical
from accelerated_evaluation.laws.draws import DrawnLaws
from accelerated_evaluation.laws.protocol import Box, Law, density_over, log_slice_of
from accelerated_evaluation.laws.strata import VARIABLES


@LAWS.add("with_lead_speeds")
@dataclass(frozen=True, eq=False)
class WithLeadSpeeds(Law):
    """A law of range and closing speed that is independent of the lead speed, which is a recorded one."""

    needs_records: ClassVar[bool] = True
    law: Law  # of range [m] and closing speed [m/s]
    lead_speeds: Empirical = field(repr=False)
    closing_speed_max: float = math.inf  # cap [m/s]; the upper limit of the law is no cap

    @property
    def description(self) -> str:
        """Description of the law of range and closing speed."""
        return self.law.description

    @property
    def box(self) -> Box:
        """The limits of range and closing speed, with the cap; those of the lead speed are not stated."""
        farthest, fastest = self.law.box.upper
        upper = math.inf, farthest, min(fastest, self.closing_speed_max)
        return Box(VARIABLES, (0.0, *self.law.box.lower), upper)

    def from_normal_scores(self, z: Array) -> Array:
        """Map normal scores to cut-ins, both of shape (n, 3)."""
        lead_speed = normal_score_quantile(self.lead_speeds, z[:, 0])
        x = np.column_stack([lead_speed, self.law.from_normal_scores(z[:, 1:])])
        return np.minimum(x, self.box.upper)

    def log_density(self, x: Array) -> Array:
        """Return the log density of range and closing speed at cut-ins x, shape (n, 3).

        At the cap, the density is integrated over all larger closing speeds. Without a cap of its own, the
        result at the largest closing speed is -inf, because other laws state a probability there in place of
        a density, and the two must not be added.
        """
        density, cap = self.law.log_density(x[:, 1:]), self.box.upper[2]
        capped = x[:, 2] >= cap
        ends = (np.full(capped.sum(), end) for end in (cap, self.law.box.upper[1]))
        with np.errstate(divide="ignore"):
            density[capped] = np.log(density_over(self.law, 1, x[capped, 1:], *ends))
        return density

    def log_slice(self, k: int, x: Array, low: Array, high: Array) -> Array:
        """Return the log of the integral of the density over variable k; see `SlicedLaw`.

        As in `log_density`, it is the density given the lead speed, and the cap has a probability.
        """
        cap, top = self.box.upper[k], self.law.box.upper[k - 1]
        ends = np.where(low < cap, low, top), np.where(high >= cap, top, high)
        return log_slice_of(self.law, k - 1, x[:, 1:], *ends)

    def with_cap_at(self, closing_speed_max: float) -> Self:
        """Return the law with another cap on the closing speed [m/s]; `math.inf` is no cap."""
        return replace(self, closing_speed_max=closing_speed_max)

    @property
    def digest(self) -> str:
        """The digest of the law and of the lead speeds, which are not part of its content."""
        return value_digest([super().digest, repr(self.lead_speeds)])

    def content(self) -> dict[str, Any]:
        """Return the content of the law file: that of the law of range and closing speed."""
        return {"law": nested_content(self.law)}

    @classmethod
    def from_content(cls, content: Mapping[str, Any], box: Box, records: pd.DataFrame) -> Self:
        """Build the law from the content of its file and the records, which supply the lead speeds."""
        return cls(nested_law(content["law"], None), Empirical(records["lead_speed"]), box.upper[2])


def with_lead_speeds(draws: DrawnLaws, lead_speeds: Empirical) -> DrawnLaws:
    """Return draws of laws of range and closing speed as draws of laws of cut-ins."""
    return draws.mapped(lambda law: WithLeadSpeeds(law, lead_speeds))
