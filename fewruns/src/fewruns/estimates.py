"""The estimate of a probability, and its stopping rule."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from numbers import Real
from typing import Any

from fewruns.errors import require


@dataclass(frozen=True)
class Stopping:
    """The rule that decides when an estimate is precise enough.

    Attributes
    ----------
    alpha
        The level of the intervals is 100 (1 - alpha) %.
    beta
        An estimate has converged when the half-width of its interval is at most ``beta`` times the estimate.
    minimum_events
        Smallest number of events for convergence; the sampler of this package needs only one.
    maximum_simulations
        Number of simulations after which the estimation ends without convergence.
    anytime
        Whether the intervals keep their level although they are checked after every batch.

    Examples
    --------
    >>> rule = Stopping(alpha=0.05, beta=0.3, maximum_simulations=500)
    """

    alpha: float = 0.2
    beta: float = 0.2
    minimum_events: int = 1
    maximum_simulations: int = 100_000
    anytime: bool = False

    def __post_init__(self) -> None:
        """Check the values."""
        for name, least, most in (
            ("alpha", 0.0, 1.0),
            ("beta", 0.0, math.inf),
            ("minimum_events", -1, math.inf),
            ("maximum_simulations", -1, math.inf),
        ):
            value = getattr(self, name)
            fits = isinstance(value, Real) and least < float(value) < most
            require(name, value, f"a number above {least:g} and below {most:g}", fits=fits)
        require("anytime", self.anytime, "True or False", fits=isinstance(self.anytime, bool))


@dataclass(frozen=True)
class Estimate:
    """The estimated probability of an event.

    Attributes
    ----------
    probability, low, high
        The estimate and the ends of its interval. If there are too few events, the interval begins at 0 and
        ends at an upper limit, which is 1 in the worst case, and the estimate is 0 or NaN.
    alpha
        The level of the interval is 100 (1 - alpha) %.
    learning, estimating
        Numbers of simulations that were used for learning, and on which the estimate is based.
    events
        Number of events among the simulations.
    converged
        Whether the stopping rule is satisfied.
    diagnostics
        Additional numbers by name.
    tables
        Tables by name, each with columns by name. The table ``runs`` of a sampler is a record array, a row
        for each simulation; ``pandas.DataFrame(found.tables["runs"])`` makes a data frame of it.
    reason
        Why the estimate has converged, or why it has not, in one sentence.
    excluded
        What other parts of the event the runs exclude, and what outcomes by chance.
    warning
        What the runs say against statements about the problem, such as ``upper_set``; empty if nothing.

    Examples
    --------
    >>> found = Estimate(2e-6, 1.6e-6, 2.6e-6, 0.2, learning=60, estimating=90, events=40, converged=True)
    >>> found.simulations, found.covers(1.9e-6)
    (150, True)
    >>> print(found)
    2e-06 (80 % interval 1.6e-06 to 2.6e-06) from 150 runs, converged
    """

    probability: float
    low: float
    high: float
    alpha: float
    learning: int
    estimating: int
    events: int
    converged: bool
    diagnostics: Mapping[str, float] = field(default_factory=dict)
    tables: Mapping[str, Any] = field(default_factory=dict)
    reason: str = ""
    excluded: str = ""
    warning: str = ""

    def __str__(self) -> str:
        """Return the estimate, its interval and what it is based on, in one line."""
        interval = f"{100 * (1 - self.alpha):g} % interval {self.low:.2g} to {self.high:.2g}"
        verdict = "converged" if self.converged else "not converged"
        verdict += f" ({self.reason})" * bool(self.reason and not self.converged)
        words = [("excluded", self.excluded), ("warning", self.warning)]
        further = "".join(f"; {name}: {text}" for name, text in words if text)
        return f"{self.probability:.3g} ({interval}) from {self.simulations} runs, {verdict}{further}"

    @property
    def simulations(self) -> int:
        """Total number of simulations, including those for learning."""
        return self.learning + self.estimating

    def covers(self, probability: float) -> bool:
        """Return whether the interval contains the given probability."""
        return self.low <= probability <= self.high

    def row(self) -> dict[str, Any]:
        """Return the estimate as a row of a table, by column; the diagnostics are the last columns."""
        return {
            "probability": self.probability,
            "ci_low": self.low,
            "ci_high": self.high,
            "learning": self.learning,
            "estimating": self.estimating,
            "events": self.events,
            "converged": self.converged,
            **self.diagnostics,
        }
