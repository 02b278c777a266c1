"""The surrogate-guided sampler of few simulations."""
