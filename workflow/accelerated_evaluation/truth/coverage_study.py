"""The study of coverage: many replicates of one method, each stopped in every way."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from tqdm import trange

from accelerated_evaluation.methods.importance_sampling import Stratum
from accelerated_evaluation.truth.coverage import (
    CRUDE,
    Stream,
    foretold_size,
    replicate_rows,
    stop_crude,
    stop_importance_sampling,
)


def coverage_replicates(
    method: str,
    searches: Sequence[Mapping[str, Stratum]],
    probability: float,
    generator_of: Callable[..., np.random.Generator],
    settings: Mapping[str, Any],
    coverage: Mapping[str, int],
) -> pd.DataFrame:
    """Run the replicates of one method; they take the searches in turn.

    Parameters
    ----------
    method
        ``crude`` or the name of a method of importance sampling.
    searches
        The segments with the f* of each search; none for crude Monte Carlo.
    probability
        The exact crash probability, from which the number of crashes of crude Monte Carlo is drawn.
    generator_of
        Gives the generator of a piece of the work by its name.
    settings, coverage
        Sections ``importance_sampling`` and ``coverage`` of the configuration.

    Returns
    -------
    pandas.DataFrame
        Columns ``method``, ``replicate`` and those of `coverage.replicate_rows`.
    """
    if method == CRUDE:
        # The weight of a crude simulation is 0 or 1, which the gamma interval makes use of.
        stops, weight_bound = [partial(stop_crude, probability, generator_of(), settings)], 1.0
    else:
        size = foretold_size(searches, generator_of("pilot"), coverage["pilot"], settings)
        streams = [Stream(strata, generator_of(number)) for number, strata in enumerate(searches)]
        stops = [partial(stop_importance_sampling, stream, size, settings) for stream in streams]
        weight_bound = None
    rows = []
    for replicate in trange(coverage["replicates"], desc=f"coverage, {method}"):
        stopped = stops[replicate % len(stops)]()
        labels = {"method": method, "replicate": replicate}
        rows += [labels | row for row in replicate_rows(stopped, weight_bound)]
    return pd.DataFrame(rows)
