"""Laws of lead motion: how the speed of the car that cuts in changes after the lane crossing."""

from pathlib import Path
from typing import Protocol

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.registry import Registry

STEP = 0.1  # [s], between two lead speeds
STATES = 81  # lead speeds of an encounter: 8 s, the horizon of the study's car


class LeadMotion(Protocol):
    """A law of lead motion: a random function of a few inputs, which are uniform on 0 to 1.

    Attributes
    ----------
    inputs
        Number of inputs.
    """

    inputs: int

    def lead_speeds(self, encounters: Array, inputs: Array) -> Array:
        """Return lead speeds over time.

        Parameters
        ----------
        encounters
            Lead speed [m/s], range [m] and closing speed [m/s] at the crossing, shape (3, n).
        inputs
            Inputs between 0 and 1, shape (n, inputs).

        Returns
        -------
        numpy.ndarray
            Lead speeds [m/s] at 0, 0.1, ..., 8 s, shape (n, STATES). None is negative, and the first one is
            the lead speed.
        """


MOTIONS: Registry[type[LeadMotion]] = Registry("lead motion", __package__, [str(Path(__file__).parent)])


def draw_lead_speeds(motion: LeadMotion, encounters: Array, generator: np.random.Generator) -> Array:
    """Draw the lead speeds of n encounters; shapes as in `LeadMotion.lead_speeds`."""
    return motion.lead_speeds(encounters, generator.random((encounters.shape[1], motion.inputs)))
