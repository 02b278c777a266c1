"""The study of importance sampling: independent replicates of one method over some of the segments."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from tqdm import trange

from accelerated_evaluation.methods.importance_sampling import Stratum
from accelerated_evaluation.methods.replicates import estimate_replicate

ALL = "all"


def strata_of_searches(
    problems: Mapping[str, Any],
    shares: Mapping[str, float],
    proposals: Sequence[Mapping[str, Any]],
    scope: str = ALL,
) -> list[dict[str, Stratum]]:
    """Set up the segments of a scope with the f* of each search.

    Parameters
    ----------
    problems, shares
        The cut-ins of each segment, and its share in the lane changes.
    proposals
        f* of each segment, search by search.
    scope
        ``all`` or the name of one segment.
    """
    chosen = [segment for segment in problems if scope in (ALL, segment)]
    return [
        {segment: Stratum(problems[segment], shares[segment], found[segment]) for segment in chosen}
        for found in proposals
    ]


def study_replicates(
    searches: Sequence[Mapping[str, Stratum]],
    labels: Mapping[str, str],
    generator_of: Callable[[int], np.random.Generator],
    settings: Mapping[str, Any],
) -> dict[str, pd.DataFrame]:
    """Run the replicates; they take the searches in turn.

    Parameters
    ----------
    searches
        The segments with the f* of each search.
    labels
        Columns that say what was estimated: ``study``, ``scope`` and ``method``.
    generator_of
        Gives the generator of a replicate.
    settings
        Section ``importance_sampling`` of the configuration.

    Returns
    -------
    dict
        ``estimates``, one row a replicate, and ``course``, how each came about.
    """
    estimates, courses = [], []
    for replicate in trange(settings["replicates"], desc=f"{labels['method']}, {labels['scope']}"):
        strata = searches[replicate % len(searches)]
        estimate, course = estimate_replicate(strata, generator_of(replicate), settings)
        numbered = {**labels, "replicate": replicate}
        estimates.append(numbered | estimate)
        courses.append(course.assign(**numbered)[[*numbered, *course.columns]])
    return {"estimates": pd.DataFrame(estimates), "course": pd.concat(courses, ignore_index=True)}
