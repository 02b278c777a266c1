"""Distributions of the lane-change model: bounded pieces, mixtures, and their change of measure."""

from accelerated_evaluation.distributions.bounded_exponential import BoundedExponential
from accelerated_evaluation.distributions.bounded_normal import BoundedNormal
from accelerated_evaluation.distributions.empirical import Empirical
from accelerated_evaluation.distributions.mixture import Mixture, PiecewiseMixture, match_mean
from accelerated_evaluation.distributions.pareto import Pareto
from accelerated_evaluation.distributions.protocol import Distribution, Tiltable

__all__ = [
    "BoundedExponential",
    "BoundedNormal",
    "Distribution",
    "Empirical",
    "Mixture",
    "Pareto",
    "PiecewiseMixture",
    "Tiltable",
    "match_mean",
]
