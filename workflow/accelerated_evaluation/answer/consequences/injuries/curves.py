"""Curves of the risk of injury: the probability that an occupant is injured, given the delta-v of the car.

The delta-v is the change of a car's velocity in a crash. The injury of an occupant is described by the
largest value on the Abbreviated Injury Scale over all body regions (MAIS): 2 is moderate, 3 is serious.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.special import expit

from accelerated_evaluation.base.arrays import Array

LEVELS = ("MAIS2+", "MAIS3+", "fatal")  # at least moderate, at least serious, fatal
FRONTAL, REAR = "frontal", "rear"
KILOMETRES_PER_HOUR = 1 / 3.6  # [m/s]
MILES_PER_HOUR = 0.44704  # [m/s]


class RiskCurve(Protocol):
    """The probability of an injury as a function of the delta-v."""

    def __call__(self, delta_v: Array) -> Array:
        """Return the probability of an injury at each delta-v [m/s]."""

    @property
    def formula(self) -> str:
        """The formula of the curve as text, with its coefficients in the units of the publication."""


@dataclass(frozen=True)
class Logistic:
    """A logistic regression, logit P = intercept + slope * delta-v."""

    intercept: float
    slope: float
    unit: float  # unit of the delta-v in the publication, in m/s

    def __call__(self, delta_v: Array) -> Array:
        """Return the probability of an injury at each delta-v [m/s]."""
        return expit(self.intercept + self.slope / self.unit * np.asarray(delta_v))

    @property
    def formula(self) -> str:
        """The equation of the curve for the logit of the probability, in the unit of the publication."""
        return f"logit P = {self.intercept:g} + {self.slope:g} delta-v [{unit_name(self.unit)}]"


@dataclass(frozen=True)
class Power:
    """A power of the delta-v, P = (delta-v / reference)^exponent, at most 1."""

    reference: float  # Delta-v at which the curve reaches 1
    exponent: float
    unit: float  # unit of the delta-v in the publication, in m/s

    def __call__(self, delta_v: Array) -> Array:
        """Return the probability of an injury at each delta-v [m/s]."""
        return np.minimum(np.asarray(delta_v) / (self.unit * self.reference), 1.0) ** self.exponent

    @property
    def formula(self) -> str:
        """The equation of the curve for the probability, in the unit of the publication."""
        return f"P = (delta-v [{unit_name(self.unit)}] / {self.reference:g})^{self.exponent:g}"


@dataclass(frozen=True)
class Publication:
    """The curves of one publication, with the information that a reader needs to check them."""

    name: str  # authors and year
    reference: str
    doi: str  # or the number of a report if it has no DOI
    table: str  # where the coefficients are in the publication
    population: str  # the crashes and occupants to which the curves were fitted
    checked: str  # how the coefficients were checked, and what was not checked
    # By level of injury (`LEVELS`) and struck end of the car (`FRONTAL`, `REAR`).
    curves: Mapping[tuple[str, str], RiskCurve]


def unit_name(unit: float) -> str:
    """Return the name of a unit of the delta-v that is given in m/s: ``km/h`` or ``mph``."""
    return {KILOMETRES_PER_HOUR: "km/h", MILES_PER_HOUR: "mph"}[unit]
