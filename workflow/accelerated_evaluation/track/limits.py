"""Limits of a proving ground, and the probability of the cut-ins beyond them.

A campaign estimates the probability that a cut-in is within the limits and ends in the event. This module
computes the probability of a cut-in beyond the limits under the law. The probability of the event without
limits is at most the sum of the two.
"""

import math
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws import Law, StratifiedLaw, Stratum

SPEEDS = 100  # number of bins of the recorded lead speeds, each of which is represented by its mean
MOST_BEYOND = 0.5  # largest probability beyond the limits; a campaign must be about most cut-ins of the law
NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)  # over the distribution function of the range


@dataclass(frozen=True)
class Limits:
    """The limits of a proving ground; None means no limit."""

    host_speed_max: float | None = None  # at the cut-in [m/s]
    closing_speed_max: float | None = None  # at the cut-in [m/s]
    range_min: float | None = None  # at the cut-in [m]

    def __bool__(self) -> bool:
        """Whether there is any limit."""
        return self != UNLIMITED

    def hold(self, lead_speed: Array, range_: Array, closing_speed: Array) -> NDArray[np.bool_]:
        """Return whether each cut-in is within the limits, shape (n,)."""
        return (range_ >= (self.range_min or 0.0)) & (closing_speed <= self.closing_speed(lead_speed))

    def closing_speed(self, lead_speed: Array) -> Array:
        """Return the largest allowed closing speed [m/s] at given lead speeds [m/s].

        It is infinite if there is no limit.
        """
        host = math.inf if self.host_speed_max is None else self.host_speed_max
        highest = math.inf if self.closing_speed_max is None else self.closing_speed_max
        return np.minimum(np.subtract(host, lead_speed), highest)

    def beyond(self, law: StratifiedLaw) -> float:
        """Return the probability under a law that a cut-in is beyond the limits.

        A cut-in is beyond the limits if its range is too short, or if its range is allowed and its closing
        speed is too large. The probability of the second case is an integral over the range. It is computed
        by Gauss-Legendre quadrature, and averaged over bins of the recorded lead speeds.
        """
        return float(sum(law.shares[name] * self._beyond(law, part) for name, part in law.strata.items()))

    def _beyond(self, law: StratifiedLaw, stratum: Stratum) -> float:
        speed, share = _binned(stratum.lead_speed.values)
        nearest = stratum.first(speed, np.full(speed.size, 1 / self.range_min if self.range_min else np.inf))
        far = stratum.factors.first.cdf(nearest)  # P(R >= range_min | v_L)
        u = far[:, None] * (NODES + 1) / 2
        speeds = np.repeat(speed, NODES.size)
        first = stratum.factors.first.ppf(u.ravel())
        middle = stratum.factors.second.ppf(np.full(speeds.size, 0.5))  # the range does not depend on it
        inverse_range = 1 / stratum.points(speeds, first, middle)[:, 1]
        highest = self.closing_speed(speeds)
        # All cut-ins above the cap of the law are simulated at the cap, so a limit above it excludes none.
        reached = highest < law.closing_speed_max
        faster = np.zeros(speeds.size)
        faster[reached] = stratum.closing_speed_probability(
            speeds[reached],
            inverse_range[reached],
            np.maximum(highest[reached], 0.0),
            np.full(reached.sum(), np.inf),
        )
        too_fast = far * (faster.reshape(u.shape) @ (WEIGHTS / 2))
        return float(share @ (stratum.factors.first.sf(nearest) + too_fast))

    @property
    def in_words(self) -> str:
        """The limits as text."""
        words = {
            "host_speed_max": "host speed at most {:g} m/s",
            "closing_speed_max": "closing speed at most {:g} m/s",
            "range_min": "range at least {:g} m",
        }
        return ", ".join(
            words[name].format(value) for name, value in asdict(self).items() if value is not None
        )


UNLIMITED = Limits()
# What most proving grounds can drive; for cut-ins of law files with strata, unless the user states limits.
USUAL = Limits(host_speed_max=50.0, range_min=0.5)


def usual_where_open(limits: Limits, law: Law) -> Limits:
    """Return limits in which each limit that is None is replaced by the usual one of a proving ground.

    Under a law without strata the probability beyond limits is not known, so the limits are unchanged.
    """
    if not law.strata:
        return limits
    given = {name: value for name, value in asdict(limits).items() if value is not None}
    return replace(USUAL, **given)


def _binned(values: Array) -> tuple[Array, Array]:
    """Return the means of bins of lead speeds [m/s], and the share of each."""
    counts, edges = np.histogram(values, SPEEDS)
    sums, _ = np.histogram(values, edges, weights=values)
    return sums[counts > 0] / counts[counts > 0], counts[counts > 0] / values.size


def require_limits(limits: Limits, law: Law) -> float:
    """Check the limits, and return the probability under a law that a cut-in is beyond the limits.

    InputError is raised if a limit is not a positive number, if the law has no strata, or if the probability
    beyond the limits exceeds `MOST_BEYOND`.
    """
    for name, value in asdict(limits).items():
        if value is not None and not 0 < value < math.inf:
            where = f"--{name.replace('_', '-')}"
            raise InputError(
                where, seen=f"{value:g}", expected="a number above 0", change="Correct the value."
            )
    if limits and not law.strata:
        raise InputError(
            "the limits of the proving ground",
            seen=f"a law without strata ({law.description})",
            expected="a law of cut-ins in strata of the lead speed, under which limits have a probability",
            change="Leave the limits out, or begin the campaign under such a law.",
        )
    beyond = limits.beyond(law) if limits else 0.0
    if beyond > MOST_BEYOND:
        raise InputError(
            "the limits of the proving ground",
            seen=f"{limits.in_words}, beyond which {beyond:.3g} of all cut-ins of the law lie",
            expected=f"a share of at most {MOST_BEYOND:g} beyond the limits",
            change="Widen the limits, or fit a law to records within them.",
        )
    return beyond
