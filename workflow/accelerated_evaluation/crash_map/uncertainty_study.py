"""The study of uncertainty: refits to resampled data, alternative models, and the budget."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.crash_map.exact import ALL, exact_probabilities
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.crash_map.sensitivity import Levels
from accelerated_evaluation.crash_map.uncertainty import (
    bootstrap_probabilities,
    probabilities_of_choices,
    uncertainty_budget,
)
from accelerated_evaluation.laws.paper.independent import IndependentLaw


def study_uncertainty(
    crash_map: CrashMap,
    models: Mapping[str, IndependentLaw],
    variant: str,
    encounters: pd.DataFrame,
    generator: np.random.Generator,
    settings: Mapping[str, Any],
    alpha: float,
) -> dict[str, pd.DataFrame]:
    """Refit the model to resampled lane changes, and divide the uncertainty of the result among its sources.

    Parameters
    ----------
    crash_map
        Map of the vehicle under test.
    models, variant
        The alternative piecewise models, and the name of the model that is simulated.
    encounters
        Encounter table, with rows in the order of the record.
    generator
        Source of all randomness.
    settings
        Section ``uncertainty`` of the configuration.
    alpha
        1 - level of all intervals.

    Returns
    -------
    dict
        ``uncertainty``, the budget, and ``bootstrap``, the crash probability of each refit.
    """
    studied = models[variant]
    bootstrap = bootstrap_probabilities(
        crash_map,
        encounters,
        Levels.of(studied),
        generator,
        closing_speed_max=studied.closing_speed_max,
        replicates=settings["replicates"],
        block_runs=settings["block_runs"],
    )
    variants = [Levels.of(model) for model in models.values()]
    knots, cap = settings["inverse_ttc_knots"], studied.closing_speed_max
    choices = probabilities_of_choices(crash_map, encounters, variants, knots, cap)
    probability = exact_probabilities(crash_map, studied)[ALL].probability
    interval = tuple(settings["sampling_interval"])
    refits = pd.DataFrame({"probability": bootstrap}).rename_axis("replicate").reset_index()
    return {
        "uncertainty": uncertainty_budget(probability, bootstrap, choices, interval, alpha=alpha),
        "bootstrap": refits,
    }
