"""The study of coverage: many replicates of one method, each stopped by every rule."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
import pandas as pd
from tqdm import trange

from accelerated_evaluation.laws import Factors
from accelerated_evaluation.methods.coverage import (
    Stream,
    predicted_size,
    replicate_rows,
    stop_crude,
    stop_importance_sampling,
)
from accelerated_evaluation.methods.estimate import Stopping
from accelerated_evaluation.problem import Problem


def coverage_replicates(
    method: str,
    problem: Problem,
    searches: Sequence[Mapping[str, Factors]],
    probability: float,
    generator_of: Callable[..., np.random.Generator],
    stopping: Stopping,
    coverage: Mapping[str, int],
) -> pd.DataFrame:
    """Run many replicates of one method, each of which is stopped by every stopping rule.

    Replicate k uses the result of search k modulo the number of searches. Without a search, the method is
    crude Monte Carlo, whose number of crashes is drawn with the exact probability. ``generator_of`` is called
    with "pilot", with the number of a search, or, for crude Monte Carlo, without an argument. The columns are
    ``method``, ``replicate`` and those of `coverage.replicate_rows`.
    """
    if searches:
        size = predicted_size(problem, searches, generator_of("pilot"), coverage["pilot"], stopping)
        streams = [Stream(problem, found, generator_of(number)) for number, found in enumerate(searches)]
        stops = [partial(stop_importance_sampling, stream, size, stopping) for stream in streams]
        weight_bound = None
    else:
        # The weights of crude Monte Carlo are 0 or 1, so the gamma interval can use 1 as their bound.
        stops, weight_bound = [partial(stop_crude, probability, generator_of(), stopping)], 1.0
    rows = []
    for replicate in trange(coverage["replicates"], desc=f"coverage, {method}"):
        stopped = stops[replicate % len(stops)]()
        labels = {"method": method, "replicate": replicate}
        rows += [labels | row for row in replicate_rows(stopped, weight_bound)]
    return pd.DataFrame(rows)
