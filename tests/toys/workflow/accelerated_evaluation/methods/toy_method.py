"""A toy: crude Monte Carlo with a thousand simulations."""

from typing import ClassVar

import numpy as np
from accelerated_evaluation.methods import METHODS, Estimate, Method
from accelerated_evaluation.methods.intervals import binomial_interval


@METHODS.add("toy_method")
class ToyMethod(Method):
    """A thousand draws from the law itself."""

    name: ClassVar[str] = "toy_method"
    look: ClassVar[dict] = {"color": "black", "linestyle": "-", "marker": "P"}

    def estimate(self, problem, stopping, generator):
        """Estimate the probability of the event by its share."""
        happened, _ = problem.evaluate(generator.standard_normal((1000, problem.dimension)))
        events = int(np.count_nonzero(happened))
        low, high = binomial_interval(events, 1000, stopping.alpha)
        return Estimate(events / 1000, low, high, stopping.alpha, 0, 1000, events, converged=False)
