"""Our numbers with a spread, in which a number of the paper that was made in the same way is expected."""

import math
from typing import NamedTuple, Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.special import ndtri, stdtrit

from accelerated_evaluation.methods.importance_sampling import crude_simulations

LEVEL = 0.95  # of all spreads but that of the pooled probability
PAPERS_RULE = "sequential"  # name of the paper's stopping rule in the study of coverage


class Spread(NamedTuple):
    """One of our numbers with its spread; the limits are NaN if it has none."""

    value: float
    low: float
    high: float
    of: str  # what the spread is, such as "95 % interval of one more search (5 made)"


def exactly(value: float, of: str) -> Spread:
    """Return a number without a spread, with the reason why it has none."""
    return Spread(value, math.nan, math.nan, of)


class Mean(NamedTuple):
    """A mean with its standard error, and the degrees of freedom of this error."""

    value: float
    error: float
    freedom: float

    @classmethod
    def of(cls, values: ArrayLike) -> Self:
        """Return the mean of independent values, shape (n,)."""
        values = np.asarray(values, dtype=float)
        if values.size < 2:
            return cls(float(values.mean()), math.nan, math.nan)
        error = float(values.std(ddof=1)) / math.sqrt(values.size)
        return cls(float(values.mean()), error, values.size - 1)

    def over(self, other: Self) -> Self:
        """Return the ratio to another, independent mean.

        The error is that of the delta method, with the degrees of freedom of Welch (1947). It is NaN, as the
        ratio, if the other mean is 0.
        """
        if not other.value:
            return type(self)(math.nan, math.nan, math.nan)
        ratio = self.value / other.value
        parts = [(error / other.value) ** 2 for error in (self.error, ratio * other.error)]
        spent = parts[0] ** 2 / self.freedom + parts[1] ** 2 / other.freedom
        return type(self)(ratio, math.sqrt(sum(parts)), sum(parts) ** 2 / spent if spent else math.inf)

    def interval(self, what: str) -> Spread:
        """Return the mean with its confidence interval; ``what`` describes the data."""
        return self._spread(self.error, f"95 % interval, {what}")

    def further(self, what: str, size: int = 1) -> Spread:
        """Return the mean with the interval in which one more mean of ``size`` values is expected."""
        errors = math.sqrt(1 + (self.freedom + 1) / size)  # of this mean, in which the other one varies
        return self._spread(errors * self.error, f"95 % interval of one more {what}")

    def _spread(self, error: float, of: str) -> Spread:
        half_width = float(stdtrit(self.freedom, (1 + LEVEL) / 2)) * error or math.nan  # none has no width
        return Spread(self.value, self.value - half_width, self.value + half_width, of)


def of_method(table: pd.DataFrame, method: str, scope: str = "all") -> pd.DataFrame:
    """Return the rows of estimates, or of their courses, that belong to one method and scope.

    A scope is a segment, or ``all``.
    """
    return table[(table["method"] == method) & (table["scope"] == scope)]


def pooled_probability(course: pd.DataFrame, method: str, alpha: float, scope: str = "all") -> Spread:
    """Pool the last rows of all replicates' courses into one estimate.

    The courses continue beyond convergence. Unlike the mean of the estimates at convergence, the pooled
    estimate is therefore not biased by a stopping rule. It is weighted by the numbers of simulations, with
    its normal interval of level 1 - alpha.
    """
    last = of_method(course, method, scope).groupby("replicate").last()
    weight = last["simulations"] / last["simulations"].sum()
    probability = float(weight @ last["probability"])
    half_width = float(-ndtri(alpha / 2)) * math.sqrt(weight**2 @ last["variance"])
    simulations = last["simulations"].sum()
    of = f"{100 * (1 - alpha):g} % interval of {simulations:,} simulations"
    low, high = max(probability - half_width, 0.0), min(probability + half_width, 1.0)
    return Spread(probability, low, high, of)


def simulations_needed(
    estimates: pd.DataFrame, coverage: pd.DataFrame, method: str, *, first: bool = False
) -> Spread:
    """Return the mean number of simulations to convergence over all segments, or that of the first replicate.

    The spread is where one more mean of as many replicates, or one more replicate, is expected. It comes from
    the many replicates of the study of coverage, which use the same f*; for a method that is not part of that
    study, from the replicates themselves. A replicate that did not converge contributes the simulations that
    it made, fewer than it needs.
    """
    runs = of_method(estimates, method)["simulations"].to_numpy(float)
    found = coverage[(coverage["method"] == method) & (coverage["stopping"] == PAPERS_RULE)]
    replicates = Mean.of(runs)
    if len(found):
        row = found.iloc[0]
        error = row["simulations_sd"] / math.sqrt(row["replicates"])
        replicates = Mean(row["simulations_mean"], error, row["replicates"] - 1)
    origin = f"(from {replicates.freedom + 1:,.0f} replicates)"
    missing = int((~of_method(estimates, method)["converged"]).sum())
    origin += f", {missing} not converged" if missing else ""
    if first:
        return replicates.further(f"run {origin}; ours is the first")._replace(value=float(runs[0]))
    spread = replicates.further(f"mean of {runs.size} {origin}", size=runs.size)
    return spread._replace(value=float(runs.mean()))


def crude_sample_size(exact: pd.DataFrame, alpha: float, beta: float) -> Spread:
    """Return the number of simulations that crude Monte Carlo would need (section VI.C, N-hat).

    It has no spread, because the error of the exact probability is too small to be seen in it. Convergence is
    a relative half-width beta of the interval with level 1 - alpha.
    """
    probability = float(exact.set_index("segment").loc["all", "probability"])
    value = crude_simulations(probability, alpha, beta) if probability > 0 else math.inf
    return exactly(value, "none, from the exact probability")
