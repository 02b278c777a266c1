"""The table ``choices``: the answer if a choice of the statistician had been another one.

The choices are the kinds of laws and their weights, the prior of the factors of the far tail, and the number
of splines. They were made by judgement, some of them after inspecting the same records, so their effect
belongs next to the answer.
"""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.scored_family import score_family
from accelerated_evaluation.answer.summary import summarise
from accelerated_evaluation.answer.weighted_family import WeightedLaws
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.far_tail import PRIOR

PRIORS = {"far tail: prior half as wide": 4 * PRIOR, "far tail: prior twice as wide": PRIOR / 4}
SPLINES = {"fewer splines": (4, 3), "more splines": (9, 8)}


def choice_table(
    weighted: WeightedLaws, lines: CrashLines, draws: int, generator: np.random.Generator
) -> pd.DataFrame:
    """Tabulate the crash probability for other choices of laws, weights, priors and splines.

    Parameters
    ----------
    weighted
        The family of the answer with its weights.
    lines
        Lines of the crash map, thinned to the probable ones.
    draws
        Number of draws of the posterior for each choice.
    generator
        Source of all randomness, which is the same for all choices.

    Returns
    -------
    pandas.DataFrame
        One row for each ``choice``, with the columns of `summarise`.
    """

    def row(choice: str, of: WeightedLaws, weights: Array | None = None, on: CrashLines = lines) -> dict:
        posterior = of.draw({"crash": on}, deepcopy(generator), weights)["crash"]
        return {"choice": choice} | summarise(posterior)

    weighted = replace(weighted, weights=weighted.weights[:draws])
    shapes = np.array([member.shape for member in weighted.members])
    rows = [
        row("as in the answer", weighted),
        row("without two kinds of drivers", weighted, weighted.weights_of(shapes != "two kinds")),
        row("exponential tails alone", weighted, weighted.weights_of(shapes == "exponential")),
        row("generalised tails alone", weighted, weighted.weights_of(shapes == "generalised")),
        row("two kinds of drivers alone", weighted, weighted.weights_of(shapes == "two kinds")),
        row("equal weights", weighted, np.full(weighted.weights.shape, 1 / shapes.size)),
    ]
    for choice, prior in PRIORS.items():
        rows.append(row(choice, replace(weighted, family=replace(weighted.family, prior=prior))))
    straight = replace(weighted, family=replace(weighted.family, far={}, far_records=None))
    rows.append(row("far tail: no factors", straight))
    for choice, splines in SPLINES.items():
        support = replace(weighted.records.support, splines=splines)
        scored = score_family(replace(weighted.records, support=support), weighted.members)
        again = WeightedLaws.drawn(scored, deepcopy(generator), draws)
        places = Places.of(lines.places.lead_speed, lines.places.range_, support)
        rows.append(row(choice, again, on=replace(lines, places=places)))
    return pd.DataFrame(rows)
