"""The table ``choices``: the answer if a choice of the statistician had been another one.

The choices are the kinds of laws and their weights, the prior of the factors of the far tail, and the number
of splines. They were made by judgement, some of them after inspecting the same records, so their effect
belongs next to the answer.
"""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.law_study import LawStudy
from accelerated_evaluation.answer.smooth_family import NAMED, SmoothFamily
from accelerated_evaluation.answer.variants import summary_under
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.far_tail import PRIOR

PRIORS = {"far tail: prior half as wide": 4 * PRIOR, "far tail: prior twice as wide": PRIOR / 4}
SPLINES = {"fewer splines": (4, 3), "more splines": (9, 8)}


def choice_table(
    study: LawStudy, lines: CrashLines, draws: int, generator: np.random.Generator
) -> pd.DataFrame:
    """Tabulate the crash probability for other choices of laws, weights, priors and splines.

    There is a row for each choice, with the columns of `posterior.summarise`. All choices have the same
    random numbers. The lines of the crash map are thinned to the probable ones.
    """

    def row(choice: str, own: LawStudy, on: CrashLines = lines) -> dict[str, str | float]:
        return {"choice": choice} | summary_under(own, on, deepcopy(generator))

    def of_shape(*shapes: str) -> LawStudy:
        return study.only([name for name in study.names if name in NAMED and NAMED[name].shape in shapes])

    study = replace(study, weights=study.weights[:draws])
    smooth, records = study.smooth, study.smooth.records
    rows = [
        row("as in the answer", study),
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
    straight = replace(smooth, family=replace(smooth.family, far={}, far_records=None))
    rows.append(row("far tail: no factors", replace(of_smooth, family=straight)))
    for choice, splines in SPLINES.items():
        support = replace(records.support, splines=splines)
        family = SmoothFamily.of(replace(records, support=support), smooth.members)
        again = LawStudy.of_family(family, draws, deepcopy(generator))
        places = Places.of(lines.places.lead_speed, lines.places.range_, support)
        rows.append(row(choice, again, on=replace(lines, places=places)))
    return pd.DataFrame(rows)
