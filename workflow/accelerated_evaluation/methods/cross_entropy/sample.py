"""Samples of one stratum of a problem from an importance-sampling distribution, with their weights."""

from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws import Factors
from accelerated_evaluation.methods.problem import Problem


@dataclass(frozen=True)
class Sample:
    """Simulated encounters of one stratum, drawn from a proposal f*; all arrays have shape (n,)."""

    first: (
        Array  # coordinates of the encounters in the stratum, R^-1 [1/m] and TTC^-1 [1/s] in the paper's laws
    )
    second: Array
    log_ratio: Array  # log f - log f*
    happened: NDArray[np.bool_]
    outcomes: Any  # outcomes of the scenario

    @classmethod
    def of(
        cls, problem: Problem, stratum: str, proposal: Factors, generator: np.random.Generator, size: int
    ) -> Self:
        """Draw a sample of a stratum, given by its name, from a proposal, and simulate it."""
        f = problem.law.strata[stratum]
        lead_speed = f.lead_speed.rvs(generator, size)
        coordinates = proposal.rvs(generator, size)
        # Both densities are of the coordinates, so the Jacobian of the map to cut-ins cancels.
        log_ratio = f.factors.logpdf(*coordinates) - proposal.logpdf(*coordinates)
        outcomes = problem.simulate(problem.law.with_cap(f.points(lead_speed, *coordinates)))
        return cls(*coordinates, log_ratio, problem.event.happens(outcomes), outcomes)

    def join(self, other: "Sample") -> "Sample":
        """Return both samples as one."""
        outcomes = type(self.outcomes)(**_joined(self.outcomes, other.outcomes))
        parts = _joined(self, other, skip="outcomes")
        return Sample(**parts, outcomes=outcomes)

    @property
    def weight(self) -> Array:
        """The likelihood ratio f / f* where the event happened, and 0 elsewhere, shape (n,)."""
        return np.where(self.happened, np.exp(self.log_ratio), 0.0)


def _joined(one: Any, two: Any, skip: str = "") -> dict[str, Array]:  # noqa: ANN401
    names = [field.name for field in fields(one) if field.name != skip]
    return {name: np.concatenate([getattr(one, name), getattr(two, name)]) for name in names}
