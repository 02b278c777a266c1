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
from accelerated_evaluation.laws import LAWS
from accelerated_evaluation.laws.distributions import Empirical
from accelerated_evaluation.laws.draws import DrawnLaws
from accelerated_evaluation.laws.protocol import Box, Law
from accelerated_evaluation.laws.strata import VARIABLES


@LAWS.add("with_lead_speeds")
@dataclass(frozen=True, eq=False)
class WithLeadSpeeds(Law):
    """A law of range and closing speed that is independent of the lead speed, which is a recorded one."""

    needs_records: ClassVar[bool] = True
    law: Law  # of range [m] and closing speed [m/s]
    lead_speeds: Empirical = field(repr=False)

    @property
    def description(self) -> str:
        """Description of the law of range and closing speed."""
        return self.law.description

    @property
    def box(self) -> Box:
        """The limits of the law of range and closing speed; those of the lead speed are not stated."""
        return Box(VARIABLES, (0.0, *self.law.box.lower), (math.inf, *self.law.box.upper))

    def from_normal_scores(self, z: Array) -> Array:
        """Map normal scores to cut-ins, both of shape (n, 3)."""
        lead_speed = normal_score_quantile(self.lead_speeds, z[:, 0])
        return np.column_stack([lead_speed, self.law.from_normal_scores(z[:, 1:])])

    def log_density(self, x: Array) -> Array:
        """Return the log density of range and closing speed at cut-ins x, shape (n, 3).

        It is -inf at the largest closing speed, which has no probability. Laws with a cap there state the
        probability of the cap in place of a density, and the two must not be added.
        """
        return np.where(x[:, 2] >= self.law.box.upper[1], -math.inf, self.law.log_density(x[:, 1:]))

    @property
    def digest(self) -> str:
        """The digest of the law and of the lead speeds, which are not part of its content."""
        return value_digest([super().digest, repr(self.lead_speeds)])

    def content(self) -> dict[str, Any]:
        """Return the content of the law file: that of the law of range and closing speed."""
        own = {"kind": self.law.kind, "variables": self.law.box.content(), "description": self.description}
        return {"law": own | self.law.content()}

    @classmethod
    def from_content(cls, content: Mapping[str, Any], box: Box, records: pd.DataFrame) -> Self:
        """Build the law from the content of its file and the records, which supply the lead speeds."""
        own = content["law"]
        law = LAWS[own["kind"]].from_content(own, Box.from_content(own["variables"]), None)
        return cls(law, Empirical(records["lead_speed"]))


def with_lead_speeds(draws: DrawnLaws, lead_speeds: Empirical) -> DrawnLaws:
    """Return draws of laws of range and closing speed as draws of laws of cut-ins."""
    laws = [WithLeadSpeeds(law, lead_speeds) for law in draws.laws]
    return replace(draws, laws=laws, proposal=WithLeadSpeeds(draws.proposal, lead_speeds))
