"""Laws of lead motion: how the speed of the car that cuts in changes after the lane crossing."""

import re
from pathlib import Path
from typing import Protocol

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.registry import Registry

STEP = 0.1  # [s], between two lead speeds
STATES = 81  # lead speeds of an encounter: 8 s, the horizon of the study's car
COURSE_COLUMN = re.compile(r"speed_(\d+\.?\d*)")  # column of a lead speed, and its time [s]
# Columns of a table with the lead speeds after the crossing [m/s]: speed_0.1, speed_0.2, ..., speed_8.0.
SPEED_COLUMNS = tuple(f"speed_{STEP * state:.1f}" for state in range(1, STATES))
RAREST = 1e-4  # distance of an input from 0 or 1 down to which `draw_wide` draws rare values often
LARGEST_WEIGHT = 2.0  # of a draw of `draw_wide`


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


def draw_wide(motion: LeadMotion, size: int, generator: np.random.Generator) -> tuple[Array, Array]:
    """Draw inputs of a law of lead motion, in which rare motions are more frequent than in the law.

    Half of the draws are from the law. In the other half, the logarithm of the distance of one input, chosen
    at random, from 0 or 1 is uniform.

    Returns
    -------
    inputs
        Inputs between 0 and 1, shape (size, inputs).
    weights
        Density of the law divided by the density of these draws, shape (size,); at most `LARGEST_WEIGHT`.
    """
    inputs = generator.random((size, motion.inputs))
    if not motion.inputs:
        return inputs, np.ones(size)
    distance = 0.5 * (2 * RAREST) ** generator.random(size)  # log-uniform from RAREST to 0.5
    extreme = np.where(generator.random(size) < 0.5, distance, 1 - distance)
    chosen = np.arange(motion.inputs) == generator.integers(motion.inputs, size=size)[:, None]
    is_wide = generator.random(size) < 0.5
    inputs = np.where(chosen & is_wide[:, None], extreme[:, None], inputs)
    nearest = np.minimum(inputs, 1 - inputs)
    density = np.where(nearest >= RAREST, 0.5 / np.maximum(nearest, RAREST) / -np.log(2 * RAREST), 0.0)
    return inputs, 1 / (0.5 + 0.5 * density.mean(axis=1))
