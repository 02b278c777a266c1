"""Methods that estimate the probability of an event; each is a module, and `METHODS` is their registry."""

from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.methods.estimate import Estimate, Method, Stopping

METHODS: Registry[type[Method]] = Registry("method", __name__, __path__)

__all__ = ["METHODS", "Estimate", "Method", "Stopping"]
