"""Univariate distributions of the models: bounded distributions, mixtures, and their exponential tilting."""

from accelerated_evaluation.laws.distributions.bounded_exponential import BoundedExponential
from accelerated_evaluation.laws.distributions.bounded_normal import BoundedNormal
from accelerated_evaluation.laws.distributions.described import (
    DISTRIBUTIONS,
    Described,
    Distribution,
    Parameter,
    Tiltable,
    distribution,
    from_dict,
    unit_to_power,
)
from accelerated_evaluation.laws.distributions.empirical import Empirical
from accelerated_evaluation.laws.distributions.mixture import Mixture, PiecewiseMixture, match_mean
from accelerated_evaluation.laws.distributions.pareto import Pareto

__all__ = [
    "DISTRIBUTIONS",
    "BoundedExponential",
    "BoundedNormal",
    "Described",
    "Distribution",
    "Empirical",
    "Mixture",
    "Parameter",
    "Pareto",
    "PiecewiseMixture",
    "Tiltable",
    "distribution",
    "from_dict",
    "match_mean",
    "unit_to_power",
]
