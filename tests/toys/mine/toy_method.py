"""A toy: crude Monte Carlo with a number of simulations that the configuration states."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from accelerated_evaluation.base.sections import integer, section
from accelerated_evaluation.methods import METHODS, Estimate, Method
from accelerated_evaluation.methods.intervals import binomial_interval


@METHODS.add("toy_method")
@dataclass(frozen=True)
class ToyMethod(Method):
    """Draws from the law itself."""

    style: ClassVar[dict] = {"color": "black", "linestyle": "-", "marker": "P"}
    settings: ClassVar[dict] = {"toy_method": section(size=integer(1000, 100, 10000, "Simulations."))}
    sections: ClassVar[tuple] = ("toy_method",)

    size: int = 1000

    @classmethod
    def configured(cls, config):
        """Return the method with the settings of a configuration."""
        return cls(config["toy_method"]["size"])

    def estimate(self, problem, stopping, generator):
        """Estimate the probability of the event by its share."""
        happened, _ = problem.evaluate(generator.standard_normal((self.size, problem.dimension)))
        events = int(np.count_nonzero(happened))
        low, high = binomial_interval(events, self.size, stopping.alpha)
        return Estimate(events / self.size, low, high, stopping.alpha, 0, self.size, events, converged=False)
