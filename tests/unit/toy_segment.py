"""A segment of cut-ins near the recorded ones, and a vehicle whose crash probability in it is known."""

import math
from dataclasses import dataclass

import numpy as np
from accelerated_evaluation import CUT_IN, Problem
from accelerated_evaluation.laws import Factors
from accelerated_evaluation.laws.distributions import (
    BoundedExponential,
    BoundedNormal,
    Empirical,
    Mixture,
    PiecewiseMixture,
)
from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.cross_entropy.families import PiecewiseFamily, SingleFamily
from accelerated_evaluation.methods.cross_entropy.method import CONSTANTS, CrossEntropyMethod
from accelerated_evaluation.study.configuration import load
from accelerated_evaluation.vehicles import Outcomes

SETTINGS = load()
CONFIG = CONSTANTS | SETTINGS["cross_entropy"]
PAPERS = [name for name, method in METHODS.items() if issubclass(method, CrossEntropyMethod)]
BODY = Mixture((0.2, 0.8), (BoundedNormal(0.037, 0.0, 0.166), BoundedNormal(0.0885, 0.0, 0.166)))
F = Factors(
    PiecewiseMixture(
        (0.83, 0.17), (BoundedExponential(107.0, 1 / 75, 0.037), BoundedExponential(43.0, 0.037))
    ),
    PiecewiseMixture((0.95, 0.05), (BODY, BoundedExponential(21.0, 0.166))),
)


@dataclass(frozen=True)
class Toy:
    """A vehicle that crashes if and only if R^-1 and TTC^-1 are both above their thresholds."""

    inverse_range: float = 0.0
    inverse_ttc: float = 0.0

    def simulate(self, lead_speed, range_, closing_speed):
        missing = np.zeros(range_.size)
        for threshold, value in (
            (self.inverse_range, 1 / range_),
            (self.inverse_ttc, closing_speed / range_),
        ):
            missing = np.maximum(missing, threshold - value)
        crash = missing == 0
        return Outcomes(
            crash, np.where(crash, 0.0, range_), np.where(crash, np.inf, missing), np.zeros(range_.size)
        )


def toy(inverse_range, inverse_ttc):
    """Return cut-ins before a vehicle whose thresholds, if there are any, have these tail probabilities."""
    thresholds = [
        0.0 if tail is None else float(law.isf(tail))
        for law, tail in ((F.first, inverse_range), (F.second, inverse_ttc))
    ]
    return before(Toy(*thresholds))


def before(vehicle, cap=math.inf):
    """Return the problem of a vehicle before cut-ins of one segment, all at 20 m/s."""
    law = IndependentLaw("toy", {"all": 1}, F.first, {"all": F.second}, {"all": Empirical([20.0])}, cap)
    return Problem(CUT_IN, vehicle, law=law)


def families(method):
    make = SingleFamily.start if method == "single" else lambda law: PiecewiseFamily.start(law, 0.01, 5)
    return make(F.first), make(F.second)


def found(method, problem, seed, **changes):
    rows = []
    generator = np.random.default_rng(seed)
    configured = METHODS[method].configured(SETTINGS | {"cross_entropy": CONFIG | changes})
    (stratum,) = problem.law.strata
    result = configured.search(problem, stratum, generator, rows.append)
    assert rows == result.trace
    return result
