"""How many records lie in the far tail: expected by the laws and counted, by lead speed and range."""

from collections.abc import Iterator

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.far_tail import RECORDS

GROUPS = 4  # of equally many records, by lead speed and by range
EVERY_LAW = "all laws"
Places = tuple[Array, Array]  # lead speeds [m/s] and ranges [m]


def far_records_table(study: LawStudy) -> pd.DataFrame:
    """Compare the numbers of records beyond the levels of the far tail with those that the laws expect.

    A level is the cumulative hazard that a given number of all records should exceed under a law *without*
    factors of the far tail. If the law is right, a number in proportion to their size exceeds it in each
    group of records with similar lead speeds or ranges. The factors of the far tail follow from these counts.

    Parameters
    ----------
    study
        The smooth laws with their weights.

    Returns
    -------
    pandas.DataFrame
        For the mean over all laws with their weights and for each law, rows for all records and for groups of
        them: ``law``, ``group``, ``records`` and, for each level, the numbers ``expected_100`` and
        ``counted_100``, and so on. There are no rows if the records are too few for a far tail.
    """
    smooth = study.smooth
    few, records = smooth.family.far_records, smooth.records
    columns = [f"{what}_{number}" for number in RECORDS for what in ("expected", "counted")]
    if few is None:
        return pd.DataFrame(columns=["law", "group", "records", *columns])
    every = records.lead_speed, records.range_
    groups = list(_groups(every, (few.places.lead_speed, few.places.range_)))
    sizes = [int(own.sum()) for _, own, _ in groups]
    counted = {}
    for name, member in zip(study.names, smooth.members, strict=True):
        law = smooth.family.without_far_tail(member)
        beyond = law.given(few.places).cumulative(few.closing_speed) > few.levels[:, None]
        counted[name] = np.array([beyond[:, inside].sum(axis=1) for *_, inside in groups])
    expected = np.outer(sizes, np.exp(-few.levels))
    counts = {EVERY_LAW: study.mean(counted), **counted}
    rows = [
        [law, group, size, *np.column_stack(pair).ravel()]
        for law, numbers in counts.items()
        for (group, *_), size, *pair in zip(groups, sizes, expected, numbers, strict=True)
    ]
    return pd.DataFrame(rows, columns=["law", "group", "records", *columns])


def _groups(every: Places, few: Places) -> Iterator[tuple[str, NDArray[np.bool_], NDArray[np.bool_]]]:
    """Yield the name of each group, and which of all records and of the few records are in it."""
    yield "all records", np.ones(every[0].size, dtype=bool), np.ones(few[0].size, dtype=bool)
    for name, unit, *values in zip(("lead speed", "range"), ("m/s", "m"), every, few, strict=True):
        edges = np.quantile(values[0], np.arange(GROUPS + 1) / GROUPS)
        own, of_few = (np.searchsorted(edges[1:-1], each, side="right") for each in values)
        for place in range(GROUPS):
            low, high = edges[place : place + 2]
            yield f"{name} {low:.3g} to {high:.3g} {unit}", own == place, of_few == place
