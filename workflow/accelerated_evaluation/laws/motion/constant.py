"""Law of lead motion in which the lead vehicle keeps its speed, as in the paper."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.motion import MOTIONS, STATES


@MOTIONS.add("constant")
@dataclass(frozen=True)
class Constant:
    """Law of lead motion without random inputs: the lead vehicle keeps its speed."""

    inputs: ClassVar[int] = 0

    def lead_speeds(self, encounters: Array, inputs: Array) -> Array:
        """Return the lead speeds [m/s] at 0, 0.1, ..., 8 s, which are constant, shape (n, 81).

        The first row of ``encounters``, shape (3, n), contains the lead speeds. ``inputs`` is not used.
        """
        return np.repeat(encounters[0][:, None], STATES, axis=1)
