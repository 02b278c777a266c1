"""The population of human drivers: distributions of the traits of drivers, with uncertain parameters.

The parameters are drawn from ranges, which are taken from publications or are assumptions, as the comments
say. Parameters are uniform within their ranges, with two exceptions: the logarithm of the exponent of the
noticing is uniform, and the share of drivers who swerve has a beta distribution.
"""

from dataclasses import dataclass, fields

import numpy as np
from scipy.special import ndtr, ndtri

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.vehicles.builtin.human_kernel import (
    BRAKING,
    DURATION,
    JERK,
    NOTICE,
    RESPONSE,
    SWERVE,
    SWERVE_WIDTH,
    TRAITS,
)

G = 9.81  # [m/s^2]
# Summala 2000, abstract: mean response times of 1.0 to 1.3 s at the same urgency, or 1.15 s plus or minus 13
# %.
RESPONSE_SCALE = (0.87, 1.13)
# Johansson and Rumar 1965, abstract: median .9 s, a quarter of the drivers above 1.2 s. The width of the
# range is an assumption.
SPREAD = np.log(1.2 / 0.9) / -ndtri(0.25)
RESPONSE_SPREAD = (0.85 * SPREAD, 1.15 * SPREAD)
NOTICE_EXPONENT = (1 / 3, 3.0)  # assumption: drivers notice at 25 to 75 % of the way, on average
# Mean duration of lane changes [s]: 5 to 6 (Toledo and Zohar 2007, abstract), 6.28 with a standard deviation
# of 2.0 (Lee, Olsen and Wierwille, abstract of 2003).
LANE_CHANGE = (5.0, 6.28)
LANE_CHANGE_VARIATION = 2.0 / 6.28
BRAKING_SCALE = (0.9, 1.1)  # assumption, because cars and roads differ from those of the next table
# Share of 122 drivers who did not reach a deceleration [g], in crashes and near-crashes of SHRP 2 (Dinakar
# and Muttart 2019, SAE 2019-01-0414, as L. Peck, Lightpoint, 15 December 2023, computed them from the paper).
# The largest deceleration of 2,971 drivers of SHRP 2 is 1.09 g (Wood and Zhang 2020, as cited).
BRAKING_LEVELS = np.array([0.4, 0.5, 0.6, 0.7, 0.8, 1.09])
BRAKING_SHARES = np.array([0.0, 0.01, 0.10, 0.42, 0.70, 1.0])
# The mean time until .7 g is .51 s if the other car is one lane away, and 1.10 s if it is two lanes away (the
# same source).
JERK_RANGE = (0.7 * G / 1.10, 0.7 * G / 0.51)
# Number of near-crashes in data/crash_counts with a swerve as evasive manoeuvre, and of all near-crashes.
SWERVED, STRUCK = 23, 70
# Lateral acceleration of 61 drivers before whom a box was dropped at 50 mph: mean .44 g, standard deviation
# .14 g (Weir and McRuer 1976, SAE 766060, as W. Bartlett reports in "Avoidance Maneuver Accelerations").
SWERVE_MEAN, SWERVE_DEVIATION, SWERVE_LEAST = 0.44 * G, 0.14 * G, 0.05 * G
# Drivers above 25 steered by 2 feet, younger ones by more than 6 (Muttart 2015, SAE 2015-01-1417, abstract).
SWERVE_RANGE = (0.61, 1.83)  # [m]
DURATION_SHAPE = float(np.sqrt(np.log1p(LANE_CHANGE_VARIATION**2)))


@dataclass(frozen=True)
class Population:
    """Parameters of n possible populations of drivers; every array has shape (n,)."""

    # Mean of the factor by which the response time differs from its published value; it is log-normal.
    scale: Array
    spread: Array  # standard deviation of the logarithm of this factor
    # k: the share of the way at which a driver notices the other car has the density k x^(k - 1) on [0, 1].
    exponent: Array
    lane_change: Array  # mean duration of lane changes [s]
    braking: Array  # factor by which decelerations differ from the published ones
    swerving: Array  # share of the drivers who swerve

    @classmethod
    def draw(cls, size: int, generator: np.random.Generator) -> "Population":
        """Return ``size`` possible populations, with parameters drawn at random from their ranges."""
        return cls(
            generator.uniform(*RESPONSE_SCALE, size),
            generator.uniform(*RESPONSE_SPREAD, size),
            np.exp(generator.uniform(*np.log(NOTICE_EXPONENT), size)),
            generator.uniform(*LANE_CHANGE, size),
            generator.uniform(*BRAKING_SCALE, size),
            generator.beta(SWERVED + 0.5, STRUCK - SWERVED + 0.5, size),
        )

    @classmethod
    def central(cls, size: int) -> "Population":
        """Return the population with parameters in the middle of their ranges, repeated ``size`` times."""
        middle = [np.mean(ends) for ends in (RESPONSE_SCALE, RESPONSE_SPREAD)]
        middle += [1.0, np.mean(LANE_CHANGE), np.mean(BRAKING_SCALE), SWERVED / STRUCK]
        return cls(*(np.full(size, value) for value in middle))

    def drivers(self, generator: np.random.Generator) -> Array:
        """Draw one driver from each population; return their traits, shape (n, traits).

        The columns are the `TRAITS` of `human_kernel`.
        """
        size = self.scale.size
        level = generator.random(size)
        sideways = -ndtri(generator.random(size) * ndtr((SWERVE_MEAN - SWERVE_LEAST) / SWERVE_DEVIATION))
        traits = np.empty((size, len(TRAITS)))
        traits[:, RESPONSE] = np.exp(self._log_response + self.spread * generator.standard_normal(size))
        traits[:, NOTICE] = generator.random(size) ** (1 / self.exponent)
        traits[:, DURATION] = np.exp(self._log_duration + DURATION_SHAPE * generator.standard_normal(size))
        traits[:, BRAKING] = G * self.braking * np.interp(level, BRAKING_SHARES, BRAKING_LEVELS)
        jerk, width = generator.random((2, size))
        swerves = generator.random(size) < self.swerving
        traits[:, SWERVE] = np.where(swerves, SWERVE_MEAN + SWERVE_DEVIATION * sideways, 0.0)
        traits[:, JERK] = JERK_RANGE[0] * (JERK_RANGE[1] / JERK_RANGE[0]) ** jerk
        traits[:, SWERVE_WIDTH] = SWERVE_RANGE[0] + (SWERVE_RANGE[1] - SWERVE_RANGE[0]) * width
        return traits

    def density(self, traits: Array, *, swerves: bool = True) -> Array:
        """Return the density of drivers in each population, up to a common factor, shape (n, drivers).

        The factor is the same in all populations, and the traits have the shape (drivers, traits).
        """
        columns = {field.name: getattr(self, field.name)[:, None] for field in fields(self)}
        spread, exponent, braking = columns["spread"], columns["exponent"], columns["braking"]
        response = (np.log(traits[:, RESPONSE]) - self._log_response[:, None]) / spread
        duration = (np.log(traits[:, DURATION]) - self._log_duration[:, None]) / DURATION_SHAPE
        log_density = (exponent - 1) * np.log(traits[:, NOTICE]) - (response**2 + duration**2) / 2
        piece = np.searchsorted(BRAKING_LEVELS, traits[:, BRAKING] / (G * braking), side="right")
        slope = np.concatenate([[0.0], np.diff(BRAKING_SHARES) / np.diff(BRAKING_LEVELS), [0.0]])
        swerving = np.where(traits[:, SWERVE] > 0, columns["swerving"], 1 - columns["swerving"])
        swerving = swerving if swerves else 1.0
        return np.exp(log_density) * slope[piece] * swerving * (exponent / (spread * braking))

    @property
    def _log_response(self) -> Array:
        """Mean of the logarithm of the response factor, which is chosen so that the factor's mean is scale.

        The published response times are means.
        """
        return np.log(self.scale) - self.spread**2 / 2

    @property
    def _log_duration(self) -> Array:
        return np.log(self.lane_change) - DURATION_SHAPE**2 / 2
