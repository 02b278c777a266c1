"""The answer for other choices of the statistician: laws, weights, priors and splines."""

from dataclasses import replace

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.candidates.smooth_family import SmoothFamily, named
from accelerated_evaluation.answer.ways.posterior import Posterior, summarise
from accelerated_evaluation.answer.ways.variants import Streams, summary_under
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.laws.smooth.family import FarRecords
from accelerated_evaluation.laws.smooth.far_tail import SHAPE, FarPrior

ONE_FACTOR = "far tail: one factor for all places"
NEAR_FACTORS = "far tail: one factor from records near the crashes"
PRIORS = {
    ONE_FACTOR: FarPrior(deviations=(0.0,)),
    "far tail: prior half as wide": FarPrior(4 * SHAPE),
    "far tail: prior twice as wide": FarPrior(SHAPE / 4),
}
NEAR = 0.05  # probability of crashes with a smaller, or with a larger, lead speed or range
SPLINES = {"fewer splines": (4, 3), "more splines": (9, 8)}


def choice_table(study: LawStudy, lines: CrashLines, streams: Streams) -> pd.DataFrame:
    """Tabulate the crash probability for other choices of laws, weights, priors and splines.

    There is a row for each choice, with the columns of `posterior.summarise`. All choices have the random
    numbers of the answer, which is therefore the first row. The lines of the crash map are thinned to the
    probable ones.
    """

    def row(choice: str, own: LawStudy) -> dict[str, str | float]:
        return {"choice": choice} | summary_under(own, lines, streams)

    def of_shape(*shapes: str) -> LawStudy:
        return study.only([name for name in study.names if name in known and known[name].shape in shapes])

    smooth, records, known = study.smooth, study.smooth.records, named()
    draws = study.draws(streams("draws"))
    masses = lines.masses(draws)
    rows = [
        {"choice": "as in the answer"} | summarise(Posterior(masses.sum(axis=1), draws.member)),
        row("without two kinds of drivers", study.only([n for n in study.names if "two kinds" not in n])),
        row("exponential tails alone", of_shape("exponential")),
        row("generalised tails alone", of_shape("generalised")),
        row("two kinds of drivers alone", of_shape("two kinds")),
        row("equal weights", replace(study, weights=np.full(study.weights.shape, 1 / len(study.names)))),
    ]
    of_smooth = study.only(smooth.names)
    for choice, prior in PRIORS.items():
        family = replace(smooth, family=replace(smooth.family, prior=prior))
        rows.append(row(choice, replace(of_smooth, family=family)))
    if (few := smooth.family.far_records) is not None:
        near = near_crashes(few, lines, masses.mean(axis=0))
        one = replace(smooth.family, far_records=near, prior=PRIORS[ONE_FACTOR])
        rows.append(row(NEAR_FACTORS, replace(of_smooth, family=replace(smooth, family=one))))
    straight = replace(smooth, family=replace(smooth.family, far={}, far_records=None))
    rows.append(row("far tail: no factors", replace(of_smooth, family=straight)))
    for choice, splines in SPLINES.items():
        support = replace(records.support, splines=splines)
        family = SmoothFamily.of(replace(records, support=support), smooth.members)
        rows.append(row(choice, study.with_family(family, streams("weigh"))))
    return pd.DataFrame(rows)


def near_crashes(records: FarRecords, lines: CrashLines, masses: Array) -> FarRecords:
    """Return the records whose lead speed and range are among those of 90 % of the predicted crashes each.

    ``masses`` are the crash probabilities of the intervals of the crash map. The levels of the far tail stay
    those of all records. If there are no crashes, all records are returned.
    """
    if not masses.sum() > 0:
        return records
    kept = np.ones(records.closing_speed.size, dtype=bool)
    for name in ("lead_speed", "range_"):
        of_crashes, of_records = (getattr(places, name) for places in (lines.places, records.places))
        order = np.argsort(of_crashes[lines.row])
        share = np.cumsum(masses[order]) / masses.sum()
        ends = of_crashes[lines.row][order][np.searchsorted(share, (NEAR, 1 - NEAR))]
        kept &= (of_records >= ends[0]) & (of_records <= ends[1])
    return records.only(kept)
