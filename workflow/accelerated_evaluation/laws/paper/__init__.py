"""The paper's laws: candidate families, piecewise mixtures, their fits, and the independent law."""
