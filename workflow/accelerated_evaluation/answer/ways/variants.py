"""The answer for other choices of the statistician, and for other treatments of the records."""

from collections.abc import Callable, Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from tqdm import tqdm

from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.candidates.smooth_family import SmoothFamily, named
from accelerated_evaluation.answer.ways.posterior import SUMMARY, Posterior, summarise
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.support import SUPPORT, Support
from accelerated_evaluation.records.segments import MINIMUM_ROWS

WITHOUT_CRASHES = "without the record that crashes"  # name of a treatment
RANGE_LIMIT_WIDTH = 0.5  # [m], width below the largest range in which records may be affected by rounding


Streams = Callable[[str], np.random.Generator]
"""Returns the generator of a step of the answer by its name, always in the same state."""


def threshold_table(study: LawStudy, lines: CrashLines, streams: Streams) -> pd.DataFrame:
    """Return the crash probability from the laws with one threshold alone, one row for each ``level``.

    All thresholds get the random numbers of the answer, so that they differ only by the threshold.
    """
    known = named()
    levels = {name: known[name].level for name in study.names if name in known}
    rows = []
    for level in sorted({level for level in levels.values() if level is not None}):
        own = study.only([name for name, each in levels.items() if each == level])
        rows.append({"level": level} | summary_under(own, lines, streams))
    return pd.DataFrame(rows, columns=["level", *SUMMARY])


def record_variants(
    encounters: pd.DataFrame,
    crashed: NDArray[np.bool_],
    outlier_rows: list[int],
    support: Support = SUPPORT,
) -> dict[str, DistinctRecords]:
    """Return the records after alternative treatments of the data, by the name of the treatment.

    ``crashed`` says whether each row crashes when the car under test replays it, and ``outlier_rows`` are the
    rows, counted from 1, that the authors' later code leaves out.
    """
    distinct, range_ = DistinctRecords.of(encounters, support), encounters["range"].to_numpy()
    outlier = np.isin(np.arange(1, len(encounters) + 1), outlier_rows)
    rows = DistinctRecords(
        *(encounters[name].to_numpy(float) for name in ("lead_speed", "range", "closing_speed")), support
    )
    return {
        "as in the answer": distinct,
        "repeated rows kept": rows,
        **{
            reading: DistinctRecords.of(encounters[kept], support)
            for reading, kept in {
                "without ranges under 3 m": range_ >= 3,
                "without ranges under 5 m": range_ >= 5,
                WITHOUT_CRASHES: ~crashed,
                "without the authors' outliers": ~outlier,
                "without the last half metre of range": range_ <= support.range_max - RANGE_LIMIT_WIDTH,
            }.items()
        },
    }


def quality_table(
    choices: Mapping[str, DistinctRecords],
    study: LawStudy,
    lines: CrashLines,
    streams: Streams,
) -> pd.DataFrame:
    """Return the crash probability for each treatment of the records, one row for each ``reading``.

    The laws are fitted again, from the fit of the study to its records, and weighted again. All treatments
    get the random numbers of the answer, which is therefore the first row. The numbers are NaN if too few
    records are left.
    """
    start = study.smooth
    rows, answers = [], {start.records.x.tobytes(): summary_under(study, lines, streams)}
    for reading, records in tqdm(choices.items(), desc="data quality", unit=" readings"):
        # A treatment that concerns no record leaves the records, and therefore the answer, as they are.
        content = records.x.tobytes()
        if content not in answers:
            answers[content] = {}
            if records.size >= MINIMUM_ROWS:
                family = SmoothFamily.of(records, start.members, start=start.family)
                again = study.with_family(family, streams("weigh"))
                answers[content] = summary_under(again, lines, streams)
        rows.append({"reading": reading, "events": records.size} | answers[content])
    return pd.DataFrame(rows)


def summary_under(study: LawStudy, lines: CrashLines, streams: Streams) -> dict[str, float]:
    """Return the summary of the crash probability under draws of a study of laws, as those of the answer."""
    draws = study.draws(streams("draws"))
    return summarise(Posterior(lines.masses(draws).sum(axis=1), draws.member))
