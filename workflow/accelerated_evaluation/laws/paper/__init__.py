"""The paper's laws: candidate families of distributions, piecewise mixtures and their fits."""
