"""Both procedures on one set of records: ours, and the paper's, whose interval knows only sampling."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np
import pandas as pd
from accelerated_evaluation.answer.answer import evaluate
from accelerated_evaluation.answer.by_few_runs import FewRuns
from accelerated_evaluation.answer.calibration import (
    CLOSING,
    HOST,
    expected_counts,
    recorded_counts,
    with_poisson_limits,
)
from accelerated_evaluation.answer.law_study import LawStudy
from accelerated_evaluation.answer.posterior import Posterior
from accelerated_evaluation.answer.scores import GivenLaw, HeldOut, contiguous_folds
from accelerated_evaluation.answer.smooth_family import SmoothFamily, region
from accelerated_evaluation.crash_map.sensitivity import fit_for_crashes
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.family import Fitter
from accelerated_evaluation.methods import Stopping
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.records.segments import assign_segments
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.vehicles.builtin.acc_aeb import AccAeb
from kinds import independent_masses
from scipy.special import ndtri
from setting import MEMBERS, WorldSettings, distinct_records

COVERAGES = (0.5, 0.8, 0.95)
DRAWS = 100  # of the posterior, fewer than in the study
BLOCKS = 5  # held out, fewer than in the study
THIN = 10  # of the distinct outside the region of the score
CAP = 23.49 / 22.13  # the authors' cap on closing speeds, as a multiple of the largest that is recorded
EDGES = [5, 15, 25, 35]  # [m/s], the paper's segments
ERROR = 0.2  # relative half-width of the paper's 80 % interval

TOP = 45.0  # [m/s], at which faster cut-ins are simulated
STOPPING = Stopping(minimum_events=1, maximum_simulations=1000)  # as in the study

Intervals = dict[str, float]


@dataclass(frozen=True)
class Fitted:
    """The laws of the family, fitted to distinct records, with draws of their weights."""

    study: LawStudy

    @classmethod
    def to(cls, records: pd.DataFrame, setting: WorldSettings, generator: np.random.Generator) -> Self:
        """Fit the family to distinct records, and weight its laws by held-out scores."""
        distinct, _ = distinct_records(records)
        fitter = Fitter(distinct, MEMBERS)
        family, boundary = fitter.fit(setting.family), region(distinct) * distinct.range_
        folds = contiguous_folds(distinct.size, BLOCKS)
        scores = HeldOut.of_family(fitter, family, folds).scores({"region": boundary}, THIN)["region"]
        fitted = fitter, family, scores, {}, assign_segments(records, EDGES), TOP
        return cls(LawStudy.of_family(SmoothFamily(*fitted), DRAWS, generator))

    def by_map(self, setting: WorldSettings, generator: np.random.Generator) -> Intervals:
        """Draw from the posterior, and evaluate every draw on the map."""
        draws = self.study.draws(generator)
        return intervals(Posterior(draws.masses(setting.lines).sum(axis=1), draws.member))

    def by_few_runs(self, generator: np.random.Generator) -> Intervals:
        """Simulate the car under the mean of draws, and reweight the runs for each draw.

        In the mean of a kind of worlds, this took 145 to 340 simulations.
        """
        draws = self.study.draws(generator)
        problem = Problem(CUT_IN, AccAeb(), law=draws.proposal)
        found = evaluate(problem, draws, FewRuns(STOPPING), generator=generator)
        own = {"simulations": found.simulations, "converged": found.converged}
        return own if found.posterior is None else intervals(found.posterior.whole) | own

    def checks(self) -> Intervals:
        """Return the smallest p-value of counts of records, near the crashes and by host speed."""

        def given(places: Places) -> Iterator[GivenLaw]:
            below = places.body(family.body)
            return (family.law(member).given(places, below) for member in MEMBERS)

        family, records = self.study.smooth.family, self.study.smooth.records
        expected = self.study.mean_weights @ expected_counts(records, given)
        judged = with_poisson_limits(recorded_counts(records).assign(expected=expected))
        smallest = judged.groupby("counted")["p_value"].min()
        return {"near_p": smallest[CLOSING], "host_p": smallest[HOST]}


def intervals(posterior: Posterior) -> Intervals:
    """Return median, mean and intervals of a posterior."""
    reported = {"probability": posterior.probability, "mean": float(posterior.probabilities.mean())}
    for level in COVERAGES:
        reported[f"low{level:g}"], reported[f"high{level:g}"] = posterior.interval(level)
    return reported


def ours(records: pd.DataFrame, setting: WorldSettings, generator: np.random.Generator) -> Intervals:
    """Fit and weight the laws, and draw from the posterior."""
    fitted = Fitted.to(records, setting, generator)
    weights = zip(fitted.study.names, fitted.study.mean_weights, strict=True)
    return fitted.by_map(setting, generator) | {f"weight {name}": weight for name, weight in weights}


def paper(records: pd.DataFrame, setting: WorldSettings, generator: np.random.Generator) -> Intervals:
    """Fit the paper's law to all rows, and estimate with the relative error at which the paper stops."""
    cap = CAP * float((records["inverse_ttc"] / records["inverse_range"]).max())
    law = fit_for_crashes(assign_segments(records, EDGES), setting.levels, 75.0, np.inf, cap)
    exact = float(independent_masses(setting.lines, law, cap).sum())
    deviation = ERROR / ndtri(0.9)
    estimate = exact * max(1 + deviation * generator.standard_normal(), 0.0)
    reported = {"probability": estimate, "mean": estimate}
    for level in COVERAGES:
        half = deviation * ndtri((1 + level) / 2)
        reported[f"low{level:g}"], reported[f"high{level:g}"] = estimate * (1 - half), estimate * (1 + half)
    return reported


PROCEDURES = {"this project": ours, "paper": paper}
