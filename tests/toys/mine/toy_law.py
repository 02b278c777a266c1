"""A toy: R^-1 has a Pareto distribution, and TTC^-1 an exponential one in each segment."""

import math
from dataclasses import dataclass

from accelerated_evaluation.laws import FITS, LAWS
from accelerated_evaluation.laws.distributions import BoundedExponential, Pareto
from accelerated_evaluation.laws.paper.models import IndependentLaw, recorded_lead_speeds


@LAWS.add("toy_law")
@dataclass(frozen=True)
class ToyLaw(IndependentLaw):
    """As its parent, under the name that its files state."""


@FITS.add("toy_law")
def fit(encounters, settings):
    """Fit the law to an encounter table."""
    segments = {name: rows["inverse_ttc"] for name, rows in encounters.groupby("segment")}
    return ToyLaw(
        "a toy",
        {name: len(rows) for name, rows in segments.items()},
        Pareto.fit(encounters["inverse_range"].to_numpy(), 1 / settings.range_max),
        {name: BoundedExponential.fit(rows.to_numpy(), 0.0, math.inf) for name, rows in segments.items()},
        recorded_lead_speeds(encounters, segments),
    )
