"""Published and repeated values of a claim, and how likely it is that both are of the same quantity."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest, fisher_exact, t

LEVEL = 0.001  # of each test; with 30 claims, one of 30 repetitions of right numbers refutes one by chance


@dataclass(frozen=True)
class Mean:
    """A number with its standard error; an exact one has none.

    Attributes
    ----------
    value, error
        The number, and its standard error.
    freedom
        Degrees of freedom of the standard error.
    """

    value: float
    error: float = 0.0
    freedom: float = math.inf

    @classmethod
    def of(cls, values: Sequence[float]) -> "Mean":
        """Return the mean of independent values."""
        values = np.asarray(values, dtype=float)
        return cls(values.mean(), values.std(ddof=1) / math.sqrt(values.size), values.size - 1)

    def over(self, other: "Mean") -> "Mean":
        """Return the ratio to an independent mean, with the standard error of the first order."""
        ratio = self.value / other.value
        relative = math.hypot(self.error / self.value, other.error / other.value)
        return Mean(ratio, abs(ratio) * relative, min(self.freedom, other.freedom))

    def likelihood(self, other: "Mean") -> float:
        """Return the p-value of Welch's test that both estimate the same number."""
        variances = np.square([self.error, other.error])
        if not variances.sum():
            return float(math.isclose(self.value, other.value, rel_tol=1e-9))
        with np.errstate(divide="ignore"):  # both errors are known: infinitely many degrees of freedom
            freedom = variances.sum() ** 2 / (variances**2 / [self.freedom, other.freedom]).sum()
        return float(2 * t.sf(abs(self.value - other.value) / math.sqrt(variances.sum()), freedom))

    def __str__(self) -> str:
        is_count = 100 <= abs(self.value) < 1e6
        value = f"{self.value:,.0f}" if is_count else f"{self.value:.3g}"
        error = f"{self.error:,.0f}" if is_count and self.error >= 10 else f"{self.error:.2g}"
        return f"{value} ± {error}" if self.error else value


@dataclass(frozen=True)
class Share:
    """How often something happened in independent repetitions."""

    hits: int
    of: int

    def likelihood(self, other: "Share") -> float:
        """Return the p-value of Fisher's test that both have the same probability."""
        table = [[one.hits, one.of - one.hits] for one in (self, other)]
        return float(fisher_exact(table).pvalue)

    def __str__(self) -> str:
        return f"{self.hits:,} of {self.of:,}"


@dataclass(frozen=True)
class AtLeast:
    """A lower bound of a probability."""

    bound: float

    def likelihood(self, found: Share) -> float:
        """Return the p-value of the exact test that the probability is not below the bound."""
        return float(binomtest(found.hits, found.of, self.bound, alternative="less").pvalue)

    def __str__(self) -> str:
        return f"at least {self.bound:.0%}"


@dataclass(frozen=True)
class Between:
    """Limits that were stated for a number, and that include more than the error of a repetition."""

    low: float
    high: float

    def likelihood(self, found: Mean) -> float:
        """Return 1 if the number lies between the limits, else 0."""
        return float(self.low <= found.value <= self.high)

    def __str__(self) -> str:
        return f"{self.low:.3g} to {self.high:.3g}"


@dataclass(frozen=True)
class Exactly:
    """Something that a repetition must give again as it is."""

    what: str

    def likelihood(self, found: "Exactly") -> float:
        """Return 1 if both are equal, else 0."""
        return float(self == found)

    def __str__(self) -> str:
        return self.what


@dataclass(frozen=True)
class Claim:
    """A claim, the published value, and what a short repetition found."""

    text: str
    published: Mean | Share | AtLeast | Between | Exactly
    found: Mean | Share | Exactly

    @property
    def likelihood(self) -> float:
        """P-value of the test that the claim holds."""
        return self.published.likelihood(self.found)

    @property
    def verdict(self) -> str:
        """``agrees``, or ``refuted`` if the p-value is below `LEVEL`."""
        return "agrees" if self.likelihood >= LEVEL else "refuted"
