"""The rare-event problem: cut-ins drawn from a lane-change model and simulated with a vehicle."""

from dataclasses import dataclass, fields

import numpy as np

from accelerated_evaluation.distributions import Distribution, Empirical
from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.vehicles.protocol import Outcomes, Vehicle


@dataclass(frozen=True)
class Proposal:
    """Independent laws of R^-1 [1/m] and TTC^-1 [1/s] within one velocity segment; f and f* are both one."""

    inverse_range: Distribution
    inverse_ttc: Distribution

    def logpdf(self, inverse_range: Array, inverse_ttc: Array) -> Array:
        """Log density of pairs, shape (n,)."""
        return self.inverse_range.logpdf(inverse_range) + self.inverse_ttc.logpdf(inverse_ttc)


@dataclass(frozen=True)
class Sample:
    """Simulated cut-ins, arrays of shape (n,)."""

    lead_speed: Array
    inverse_range: Array
    inverse_ttc: Array
    log_ratio: Array
    outcomes: Outcomes

    def join(self, other: "Sample") -> "Sample":
        """Return the cut-ins of both samples."""

        def joined(one: Outcomes | Sample, two: Outcomes | Sample, skip: str = "") -> dict[str, Array]:
            names = [field.name for field in fields(one) if field.name != skip]
            return {name: np.concatenate([getattr(one, name), getattr(two, name)]) for name in names}

        outcomes = Outcomes(**joined(self.outcomes, other.outcomes))
        return Sample(**joined(self, other, skip="outcomes"), outcomes=outcomes)

    @property
    def crash_weight(self) -> Array:
        """I(x) f(x) / f*(x), whose mean estimates the crash probability (paper, section IV.A)."""
        return np.where(self.outcomes.crash, np.exp(self.log_ratio), 0.0)


@dataclass(frozen=True)
class CutIn:
    """Cut-ins of one velocity segment before one vehicle.

    Parameters
    ----------
    lead_speed
        Law of v_L [m/s]; it is never accelerated here.
    model
        f, the law of R^-1 and TTC^-1.
    vehicle
        The car under test.
    closing_speed_max
        Closing speeds are capped at this [m/s] before simulating.
    """

    lead_speed: Empirical
    model: Proposal
    vehicle: Vehicle
    closing_speed_max: float = np.inf

    def simulate(self, lead_speed: Array, inverse_range: Array, inverse_ttc: Array) -> Outcomes:
        """Simulate cut-ins given in the paper's variables, each of shape (n,)."""
        closing_speed = np.minimum(inverse_ttc / inverse_range, self.closing_speed_max)
        return self.vehicle.simulate(lead_speed, 1 / inverse_range, closing_speed)

    def sample(self, proposal: Proposal, generator: np.random.Generator, size: int) -> Sample:
        """Draw ``size`` cut-ins from f*, simulate them, and weigh them by log f / f*."""
        lead_speed = self.lead_speed.rvs(generator, size)
        inverse_range = proposal.inverse_range.rvs(generator, size)
        inverse_ttc = proposal.inverse_ttc.rvs(generator, size)
        pairs = inverse_range, inverse_ttc
        log_ratio = self.model.logpdf(*pairs) - proposal.logpdf(*pairs)
        return Sample(lead_speed, *pairs, log_ratio, self.simulate(lead_speed, *pairs))
