"""Uncertainty of the crash probability of a piecewise model: bootstrap refits, and a budget by source."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri
from tqdm import trange

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.sections import integer, section
from accelerated_evaluation.crash_map.exact import ALL, exact_probabilities
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.crash_map.sensitivity import Levels, Refit, is_repeated, warning_of_failure
from accelerated_evaluation.laws.paper.models import IndependentLaw

PAPER_INTERVAL = 7.0e-7, 7.8e-7  # of importance sampling in the paper (section VI.C)
INVERSE_TTC_KNOTS = 0.925, 0.95, 0.975  # the paper's quantile for the knot of TTC^-1, and its neighbours
SECTION = section(
    replicates=integer(500, 10, 1_000_000, "Number of bootstrap samples, to each of which the law is fitted.")
)
NORMAL_POINTS = 100  # number of quantiles that represent a normal distribution


def study_uncertainty(
    crash_map: CrashMap,
    models: Mapping[str, IndependentLaw],
    variant: str,
    encounters: pd.DataFrame,
    generator: np.random.Generator,
    replicates: int,
    alpha: float,
) -> dict[str, pd.DataFrame]:
    """Return the uncertainty of a crash probability, from refits of the model to resampled lane changes.

    The uncertainty is divided among its sources: finite data, choice of the model, and sampling. The first
    table is that of `uncertainty_budget`, and ``bootstrap`` has the crash probability of each refit to
    resampled data. The model ``variant`` is the one that is simulated, and all intervals have the level 100
    (1 - alpha) %.
    """
    studied = models[variant]
    bootstrap = bootstrap_probabilities(
        crash_map,
        encounters,
        Levels.of(studied),
        generator,
        closing_speed_max=studied.closing_speed_max,
        replicates=replicates,
    )
    variants = [Levels.of(model) for model in models.values()]
    cap = studied.closing_speed_max
    choices = probabilities_of_choices(crash_map, encounters, variants, INVERSE_TTC_KNOTS, cap)
    probability = exact_probabilities(crash_map, studied)[ALL].probability
    refits = pd.DataFrame({"probability": bootstrap}).rename_axis("replicate").reset_index()
    return {
        "uncertainty": uncertainty_budget(probability, bootstrap, choices, PAPER_INTERVAL, alpha=alpha),
        "bootstrap": refits,
    }


def bootstrap_probabilities(
    crash_map: CrashMap,
    encounters: pd.DataFrame,
    levels: Levels,
    generator: np.random.Generator,
    *,
    closing_speed_max: float,
    replicates: int,
) -> Array:
    """Return the crash probabilities of models that are fitted to resampled data, shape (replicates,).

    A row and the rows that repeat it form one run, and runs are resampled. Knots are chosen again at their
    quantile levels. The shares of the segments and the lead speeds are those of the resampled rows. If a
    refit fails, its result is NaN, and a warning is given. ``closing_speed_max`` is a cap [m/s].
    """
    refit = Refit.by(crash_map, closing_speed_max)
    starts = np.flatnonzero(~is_repeated(encounters))
    needed = encounters[["lead_speed", "inverse_range", "inverse_ttc", "segment"]]
    needed = needed.astype({"segment": "category"})  # rows of texts are slow to select and to group
    probabilities = np.full(replicates, np.nan)
    for replicate in trange(replicates, desc="bootstrap", unit=" refits"):
        rows = resampled_rows(starts, len(encounters), generator)
        with warning_of_failure(f"bootstrap, refit {replicate}"):
            probabilities[replicate] = refit.probability(needed.iloc[rows], levels).probability
    return probabilities


def resampled_rows(starts: NDArray[np.intp], rows: int, generator: np.random.Generator) -> NDArray[np.intp]:
    """Return the rows of one bootstrap sample: as many random runs as there are in the data.

    A run is a row and the rows after it that are equal to it. ``starts`` has the first row of each run, in
    increasing order from 0. The number of resampled rows varies, because the runs have different lengths.
    """
    runs = generator.integers(starts.size, size=starts.size)
    lengths = np.diff(starts, append=rows)[runs]
    place = np.arange(lengths.sum()) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    return np.repeat(starts[runs], lengths) + place


def probabilities_of_choices(
    crash_map: CrashMap,
    encounters: pd.DataFrame,
    variants: Iterable[Levels],
    inverse_ttc_knots: Iterable[float],
    closing_speed_max: float,
) -> Array:
    """Return the crash probabilities for all combinations of models and knots of TTC^-1.

    Combinations whose fit fails are left out, with a warning. The quantile levels of the knot of TTC^-1
    replace those of the models.
    """
    refit = Refit.by(crash_map, closing_speed_max)
    choices = product(variants, inverse_ttc_knots)
    probabilities = []
    for levels, knot in choices:
        with warning_of_failure(f"knot of TTC^-1 at {knot:g}"):
            exact = refit.probability(encounters, replace(levels, inverse_ttc=knot))
            probabilities.append(exact.probability)
    return np.array(probabilities)


def uncertainty_budget(
    probability: float,
    bootstrap: Array,
    choices: Sequence[float],
    sampling_interval: tuple[float, float],
    *,
    alpha: float,
) -> pd.DataFrame:
    """Return the variance of the crash probability, divided among its sources.

    The sources are the finite data, the choice of the model, and the sampling. The sampling has the normal
    interval of importance sampling, as in the paper. The intervals of the other sources are quantiles of
    their probabilities, those of the refits to resampled data, in which NaN is ignored, and those under
    alternative models, which all have the same weight. A last row ``together`` combines the three sources:
    their relative deviations from ``probability`` are assumed to be independent. Relative quantities are NaN
    if ``probability`` is 0.
    """
    bootstrap, choices = (_or_unknown(values) for values in (bootstrap, choices))
    probability = probability or math.nan  # relative deviations from 0 are undefined
    quantiles = [alpha / 2, 1 - alpha / 2]
    middle = sum(sampling_interval) / 2
    sampling_sd = (sampling_interval[1] - sampling_interval[0]) / (2 * -ndtri(alpha / 2))
    relative = np.array(
        [sampling_sd / middle, _standard_deviation(bootstrap) / probability, np.std(choices) / probability]
    )
    errors = 1 + relative[0] * ndtri((np.arange(NORMAL_POINTS) + 0.5) / NORMAL_POINTS)
    together = np.multiply.outer(np.multiply.outer(bootstrap, np.array(choices) / probability), errors)
    rows = [
        ("sampling", middle, sampling_sd, *sampling_interval),
        ("data", np.mean(bootstrap), _standard_deviation(bootstrap), *np.quantile(bootstrap, quantiles)),
        ("choice of model", np.mean(choices), np.std(choices), *np.quantile(choices, quantiles)),
        ("together", np.mean(together), np.std(together), *np.quantile(together, quantiles)),
    ]
    columns = ["source", "probability", "standard_deviation", "ci_low", "ci_high"]
    shares = [*(relative**2 / np.sum(relative**2)), 1.0]
    return pd.DataFrame(rows, columns=columns).assign(variance_share=shares)


def _or_unknown(values: ArrayLike) -> Array:
    """Return the values that are not NaN, or a single NaN if there are none."""
    values = np.asarray(values, dtype=float)
    known = values[~np.isnan(values)]
    return known if known.size else np.array([math.nan])


def _standard_deviation(values: Array) -> float:
    return float(np.std(values, ddof=1)) if values.size > 1 else math.nan
