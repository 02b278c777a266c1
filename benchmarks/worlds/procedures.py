"""Both procedures on one set of records: ours, and the paper's, whose interval knows only sampling."""

import numpy as np
import pandas as pd
from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.candidates.scores import HeldOut, contiguous_folds
from accelerated_evaluation.answer.candidates.smooth_family import SmoothFamily, region
from accelerated_evaluation.answer.ways.posterior import Posterior
from accelerated_evaluation.crash_map.sensitivity import fit_for_crashes
from accelerated_evaluation.laws.draws import OneLaw
from accelerated_evaluation.laws.smooth.family import Fitter
from accelerated_evaluation.records.segments import assign_segments
from scipy.special import ndtri
from setting import MEMBERS, WorldSettings, distinct_records

COVERAGES = (0.5, 0.8, 0.95)
DRAWS = 100  # of the posterior, fewer than in the study
BLOCKS = 5  # held out, fewer than in the study
CAP = 23.49 / 22.13  # the authors' cap on closing speeds, as a multiple of the largest that is recorded
EDGES = [5, 15, 25, 35]  # [m/s], the paper's segments
ERROR = 0.2  # relative half-width of the paper's 80 % interval

TOP = 45.0  # [m/s], at which faster cut-ins are simulated

Intervals = dict[str, float]


def intervals(posterior: Posterior) -> Intervals:
    """Return median, mean and intervals of a posterior."""
    reported = {"probability": posterior.probability, "mean": float(posterior.probabilities.mean())}
    for level in COVERAGES:
        reported[f"low{level:g}"], reported[f"high{level:g}"] = posterior.interval(level)
    return reported


def ours(records: pd.DataFrame, setting: WorldSettings, generator: np.random.Generator) -> Intervals:
    """Fit the laws, weight them by held-out scores, and evaluate every draw of the posterior on the map."""
    distinct, _ = distinct_records(records)
    fitter = Fitter(distinct, MEMBERS)
    family, boundary = fitter.fit(setting.family), region(distinct) * distinct.range_
    folds = contiguous_folds(distinct.size, BLOCKS)
    scores = HeldOut.of_family(fitter, family, folds).scores({"region": boundary})["region"]
    fitted = fitter, family, scores, {}, assign_segments(records, EDGES), TOP
    draws = LawStudy.of_family(SmoothFamily(*fitted), DRAWS, generator).draws(generator)
    return intervals(Posterior(setting.lines.masses(draws).sum(axis=1), draws.member))


def paper(records: pd.DataFrame, setting: WorldSettings, generator: np.random.Generator) -> Intervals:
    """Fit the paper's law to all rows, and estimate with the relative error at which the paper stops."""
    cap = CAP * float((records["inverse_ttc"] / records["inverse_range"]).max())
    law = fit_for_crashes(assign_segments(records, EDGES), setting.levels, 75.0, np.inf, cap)
    exact = float(setting.lines.masses(OneLaw(law)).sum())
    deviation = ERROR / ndtri(0.9)
    estimate = exact * max(1 + deviation * generator.standard_normal(), 0.0)
    reported = {"probability": estimate, "mean": estimate}
    for level in COVERAGES:
        half = deviation * ndtri((1 + level) / 2)
        reported[f"low{level:g}"], reported[f"high{level:g}"] = estimate * (1 - half), estimate * (1 + half)
    return reported


OURS = "this project"
PROCEDURES = {OURS: ours, "paper": paper}
