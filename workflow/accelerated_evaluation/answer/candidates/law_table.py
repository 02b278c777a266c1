"""The table of laws: their held-out scores near the crash set, their weights, and which are rejected."""

import warnings
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pandas as pd
from numpy.linalg import LinAlgError
from tqdm import tqdm

from accelerated_evaluation.answer.candidates.cut_in_family import scores_by_region
from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.candidates.law_weights import mixture_scores
from accelerated_evaluation.answer.candidates.scores import FittedLaw, HeldOut, time_to_collision_boundary
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import ConvergenceError
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.laws.draws import OneLaw
from accelerated_evaluation.laws.lead_speeds import WithLeadSpeeds
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.independent import IndependentTail
from accelerated_evaluation.vehicles.protocol import Vehicle

INVERSE_TTC = (0.25, 0.35, 0.45)  # [1/s], regions: inverse time to collision at the cut-in above these values
SIMULATED_TTC = (2.0, 3.0, 4.0)  # [s], regions: smallest simulated time to collision at most these values
PAPER = "paper: independent, exponential 0.95"
TOGETHER = "all laws, weighted"
KNOT = 0.95  # level of the threshold of the laws that are listed
ERRORS = 2.5  # a law is rejected if its score is this number of standard errors below that of the best law


def regions(records: DistinctRecords, vehicle: Vehicle) -> dict[str, Array]:
    """Return the closing speed [m/s] above which each record is in a region, by name of the region.

    The vehicle is the one whose simulated time to collision defines some of the regions.
    """
    inside = {f"inverse_ttc_{q:g}": q * records.range_ for q in INVERSE_TTC}
    for ttc in SIMULATED_TTC:
        boundary = time_to_collision_boundary(vehicle, ttc, records.support)
        inside[f"simulated_ttc_{ttc:g}"] = boundary(records.lead_speed, records.range_)
    return inside


def papers_law(records: DistinctRecords) -> IndependentTail:
    """Fit the paper's law of the closing speed, the baseline of all scores, with one threshold."""
    return IndependentTail.fit(records, KNOT)


def score_laws(
    study: LawStudy,
    vehicle: Vehicle,
    others: Mapping[str, Callable[[DistinctRecords], FittedLaw]],
) -> dict[str, dict[str, Array]]:
    """Return the held-out log scores of the laws of the family, and of other laws, by law and `regions`.

    Each has the shape (records,). ``others`` has functions that fit the other laws to records. If one cannot
    be fitted, a warning is given, and the law has no scores.
    """
    fitter, family = study.smooth.fitter, study.smooth.family
    inside = regions(fitter.records, vehicle)
    scores: dict[str, dict[str, Array]] = {}

    def add(names: Sequence[str], held_out: HeldOut) -> None:
        log_scores = held_out.scores(inside)
        if np.isnan([*log_scores.values()]).any():
            raise ConvergenceError(
                "the fit",
                reached="parameters that overflow",
                limit="finite parameters",
                change="Add records.",
            )
        for place, name in enumerate(names):
            scores[name] = {region: values[place] for region, values in log_scores.items()}

    add([member.name for member in fitter.members], HeldOut.of_family(fitter, family))
    for name, fit in tqdm(others.items(), desc="other laws", unit=" laws"):
        try:
            add([name], HeldOut.of_law(fit, fitter.records))
        except (ConvergenceError, LinAlgError) as error:
            warnings.warn(f"{name} cannot be fitted, and has no scores: {error}", stacklevel=2)
    return scores


def compare_laws(
    study: LawStudy, vehicle: Vehicle, lines: CrashLines, generator: np.random.Generator
) -> pd.DataFrame:
    """Score all candidates and the paper's law, and tabulate them with their crash probabilities.

    The generator is used for fits of laws that users have added. The columns are those of `law_table`.
    """
    smooth = study.smooth
    crash = dict(zip(smooth.names, lines.masses(smooth.fitted).sum(axis=1), strict=True))
    scores = score_laws(study, vehicle, {PAPER: papers_law})
    if (added := study.added) is not None:
        scores |= scores_by_region(added, regions(smooth.records, vehicle), generator)
        for name, law in zip(added.names, added.laws, strict=True):
            crash[name] = lines.masses(OneLaw(WithLeadSpeeds(law, added.lead_speeds))).sum()
    return law_table(study, scores, crash)


def law_table(
    study: LawStudy,
    scores: Mapping[str, Mapping[str, Array]],
    probabilities: Mapping[str, float],
) -> pd.DataFrame:
    """Tabulate the gain of each law over the paper's law, its weight, and whether it is rejected.

    A law is rejected if its density is zero at a held-out record, or if in some region its score is below
    that of the best law by more than `ERRORS` standard errors of their difference. For each region, the
    column is the gain in the held-out log score over the paper's law [nats], and ``error_...`` the standard
    error of the difference to the best law of the region. ``behind`` is the largest of these differences in
    standard errors, and ``impossible`` the number of held-out records with zero density. ``weight`` is the
    mean weight, and ``refused`` says whether the law is rejected.
    """
    mean_weights, names = study.mean_weights, list(study.names)
    together = {
        region: mixture_scores(np.array([scores[name][region] for name in names]), mean_weights)
        for region in scores[PAPER]
    }
    best = {at: max(scores, key=lambda law, at=at: scores[law][at].sum()) for at in together}
    rows = []
    for law, of_law in {TOGETHER: together, **scores}.items():
        gains = {f"gain_{at}": float((of_law[at] - scores[PAPER][at]).sum()) for at in together}
        behind = max(errors_behind(scores[best[at]][at], of_law[at]) for at in together)
        errors = {f"error_{at}": difference_error(scores[best[at]][at] - of_law[at]) for at in together}
        impossible = int(np.isneginf(of_law[next(iter(together))]).sum())
        rows.append({"law": law} | gains | errors | {"behind": behind, "impossible": impossible})
    table = pd.DataFrame(rows).set_index("law", drop=False)
    table["weight"] = pd.Series(mean_weights, index=names).reindex(table.index).fillna(0.0)
    table["probability"] = pd.Series(dict(probabilities))
    table["refused"] = (table["impossible"] > 0) | (table["behind"] > ERRORS)
    return table.reset_index(drop=True)


def errors_behind(best: Array, other: Array) -> float:
    """Return the difference of two total scores, divided by its standard error.

    It is 0 if the scores are equal, and infinite if a score is not finite.
    """
    difference = best - other
    if not np.all(np.isfinite(difference)):
        return float("inf")
    error = difference_error(difference)
    return float(difference.sum() / error) if error else 0.0


def difference_error(difference: Array) -> float:
    """Return the standard error of a sum over independent records; NaN if a term is not finite."""
    finite = np.all(np.isfinite(difference))
    return float(np.sqrt(difference.size * difference.var())) if finite else float("nan")
