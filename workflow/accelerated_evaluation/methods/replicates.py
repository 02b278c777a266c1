"""One replicate of the importance-sampling study: its estimate at convergence and how it got there."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.methods.importance_sampling import (
    Stratum,
    estimate,
    run_to_convergence,
    running,
)


def estimate_replicate(
    strata: Mapping[str, Stratum], generator: np.random.Generator, settings: Mapping[str, Any]
) -> tuple[dict[str, float | bool], pd.DataFrame]:
    """Run one replicate to convergence.

    Parameters
    ----------
    strata
        The segments that lane changes fall into.
    generator
        Source of all randomness.
    settings
        Section ``importance_sampling`` of the configuration.

    Returns
    -------
    estimate : dict
        The estimate at convergence (or after the last simulation, then ``converged`` is False).
    course : pandas.DataFrame
        Running estimate, variance and relative half-width every ``course_step`` simulations.
    """
    alpha, step = settings["alpha"], settings["course_step"]
    weights, converged_at = run_to_convergence(
        strata,
        generator,
        alpha=alpha,
        beta=settings["beta"],
        minimum_events=settings["minimum_events"],
        simulations=settings["simulations"],
        maximum_simulations=settings["maximum_simulations"],
    )
    course = running(weights, alpha)
    shown = np.arange(step - 1, weights.size, step)
    table = pd.DataFrame(
        {
            "simulations": shown + 1,
            "probability": course.probability[shown],
            "variance": course.variance[shown],
            "relative_half_width": course.relative_half_width[shown],
            "events": course.events[shown],
        }
    )
    result = asdict(estimate(weights[:converged_at], alpha))
    return result | {"converged": converged_at is not None}, table
