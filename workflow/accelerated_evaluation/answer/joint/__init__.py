"""The answer under joint laws: their held-out scores and weights, and the posterior of a probability."""
