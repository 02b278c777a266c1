"""Law of lead motion in which the lead vehicle keeps its speed, as in the paper."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.motion import MOTIONS, STATES


@MOTIONS.add("constant")
@dataclass(frozen=True)
class Constant:
    """The lead vehicle keeps its speed; see `LeadMotion`."""

    inputs: ClassVar[int] = 0

    def lead_speeds(self, encounters: Array, inputs: Array) -> Array:
        """Return the lead speeds over time, which are constant; see `LeadMotion.lead_speeds`."""
        return np.repeat(encounters[0][:, None], STATES, axis=1)
